"""One recording of some links, on a clock that the test holds."""

from pathlib import Path

from traffic import SECOND, Vehicle, batch
from wire_streams import wire_streams

from gcs.mavlink.dialect import Dialect
from gcs.recording.reader import Recording
from gcs.station.capture import Capture

START = 1_800_000_000 * SECOND
DIALECT = Dialect.load()


def stream_of(paths: list[Path], link: str) -> bytes:
    return b"".join(data for path in paths for _, data in wire_streams(Recording(path)).get(link, []))


def test_the_half_frame_of_a_link_that_fell_silent_is_recorded_after_a_second(tmp_path: Path) -> None:
    vehicle, capture = Vehicle(), Capture(tmp_path / "a.mcap", DIALECT)
    frame, half = vehicle.attitude(1.0), vehicle.attitude(1.0)[:15]
    capture.take("udp", batch([frame, half], START))
    capture.tick(START + SECOND)
    assert capture.bytes == len(frame)
    capture.tick(START + 3 * SECOND)
    assert capture.bytes == len(frame + half)
    capture.close(START + 4 * SECOND)
    assert stream_of(capture.parts, "udp") == frame + half


def test_after_the_end_nothing_is_taken_and_nothing_counted(tmp_path: Path) -> None:
    vehicle, capture = Vehicle(), Capture(tmp_path / "a.mcap", DIALECT)
    sent = vehicle.second()
    capture.take("udp", batch(sent, START))
    capture.close(START + SECOND)
    capture.take("udp", batch(vehicle.second(), START + SECOND))
    capture.tick(START + 5 * SECOND)
    assert capture.problem is None
    assert capture.bytes == len(b"".join(sent))
    assert stream_of(capture.parts, "udp") == b"".join(sent)


def test_a_clock_set_back_begins_one_part_for_all_links(tmp_path: Path) -> None:
    vehicle, capture = Vehicle(), Capture(tmp_path / "a.mcap", DIALECT)
    sent = {"udp": b"", "serial": b""}
    for now in (START, START + SECOND, START - 60 * SECOND, START - 59 * SECOND):
        for link in sent:
            datagrams = vehicle.second()
            sent[link] += b"".join(datagrams)
            capture.take(link, batch(datagrams, now))
        capture.tick(now + SECOND)
    capture.close(START - 58 * SECOND)
    assert [path.name for path in capture.parts] == ["a.mcap", "a.part2.mcap"]
    for link, data in sent.items():
        assert stream_of(capture.parts, link) == data
    before, after = map(Recording, capture.parts)
    assert before.start_ns == START
    assert after.start_ns >= START - 60 * SECOND
    assert after.end_ns < START
    assert sum(after.counts().values()) == sum(before.counts().values()) == 4 * 52
