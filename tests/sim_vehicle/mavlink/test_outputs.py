"""Links and files on real sockets, a real pseudo-terminal and real files."""

import contextlib
import os
import socket
import struct
import threading
import time
import tty
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest
from patience import PATIENCE_S

from sim_vehicle.errors import SinkError
from sim_vehicle.mavlink import outputs
from sim_vehicle.mavlink.outputs import Link, SerialSink, TcpSink, UdpSink, open_link, open_recording

FRAMES = [b"first", b"second frame", b"3"]


def test_udpout_sends_each_frame_as_its_own_datagram() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(PATIENCE_S)
        link = open_link(f"udpout:127.0.0.1:{receiver.getsockname()[1]}")
        for frame in FRAMES:
            link.write(frame, 0)
        assert [receiver.recv(2048) for _ in FRAMES] == FRAMES
        link.close()


def test_udpout_without_a_listener_goes_on() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    link = open_link(f"udpout:127.0.0.1:{port}")
    for _ in range(5):
        link.write(b"frame", 0)
    # Whoever comes to listen later is served by the same link.
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as late:
        late.bind(("127.0.0.1", port))
        late.settimeout(PATIENCE_S)
        link.write(b"late", 0)
        link.write(b"late", 0)
        assert late.recv(100) == b"late"
    link.close()


@pytest.mark.parametrize("kind", ["udpin", "udp"])
def test_udpin_answers_whoever_speaks_first(kind: str) -> None:
    link = open_link(f"{kind}:127.0.0.1:0")
    assert isinstance(link, UdpSink)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.settimeout(PATIENCE_S)
        station.sendto(b"hello", ("127.0.0.1", link.port))
        for frame in FRAMES:
            link.write(frame, 0)
        assert [station.recv(2048) for _ in FRAMES] == FRAMES
    link.close()


def received(connection: socket.socket, size: int) -> bytes:
    connection.settimeout(PATIENCE_S)
    data = b""
    while len(data) < size:
        part = connection.recv(4096)
        if not part:
            break
        data += part
    return data


