"""Files of another writer, whole and cut off: every message that another reader finds is found here too."""

import contextlib
import io
import struct
from pathlib import Path

import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer

from gcs.recording.container import Container
from gcs.recording.repair import repair

MESSAGES = 300
Found = list[tuple[int, int, int, int, bytes]]
NOTHING_AT_THE_END = {
    "index_types": IndexType.NONE,
    "repeat_channels": False,
    "repeat_schemas": False,
    "use_statistics": False,
    "use_summary_offsets": False,
}
KINDS: dict[str, dict[str, object]] = {
    "indexed": {},
    "lz4": {"compression": CompressionType.LZ4},
    "not compressed": {"compression": CompressionType.NONE},
    "no index": {"index_types": IndexType.NONE},
    "no summary": NOTHING_AT_THE_END,
    "no checksums": {"enable_crcs": False},
    "no chunks": {"use_chunking": False},
    "no chunks, no summary": {"use_chunking": False, **NOTHING_AT_THE_END},
}


def written(path: Path, **settings: object) -> bytes:
    """A file of messages of three channels, the third described in its middle; its bytes."""
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=2000, **settings)  # type: ignore[arg-type]
        writer.start("ros2")
        channels: list[int] = []
        for i in range(MESSAGES):
            if i in (0, 1, MESSAGES // 2):
                schema = writer.register_schema(f"a/msg/B{i}", "ros2msg", b"uint8[] c\n")
                channels.append(writer.register_channel(f"/b{i}", "cdr", schema, {"number": str(i)}))
            writer.add_message(channels[i % len(channels)], 10**18 + i, bytes(i % 50), 10**18 + i // 2, sequence=i)
        writer.finish()
    return path.read_bytes()


def streamed(data: bytes) -> Found:
    """What mcap's stream reader yields before it raises."""
    found = []
    with contextlib.suppress(McapError, struct.error):
        for entry in StreamReader(io.BytesIO(data), validate_crcs=True).records:
            if isinstance(entry, Message):
                found.append((entry.channel_id, entry.sequence, entry.log_time, entry.publish_time, entry.data))
    return found


def ours(container: Container) -> Found:
    found = []
    for group in container.groups():
        for channel, sequence, log, publish, at, size in group.rows.tolist():
            found.append((channel, sequence, log, publish, group.data[at : at + size].tobytes()))
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_a_whole_file_holds_what_other_readers_find_in_it(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    data = written(path, **KINDS[kind])
    container = Container(path)
    found = ours(container)
    assert found == streamed(data)
    assert len(found) == MESSAGES
    assert not container.damage
    assert container.damage.notes == []
    with open(path, "rb") as file:
        for schema, channel, message in NonSeekingReader(file).iter_messages():
            assert container.channels[message.channel_id] == channel
            assert container.schemas[channel.schema_id] == schema


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_cut_off_anywhere_holds_what_another_reader_finds_in_it(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    data = written(path, **KINDS[kind])
    counts = set()
    first = next(length for length in range(len(data)) if streamed(data[:length]))
    for length in range(first, len(data), 61):
        path.write_bytes(data[:length])
        container = Container(path)
        found = ours(container)
        assert found == streamed(data[:length])
        assert not container.damage.inside
        counts.add(len(found))
    assert len(counts) > 3


@pytest.mark.parametrize("kind", ["no index", "no chunks"])
def test_a_repaired_file_of_another_writer_has_an_index_and_all_messages(kind: str, tmp_path: Path) -> None:
    path, new = tmp_path / "a.mcap", tmp_path / "b.mcap"
    data = written(path, **KINDS[kind])
    path.write_bytes(data[: len(data) * 2 // 3])
    kept = streamed(path.read_bytes())
    assert not repair([path], new).inside
    assert streamed(new.read_bytes()) == kept
    with open(new, "rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(kept) > MESSAGES // 3
        assert sum(1 for _ in make_reader(file).iter_messages(topics=["/b1"])) == sum(entry[0] == 2 for entry in kept)
