"""Reading a part of a recording touches that part alone, gives the same values, and needs little memory."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mavlink_frames import Sender

from gcs.errors import RecordingError
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Framer, scan
from gcs.recording.container import Container
from gcs.recording.reader import MessageColumns, Recording
from gcs.recording.records import ChunkInfo
from gcs.recording.writer import McapWriter

START = 1_790_000_000_000_000_000
SECOND = 1_000_000_000


def record(path: Path, pieces: list[tuple[int, str, bytes]]) -> None:
    """(time of reception in ns, link, bytes) as a recording."""
    dialect = Dialect.load()
    framers: dict[str, Framer] = {}
    with McapWriter(path, dialect) as writer:
        for at, link, data in pieces:
            buffer, frames = framers.setdefault(link, Framer(dialect)).feed(data)
            writer.write(link, buffer, frames, at)


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """A minute at 20 Hz: ATTITUDE over two links 300 ms apart, parameters in the first second only."""
    sender, pieces = Sender(seed=4), []
    for i in range(1200):
        at = START + i * SECOND // 20
        frame = sender.send("ATTITUDE", time_boot_ms=50 * i).frame
        pieces += [(at, "radio", frame), (at + 3 * SECOND // 10, "wifi", frame)]
        if i < 10:
            pieces.append((at, "radio", sender.send("PARAM_VALUE").frame))
        if i % 20 == 0:
            pieces.append((at, "radio", sender.send("HEARTBEAT").frame))
    path = tmp_path / "flight.mcap"
    record(path, sorted(pieces, key=lambda piece: piece[0]))
    return path


@pytest.fixture
def decompressed(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Offsets of the chunks that were decompressed, as it happens."""
    seen: list[int] = []
    usual = Container._decompress

    def counted(self: Container, chunk: ChunkInfo, stored: bytes) -> bytes:
        seen.append(chunk.offset)
        return usual(self, chunk, stored)

    monkeypatch.setattr(Container, "_decompress", counted)
    return seen


def same(one: MessageColumns, other: MessageColumns) -> bool:
    pairs = ((one.log_time, other.log_time), (one.publish_time, other.publish_time), (one.sequence, other.sequence))
    return all(np.array_equal(a, b) for a, b in pairs) and one.fields.tobytes() == other.fields.tobytes()


def test_a_time_range_decompresses_its_own_chunks_only(flight: Path, decompressed: list[int]) -> None:
    recording = Recording(flight)
    chunks = len(recording._file.chunks)
    assert chunks >= 55
    low, high = START + 30 * SECOND, START + 33 * SECOND
    (part,) = recording.columns("ATTITUDE", start_ns=low, end_ns=high)
    # The range, and the two seconds in front of it from which a second link may repeat.
    assert len(decompressed) <= 8
    assert decompressed == sorted(set(decompressed))
    (whole,) = Recording(flight).columns("ATTITUDE")
    assert len(whole) == 1200
    inside = (whole.log_time >= low) & (whole.log_time <= high)
    assert np.count_nonzero(inside) == 61
    assert part["time_boot_ms"].tolist() == whole["time_boot_ms"][inside].tolist()


def test_a_topic_decompresses_the_chunks_that_hold_it_only(flight: Path, decompressed: list[int]) -> None:
    (parameters,) = Recording(flight).columns("PARAM_VALUE")
    assert len(parameters) == 10
    assert len(decompressed) == 1


def test_many_small_selections_cost_no_more_than_the_file_twice(flight: Path, decompressed: list[int]) -> None:
    recording = Recording(flight)
    chunks = len(recording._file.chunks)
    for second in range(60):
        recording.columns("ATTITUDE", start_ns=START + second * SECOND, end_ns=START + (second + 1) * SECOND)
    assert len(decompressed) <= 2 * chunks


def test_a_file_without_its_end_gives_the_same_range(flight: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    whole = flight.read_bytes()
    cut.write_bytes(whole[: len(whole) * 9 // 10])
    low, high = START + 20 * SECOND, START + 21 * SECOND
    (expected,) = Recording(flight).columns("ATTITUDE", start_ns=low, end_ns=high)
    (found,) = Recording(cut).columns("ATTITUDE", start_ns=low, end_ns=high)
    assert len(expected) == 21
    assert same(found, expected)


@pytest.mark.parametrize("group_bytes", [1, 20_000, 1 << 30])
def test_parts_add_up_to_the_whole_however_the_file_is_cut(flight: Path, group_bytes: int) -> None:
    (whole,) = Recording(flight).columns("ATTITUDE")
    parts = list(Recording(flight).iter_columns("ATTITUDE", group_bytes=group_bytes))
    assert (len(parts) > 3) == (group_bytes < 1 << 30)
    for name in ("log_time", "publish_time", "sequence", "fields"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert np.array_equal(joined, getattr(whole, name))


def test_chosen_fields_have_the_same_values(flight: Path) -> None:
    recording = Recording(flight)
    (whole,) = recording.columns("PARAM_VALUE")
    (part,) = recording.columns("PARAM_VALUE", fields=("param_id", "param_value"))
    assert part.fields.dtype.names == ("param_id", "param_value")
    assert np.array_equal(part["param_value"], whole["param_value"], equal_nan=True)
    assert part.text("param_id").tolist() == whole.text("param_id").tolist()
    with pytest.raises(RecordingError, match="no field wheels; it has"):
        recording.columns("PARAM_VALUE", fields=("wheels",))


READER = """
import sys
from gcs.recording.reader import Recording

def private_kib():
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("RssAnon"))

recording = Recording(sys.argv[1])
for part in recording.iter_columns("HEARTBEAT", group_bytes=4 << 20):  # what is compiled is loaded
    break
before = peak = private_kib()
count = 0
for part in recording.iter_columns("ATTITUDE", fields=("roll",), group_bytes=4 << 20):
    count += len(part)
    peak = max(peak, private_kib())
print(count, peak - before)
"""


def test_one_topic_of_a_large_file_is_read_in_little_memory(tmp_path: Path) -> None:
    dialect = Dialect.load()
    sender = Sender(seed=9)
    block = b"".join(sender.send(name).frame for _ in range(1000) for name in ("ATTITUDE", "HIGHRES_IMU"))
    block += sender.send("HEARTBEAT").frame
    buffer = np.frombuffer(block, np.uint8)
    frames = scan(buffer, dialect, final=True)
    path = tmp_path / "large.mcap"
    blocks = 1000
    with McapWriter(path, dialect) as writer:
        for i in range(blocks):
            writer.write("udp", buffer, frames, START + i * SECOND)
    content = sum(chunk.uncompressed_size for chunk in Recording(path)._file.chunks)
    assert content > 150 << 20
    out = subprocess.run([sys.executable, "-c", READER, str(path)], capture_output=True, text=True, check=True).stdout
    count, grown_kib = map(int, out.split())
    assert count == 1000 * blocks
    assert grown_kib << 10 < content // 3
