"""Replay gives the recorded bytes at the recorded pace."""

import contextlib
import socket
import threading
from pathlib import Path

import numpy as np
import pytest
from patience import PATIENCE_S
from traffic import SECOND, Vehicle, batch
from wire_streams import wire_streams

from gcs.errors import LinkError, RecordingError
from gcs.links.opening import UdpLink, open_link
from gcs.mavlink.dialect import Dialect
from gcs.recording.reader import Recording
from gcs.station.capture import Capture, CaptureOptions, record
from gcs.station.replay import ReplayStepper, replay, replay_file, replay_in_lock_step, steps, timeline

START = 1_800_000_000 * SECOND


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Three seconds over two links, with noise between frames."""
    path = tmp_path / "flight.mcap"
    capture = Capture(path, Dialect.load())
    vehicle = Vehicle()
    for second in range(3):
        frames = vehicle.second()
        capture.take("udpin:0.0.0.0:14550", batch([*frames[:20], b"noise", *frames[20:]], START + second * SECOND))
        capture.take("/dev/ttyUSB0,57600", batch(frames[:5], START + second * SECOND + SECOND // 2))
        capture.tick(START + (second + 1) * SECOND)
    capture.close(START + 3 * SECOND)
    return path


class Clock:
    """Time that passes only by sleeping, and oversleeps each time."""

    def __init__(self) -> None:
        self.now = 50.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds + 0.003


@pytest.mark.parametrize("speed", [1.0, 4.0, 0.5])
def test_errors_of_sleeping_do_not_add_up(speed: float) -> None:
    pieces = [(START + i * SECOND // 100, b"x") for i in range(1000)]
    clock = Clock()
    sent: list[float] = []
    replay(iter(pieces), lambda data: sent.append(clock.now - 50.0), speed, clock=clock, sleep=clock.sleep)
    for i, at in enumerate(sent):
        assert i / 100 / speed <= at <= i / 100 / speed + 0.01


@pytest.mark.parametrize("speed", [0.0, float("inf")])
def test_without_a_pace_nothing_waits(speed: float) -> None:
    clock = Clock()
    pieces = [(START + i * SECOND, b"xy") for i in range(5)]
    assert replay(iter(pieces), lambda data: None, speed, clock=clock, sleep=clock.sleep) == (5, 10)
    assert clock.now == 50.0


def test_the_timeline_merges_links_in_time_and_keeps_every_byte(recording: Path) -> None:
    source = Recording(recording)
    both = list(timeline(source))
    assert [at for at, _ in both] == sorted(at for at, _ in both)
    for link, stream in wire_streams(source).items():
        alone = b"".join(data for _, data in timeline(source, link))
        assert alone == b"".join(data for _, data in stream)
    assert sum(len(data) for _, data in both) == sum(
        len(data) for stream in wire_streams(source).values() for _, data in stream
    )
    with pytest.raises(RecordingError, match="ttyUSB9"):
        list(timeline(source, "ttyUSB9"))


def drain(sock: socket.socket, size: int) -> bytes:
    sock.settimeout(PATIENCE_S)
    data = b""
    while len(data) < size:
        data += sock.recv(65536)
    return data


def test_a_file_over_tcp_arrives_byte_for_byte(recording: Path) -> None:
    link = "udpin:0.0.0.0:14550"
    expected = b"".join(data for _, data in wire_streams(Recording(recording))[link])
    with socket.create_server(("127.0.0.1", 0)) as server:
        received: list[bytes] = []

        def serve() -> None:
            peer, _ = server.accept()
            with peer:
                received.append(drain(peer, len(expected)))

        thread = threading.Thread(target=serve)
        thread.start()
        sent = replay_file(recording, f"tcp:127.0.0.1:{server.getsockname()[1]}", 0, link=link)
        thread.join(PATIENCE_S)
    assert received == [expected]
    assert (sent.bytes, sent.unsent_bytes) == (len(expected), 0)


@pytest.mark.whole_flight
def test_a_replay_recorded_again_holds_the_same_messages(recording: Path, tmp_path: Path) -> None:
    link = open_link("udpin:127.0.0.1:0")
    assert isinstance(link, UdpLink)
    again = tmp_path / "again.mcap"
    source = "udpin:0.0.0.0:14550"
    whole = sum(len(data) for _, data in timeline(Recording(recording), source))
    done = threading.Event()

    def progress(passed: float, capture: Capture) -> None:
        if capture.bytes >= whole:
            done.set()
            raise KeyboardInterrupt

    url = f"udpout:127.0.0.1:{link.port}"
    thread = threading.Thread(target=replay_file, args=(recording, url, 1.0), kwargs={"link": source})
    thread.start()
    capture = record([link], CaptureOptions(again, 60.0), progress)
    thread.join()
    assert done.is_set()
    assert capture.bytes == whole
    first, second = Recording(recording), Recording(again)
    for name in ("ATTITUDE", "HEARTBEAT", "SYSTEM_TIME"):
        (sent,), (got,) = first.columns(name), second.columns(name)
        assert np.array_equal(sent.fields, got.fields)
    # One second of flight took one second, as the receiver's own stamps tell.
    span = second.columns("ATTITUDE")[0].log_time
    assert (span[-1] - span[0]) / SECOND == pytest.approx(2.98, abs=0.2)


def test_a_recording_is_not_written_over(recording: Path) -> None:
    before = recording.read_bytes()
    with pytest.raises(RecordingError, match="exists already"):
        record([], CaptureOptions(recording, 1.0), lambda passed, capture: None)
    assert recording.read_bytes() == before


def test_a_step_is_what_came_at_one_time_or_within_one_span() -> None:
    pieces = [
        (START, b"a"),
        (START, b"b"),
        (START + 4, b"c"),
        (START + 10, b"d"),
        (START + 19, b"e"),
        (START + 35, b"f"),
    ]
    assert [data for _, data in steps(pieces)] == [[b"a", b"b"], [b"c"], [b"d"], [b"e"], [b"f"]]
    assert list(steps(pieces, 10)) == [
        (START + 4, [b"a", b"b", b"c"]),
        (START + 19, [b"d", b"e"]),
        (START + 35, [b"f"]),
    ]
    assert list(steps([])) == []


def test_a_stepper_sends_a_step_at_a_time_and_all_in_the_end(recording: Path) -> None:
    source = Recording(recording)
    sent: list[bytes] = []
    stepper = ReplayStepper(source, sent.append, 100_000_000)
    times = []
    while (at := stepper.step()) is not None:
        times.append(at)
    spans = {(at - START) // 100_000_000 for at, _ in timeline(source)}
    assert [(at - START) // 100_000_000 for at in times] == sorted(spans)
    assert sent == [data for _, data in timeline(source)]
    assert (stepper.pieces, stepper.bytes) == (len(sent), sum(map(len, sent)))


@pytest.mark.parametrize("kind", [socket.SOCK_STREAM, socket.SOCK_DGRAM])
def test_in_lock_step_nothing_is_sent_before_the_answer(recording: Path, kind: socket.SocketKind) -> None:
    link = "udpin:0.0.0.0:14550"
    expected = [b"".join(data) for _, data in steps(timeline(Recording(recording), link), 250_000_000)]
    received: list[bytes] = []
    early: list[bytes] = []
    with socket.socket(socket.AF_INET, kind) as server:
        server.bind(("127.0.0.1", 0))
        stream = kind is socket.SOCK_STREAM
        if stream:
            server.listen()

        def answer() -> None:
            peer = server.accept()[0] if stream else server
            for step in expected:
                data, address = b"", None
                peer.settimeout(PATIENCE_S)
                while len(data) < len(step):
                    part, address = peer.recvfrom(65536)
                    data += part
                received.append(data)
                peer.settimeout(0.02)
                with contextlib.suppress(TimeoutError):
                    early.append(peer.recv(65536))
                if stream:
                    peer.sendall(b"!")
                else:
                    peer.sendto(b"!", address)
            if stream:
                peer.close()

        thread = threading.Thread(target=answer)
        thread.start()
        url = f"{'tcp' if stream else 'udpout'}:127.0.0.1:{server.getsockname()[1]}"
        sent = replay_in_lock_step(recording, url, 250_000_000, link=link)
        thread.join(PATIENCE_S)
    assert received == expected
    assert early == []
    assert (sent.bytes, sent.unsent_bytes) == (sum(map(len, expected)), 0)


def test_without_an_answer_lock_step_ends_in_one_line(recording: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        url = f"udpout:127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(LinkError, match=r"no answer for 0\.2 s to what was received 0\.000 s"):
            replay_in_lock_step(recording, url, answer_timeout_s=0.2)
