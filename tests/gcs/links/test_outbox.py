"""Frames that wait for a slow stream: whole, in order, and not longer than they are of use."""

import itertools
import random
import threading
from contextlib import closing
from pathlib import Path

from patience import PATIENCE_S
from pseudo_terminal import connected, plugged
from traffic import wait_until

from gcs.links.opening import SerialLink, open_link
from gcs.links.outbox import LIMIT_BYTES, STALE_S, Outbox


class Stream:
    """A stream that takes as many bytes as it is told to, and an outbox before it whose time is set by hand."""

    def __init__(self) -> None:
        self.got = b""
        self.room = 0
        self.now = 100.0
        self.taken: list[int] = []
        self.dropped = 0
        self.outbox = Outbox(self.write, self.taken.append, self.drop, clock=lambda: self.now)

    def write(self, data: memoryview) -> int:
        count = min(len(data), self.room)
        self.got += bytes(data[:count])
        self.room -= count
        return count

    def drop(self, count: int) -> None:
        self.dropped += count

    def take(self, room: int) -> None:
        self.room = room
        self.outbox.flush()


def frame(letter: str, length: int = 30) -> bytes:
    return letter.encode() * length


def test_a_frame_that_was_begun_is_finished_and_what_waited_too_long_behind_it_is_dropped() -> None:
    stream = Stream()
    assert stream.outbox.offer([frame("a"), frame("b"), frame("c")]) == 3
    stream.take(10)
    stream.now += STALE_S - 0.1
    assert stream.outbox.offer([frame("d")]) == 1
    stream.now += 0.2
    stream.take(1000)
    assert stream.got == frame("a") + frame("d")
    assert stream.dropped == 2
    assert sum(stream.taken) == len(stream.got)


def test_everything_that_is_too_old_goes_where_no_frame_was_begun() -> None:
    stream = Stream()
    stream.outbox.offer([frame("a")])
    stream.take(30)
    stream.outbox.offer([frame("b"), frame("c")])
    stream.now += STALE_S + 0.1
    stream.take(1000)
    assert (stream.got, stream.dropped, len(stream.outbox)) == (frame("a"), 2, 0)


def test_what_somebody_waits_for_never_grows_too_old() -> None:
    stream = Stream()
    assert stream.outbox.offer([frame("a")], wait_s=0.01) == 1
    stream.now += 100 * STALE_S
    stream.take(1000)
    assert (stream.got, stream.dropped) == (frame("a"), 0)


def test_frames_are_taken_as_long_as_there_is_room() -> None:
    stream = Stream()
    frames = [frame("x", 1000)] * 400
    taken = stream.outbox.offer(frames)
    assert taken == LIMIT_BYTES // 1000
    stream.take(10**9)
    assert stream.got == b"".join(frames[:taken])


def test_any_pattern_of_writes_and_waits_gives_whole_frames_and_counts_the_others() -> None:
    for seed in range(200):
        chooser, stream = random.Random(seed), Stream()
        sent: list[bytes] = []
        for number in itertools.count():
            if number == 60:
                break
            sent.append(number.to_bytes(2, "little") * chooser.randint(5, 140))
            assert stream.outbox.offer([sent[-1]]) == 1
            stream.now += chooser.choice((0.0, 0.5, 3.0))
            if chooser.random() < 0.5:
                stream.take(chooser.randint(0, 600))
        stream.take(10**6)
        at, found = 0, 0
        for whole in sent:
            if stream.got.startswith(whole, at):
                at += len(whole)
                found += 1
        assert at == len(stream.got)
        assert found + stream.dropped == len(sent)


def test_nothing_is_written_behind_the_close() -> None:
    stream = Stream()
    stream.outbox.offer([frame("a")])
    stream.outbox.close()
    stream.take(1000)
    assert stream.outbox.offer([frame("b")], wait_s=0.05) == 0
    assert stream.got == b""


def test_the_close_waits_for_a_write_that_has_begun() -> None:
    # Or the stream would be closed under it, and the bytes go to whatever file has its number then.
    writing, go = threading.Event(), threading.Event()

    def write(data: memoryview) -> int:
        writing.set()
        go.wait(PATIENCE_S)
        return len(data)

    outbox = Outbox(write, lambda count: None, lambda count: None)
    sender = threading.Thread(target=outbox.offer, args=([b"command"],))
    closer = threading.Thread(target=outbox.close)
    sender.start()
    assert writing.wait(PATIENCE_S)
    closer.start()
    closer.join(0.1)
    assert closer.is_alive()
    go.set()
    for thread in (sender, closer):
        thread.join(60.0)
        assert not thread.is_alive()


def test_a_device_that_is_lost_ends_its_outbox_before_it_is_closed(tmp_path: Path) -> None:
    device = tmp_path / "ttyUSB0"
    with plugged(device), closing(open_link(str(device))) as link:
        assert isinstance(link, SerialLink)
        connected(link)
        outbox = link._outbox
        assert outbox is not None
        assert outbox.offer([b"taken"]) == 1
        link._lose("unplugged")
        assert outbox.offer([b"not taken"]) == 0


def test_frames_for_a_device_that_is_not_there_are_no_errors(tmp_path: Path) -> None:
    with closing(open_link(f"{tmp_path}/ttyACM*")) as link:
        for _ in range(10):
            link.send(b"heartbeat")
            link.send_frames([b"one", b"two"])
        assert link.counters.send_errors == 0


def test_a_baud_rate_that_the_system_refuses_is_one_line(tmp_path: Path) -> None:
    device = tmp_path / "ttyUSB0"
    with plugged(device), closing(open_link(f"{device},99999999999")) as link:
        wait_until(lambda: link.receive(0.01) is None and link.problem)
        assert not link.connected
        assert "99999999999 baud" in link.problem
        assert "\n" not in link.problem
