"""What a supervisor hears, over a real socket of its own."""

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs.station.supervisor import Supervisor


@pytest.fixture
def heard(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.bind(str(tmp_path / "notify"))
        sock.settimeout(10.0)
        yield sock


def test_each_state_is_a_datagram(heard: socket.socket) -> None:
    environment = {"NOTIFY_SOCKET": heard.getsockname(), "WATCHDOG_USEC": "30000000", "PATH": "/bin"}
    supervisor = Supervisor(environment)
    supervisor.ready()
    supervisor.alive()
    supervisor.stopping()
    first, second, third = (heard.recv(1000).decode().splitlines() for _ in range(3))
    assert first[0] == "READY=1"
    assert second == ["WATCHDOG=1"]
    assert third[0] == "STOPPING=1"
    assert supervisor.every_s == pytest.approx(3.0)
    assert environment == {"PATH": "/bin"}  # workers speak for themselves


def test_an_abstract_address_is_one_too() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.bind("\0gcs-test-of-the-supervisor")
        sock.settimeout(10.0)
        Supervisor({"NOTIFY_SOCKET": "@gcs-test-of-the-supervisor"}).ready()
        assert sock.recv(1000).startswith(b"READY=1")


@pytest.mark.parametrize(
    "environment",
    [
        {},
        {"WATCHDOG_USEC": "1000000"},
        {"NOTIFY_SOCKET": "/nowhere/at/all"},
        {"NOTIFY_SOCKET": "/nowhere/at/all", "WATCHDOG_USEC": "soon"},
        {"NOTIFY_SOCKET": "/nowhere/at/all", "WATCHDOG_USEC": "1000000", "WATCHDOG_PID": "1"},
    ],
)
def test_without_a_supervisor_nothing_happens(environment: dict[str, str]) -> None:
    supervisor = Supervisor(environment)
    supervisor.ready()
    supervisor.alive()
    assert supervisor.every_s is None
