"""Links in a process with more than 1024 open files, where `select` cannot be used."""

import os
import resource
import socket
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from pseudo_terminal import connected, plugged
from traffic import wait_until

from gcs.links.opening import Link, TcpServerLink, UdpLink, open_link

_FILES = 1100


@pytest.fixture(autouse=True)
def many_files() -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2 * _FILES), hard))
    taken: list[int] = []
    try:
        while not taken or taken[-1] < _FILES:
            taken.append(os.open(os.devnull, os.O_RDONLY))
        yield
    finally:
        for number in taken:
            os.close(number)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def heard(link: Link, word: bytes) -> None:
    batch = wait_until(lambda: link.receive(0.1))
    assert batch.data == word


def test_udp() -> None:
    with closing(open_link("udpin:127.0.0.1:0")) as link, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        assert isinstance(link, UdpLink)
        assert link.receive(0.01) is None
        sender.sendto(b"telemetry", ("127.0.0.1", link.port))
        heard(link, b"telemetry")


def test_tcp() -> None:
    with closing(open_link("tcpin:127.0.0.1:0")) as server:
        assert isinstance(server, TcpServerLink)
        with closing(open_link(f"tcp:127.0.0.1:{server.port}")) as client:
            wait_until(lambda: client.receive(0.01) is None and server.receive(0.01) is None and server.connected)
            client.send(b"telemetry")
            heard(server, b"telemetry")
            server.send(b"command")
            heard(client, b"command")


def test_serial(tmp_path: Path) -> None:
    device = tmp_path / "ttyUSB0"
    with plugged(device) as (wire, _), closing(open_link(str(device))) as link:
        connected(link)
        os.write(wire, b"telemetry")
        heard(link, b"telemetry")
        link.send(b"command")
        assert os.read(wire, 100) == b"command"