def test_tcp_client() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(PATIENCE_S)
        link = open_link(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        connection, _ = server.accept()
        with connection:
            for frame in FRAMES:
                link.write(frame, 0)
            assert received(connection, 18) == b"".join(FRAMES)
        link.close()


def test_tcp_client_tells_when_the_station_leaves() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = open_link(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        server.accept()[0].close()

        def send_on() -> None:
            for _ in range(100_000):
                link.write(b"frame" * 100, 0)

        with pytest.raises(SinkError, match="the other side is gone"):
            send_on()
        link.close()


def test_tcp_server_serves_the_next_client_when_one_leaves() -> None:
    link = open_link("tcpin:127.0.0.1:0")
    assert isinstance(link, TcpSink)
    stop = threading.Event()

    def keep_sending() -> None:
        while not stop.is_set():
            link.write(b"x" * 100, 0)

    sender = threading.Thread(target=keep_sending)
    sender.start()
    try:
        for _ in range(2):
            with socket.create_connection(("127.0.0.1", link.port), timeout=PATIENCE_S) as client:
                assert received(client, 1000)[:1000] == b"x" * 1000
        with socket.create_connection(("127.0.0.1", link.port), timeout=PATIENCE_S) as client:
            assert received(client, 1000)[:5] == b"xxxxx"
            stop.set()
            deadline = time.monotonic() + PATIENCE_S
            client.settimeout(0.05)
            while sender.is_alive() and time.monotonic() < deadline:
                with contextlib.suppress(TimeoutError):
                    client.recv(1 << 16)
    finally:
        stop.set()
        link.close()
    assert not sender.is_alive()


def test_serial_port() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    try:
        link = open_link(f"{os.ttyname(slave)},115200")
        assert isinstance(link, SerialSink)
        for frame in FRAMES:
            link.write(frame, 0)
        data = b""
        while len(data) < 18:
            data += os.read(master, 100)
        assert data == b"".join(FRAMES)
        link.close()
    finally:
        os.close(master)
        os.close(slave)


def heard(link: Link, count: int) -> bytes:
    """The next `count` bytes that a link receives."""
    data, deadline = b"", time.monotonic() + PATIENCE_S
    while len(data) < count and time.monotonic() < deadline:
        data += link.receive(0.05)
    return data


def test_a_udp_client_hears_its_station() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(PATIENCE_S)
        link = open_link(f"udpout:127.0.0.1:{station.getsockname()[1]}")
        assert link.receive(0.0) == b""
        link.write(b"hello", 0)
        _, vehicle = station.recvfrom(100)
        station.sendto(b"question", vehicle)
        assert heard(link, 8) == b"question"
        link.close()


def bound() -> socket.socket:
    station = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    station.bind(("127.0.0.1", 0))
    station.settimeout(PATIENCE_S)
    return station


def test_a_udp_server_serves_all_who_spoke_until_they_are_silent_for_long() -> None:
    now = 0.0
    link = UdpSink("127.0.0.1", 0, server=True, clock=lambda: now)

    def sends(text: bytes, *stations: socket.socket) -> None:
        link.write(text, 0)
        assert [station.recv(100) for station in stations] == [text] * len(stations)

    with bound() as first, bound() as second:
        first.sendto(b"one", ("127.0.0.1", link.port))
        link.wait_for_peer()
        assert heard(link, 3) == b"one"
        sends(b"alone", first)
        now = 20.0
        second.sendto(b"two", ("127.0.0.1", link.port))
        assert heard(link, 3) == b"two"
        sends(b"to both", first, second)
        now = 29.0
        sends(b"still", first, second)
        now = 31.0
        sends(b"first is gone", second)
        now = 3600.0
        sends(b"the last stays", second)
        first.sendto(b"again", ("127.0.0.1", link.port))
        assert heard(link, 5) == b"again"
        sends(b"back", first)  # nothing that was sent meanwhile
    link.close()


def test_a_udp_server_serves_sixteen_at_most_who_spoke_last() -> None:
    link = open_link("udpin:127.0.0.1:0")
    assert isinstance(link, UdpSink)
    with contextlib.ExitStack() as stack:
        stations = [stack.enter_context(bound()) for _ in range(17)]
        for station in stations:
            station.sendto(b"x", ("127.0.0.1", link.port))
            assert heard(link, 1) == b"x"
        link.write(b"first", 0)
        stations[0].sendto(b"x", ("127.0.0.1", link.port))
        assert heard(link, 1) == b"x"
        link.write(b"second", 0)
        assert [station.recv(100) for station in stations[2:]] == [b"first"] * 15
        assert [station.recv(100) for station in stations[2:]] == [b"second"] * 15
        assert stations[0].recv(100) == b"second"
    link.close()


def test_tcp_hears_its_station_and_goes_on_when_that_says_no_more() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = open_link(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        station, _ = server.accept()
        with station:
            station.settimeout(PATIENCE_S)
            station.sendall(b"question")
            assert heard(link, 8) == b"question"
            station.shutdown(socket.SHUT_WR)
            assert [link.receive(0.01) for _ in range(3)] == [b"", b"", b""]
            link.write(b"answer", 0)
            assert station.recv(100) == b"answer"
        link.close()
    assert link.receive(0.01) == b""


def test_a_serial_port_hears_while_it_is_written_to() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    try:
        link = open_link(f"{os.ttyname(slave)},115200")
        assert link.receive(0.0) == b""
        link.write(b"frame", 0)
        os.write(master, b"question")
        assert heard(link, 8) == b"question"
        assert os.read(master, 100) == b"frame"
        link.close()
    finally:
        os.close(master)
        os.close(slave)


def test_tlog(tmp_path: Path) -> None:
    sink = open_recording(tmp_path / "flight.tlog")
    sink.write(b"abc", 1_700_000_000_123_456_789)
    sink.write(b"de", 1_700_000_000_143_456_789)
    sink.close()
    first, second = 1_700_000_000_123_456, 1_700_000_000_143_456
    expected = struct.pack(">Q", first) + b"abc" + struct.pack(">Q", second) + b"de"
    assert (tmp_path / "flight.tlog").read_bytes() == expected


class Lent:
    """A recorder as another package lends it."""

    opened: str = ""

    def __init__(self, path: str) -> None:
        Lent.opened = path

    def write(self, data: bytes, utc_ns: int) -> None:
        raise NotImplementedError

    def close(self) -> None:
        raise NotImplementedError


def test_a_recorder_is_found_by_its_suffix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("box", f"{__name__}:Lent", outputs.RECORDERS)
    monkeypatch.setattr(EntryPoint, "load", lambda self: Lent)
    monkeypatch.setattr(
        outputs, "entry_points", lambda group, **select: EntryPoints([point]).select(group=group, **select)
    )
    assert isinstance(open_recording(tmp_path / "flight.box"), Lent)
    assert Lent.opened == str(tmp_path / "flight.box")


def test_without_a_recorder_one_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outputs, "entry_points", lambda group, **select: EntryPoints())
    with pytest.raises(SinkError, match=r"no recorder for \.mcap files is installed; there are tlog"):
        open_recording(tmp_path / "flight.mcap")


def test_a_file_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(SinkError, match="cannot be written: there is no folder"):
        open_recording(tmp_path / "none" / "flight.tlog")


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("carrier-pigeon", "no such link"),
        ("udpout:127.0.0.1", "no such link"),
        ("udpout:127.0.0.1:99999", "no such link"),
        ("tcp:127.0.0.1:port", "no such link"),
        ("/dev/ttyUSB0,fast", "is no baud rate"),
        ("/dev/there-is-no-such-port,57600", "cannot be opened"),
        ("udpout:no.such.host.invalid:14550", "cannot be opened"),
    ],
)
def test_a_wrong_link_is_told_in_one_line(url: str, words: str) -> None:
    with pytest.raises(SinkError, match=words) as caught:
        open_link(url)
    assert "\n" not in str(caught.value)


def test_a_refused_connection_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(SinkError, match="Connection refused"):
        open_link(f"tcp:127.0.0.1:{port}")
