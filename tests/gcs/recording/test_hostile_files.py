"""Files made to mislead a reader: refused in one line, without touching memory that is not theirs or filling it."""

import tracemalloc
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Message, Schema
from mcap.writer import CompressionType, Writer
from wire_streams import wire_streams

from gcs.errors import RecordingError
from gcs.recording import records
from gcs.recording.chunks import find_chunk
from gcs.recording.container import Container
from gcs.recording.reader import Recording
from gcs.recording.repair import complete
from gcs.recording.wire import WIRE_SCHEMA, WIRE_SCHEMA_NAME, WIRE_TOPIC, encode_wire

HEAD = {"link": "udp", "system": "1", "component": "1", "crc_extra": "7", "text_fields": ""}
BOMB_BYTES = 64 << 20


def crafted(
    path: Path, definition: str, form: list[int], runs: list[tuple[int, int, int, int]], run_bytes: bytes, **head: str
) -> Path:
    """A recording with one message of that definition per form, and the account of the link's bytes as given."""
    with open(path, "wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("ros2")
        about = {"message": "A", "message_id": "1", "base_length": "4", "dialect": "x", **HEAD, **head}
        message = writer.register_channel(
            "/mavlink/1/1/A", "cdr", writer.register_schema("mavlink/msg/A", "ros2msg", definition.encode()), about
        )
        wire = writer.register_channel(
            WIRE_TOPIC,
            "cdr",
            writer.register_schema(WIRE_SCHEMA_NAME, "ros2msg", WIRE_SCHEMA.encode()),
            {"link": "udp"},
        )
        for _ in form:
            writer.add_message(message, 1, bytes((0, 1, 0, 0)) + bytes(8), 1)
        account = np.array(runs, np.int64).reshape(-1, 4)
        data = encode_wire(0, 1, np.array(form, np.uint8), account, np.frombuffer(run_bytes, np.uint8))
        writer.add_message(wire, 1, data, 1)
        writer.finish()
    return path


def rebuilt(path: Path) -> bytes:
    return b"".join(data for stream in wire_streams(Recording(path)).values() for _, data in stream)


def test_a_well_made_file_of_the_same_kind_is_rebuilt(tmp_path: Path) -> None:
    explicit = bytes((0xFD, 6, 1, 0, 8, 9)) + bytes(range(13))
    path = crafted(tmp_path / "a.mcap", "uint32 x\n", [0, 2], [(0, 0, 1, 0), (1, 2, 19, 0)], b"!" + explicit)
    data = rebuilt(path)
    assert data[:3] == b"!\xfd\x01"
    assert data.endswith(bytes(range(13)))
    assert len(data) == 1 + (10 + 1 + 2) + (10 + 6 + 2 + 13)


@pytest.mark.parametrize(
    "definition",
    [
        "uint8[60000] x\n",
        "".join(f"uint8 a{i}\nuint64 b{i}\n" for i in range(9)),
        "uint8 x\nuint8 x\n",
        "string x\n",
        "# nothing\n",
    ],
)
def test_definitions_that_no_message_has_are_refused(definition: str, tmp_path: Path) -> None:
    recording = Recording(crafted(tmp_path / "a.mcap", definition, [0], [], b""))
    for read in (lambda: list(recording.wire_pieces()), lambda: recording.columns("A")):
        with pytest.raises(RecordingError, match=r"\A[^\n]+\Z"):
            read()


@pytest.mark.parametrize(
    ("form", "runs", "run_bytes"),
    [
        ([2], [], b""),
        ([2], [(0, 2, 3, 0)], b"\xfd\x04\x00"),
        ([2], [(0, 2, 4, 0)], b"\xfd\xff\x00\x00"),
        ([2], [(0, 2, 4, 0)], b"\xfd\x04\x01\x00"),
        ([2], [(1, 2, 4, 0)], b"\xfd\x04\x00\x00"),
        ([0], [(7, 0, 1, 0)], b"x"),
        ([0, 0], [(1, 0, 1, 0), (0, 0, 1, 0)], b"xy"),
    ],
)
def test_accounts_of_a_link_that_do_not_fit_are_refused(
    form: list[int], runs: list[tuple[int, int, int, int]], run_bytes: bytes, tmp_path: Path
) -> None:
    path = crafted(tmp_path / "a.mcap", "uint32 x\n", form, runs, run_bytes)
    with pytest.raises(RecordingError, match="cannot be rebuilt: their account is damaged"):
        rebuilt(path)


@pytest.mark.parametrize("field", ["system", "message_id", "base_length", "crc_extra"])
def test_numbers_of_a_channel_that_no_message_has_make_it_none(field: str, tmp_path: Path) -> None:
    path = crafted(tmp_path / "a.mcap", "uint32 x\n", [1], [], b"", **{field: "99999999999999999999"})
    assert Recording(path).messages() == ()
    with pytest.raises(RecordingError, match="cannot be rebuilt"):
        rebuilt(path)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize("announced", [1000, 1 << 40])
def test_a_chunk_takes_no_more_memory_than_it_announces(compression: str, announced: int, tmp_path: Path) -> None:
    path = crafted(tmp_path / "a.mcap", "uint32 x\n", [1], [], b"")
    first = Container(path).chunks[0]
    whole = path.read_bytes()[: first.offset + first.length]
    pack = zstandard.compress if compression == "zstd" else lz4.frame.compress
    stored = pack(bytes(BOMB_BYTES))
    bomb = bytearray(records.chunk_record(1, 1, memoryview(bytes(1000)), compression, stored))
    bomb[9 + 16 : 9 + 24] = announced.to_bytes(8, "little")
    path.write_bytes(whole + bomb)
    tracemalloc.start()
    try:
        recording = Recording(path)
        assert recording.damage.chunks == 1
        assert sum(recording.counts().values()) == 1
        assert tracemalloc.get_traced_memory()[1] < BOMB_BYTES // 4
    finally:
        tracemalloc.stop()
    assert "damaged inside" in complete(path)
    assert path.read_bytes() == whole + bomb


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_does_not_swallow_what_is_behind_it(compression: str, tmp_path: Path) -> None:
    content = bytes(range(100))
    stored = (zstandard.compress if compression == "zstd" else lz4.frame.compress)(content)
    path = tmp_path / "a"
    for extra in (b"", b"the next chunk"):
        path.write_bytes(records.chunk_record(1, 1, memoryview(content), compression, stored + extra))
        found, wrong = find_chunk(np.fromfile(path, np.uint8), 0, path.stat().st_size)
        assert (found is None, wrong) == (bool(extra), len(extra) and 1)


def test_a_file_of_heads_of_chunks_that_are_none_is_given_up_on(tmp_path: Path) -> None:
    path = crafted(tmp_path / "a.mcap", "uint32 x\n", [1], [], b"")
    first = Container(path).chunks[0]
    whole = path.read_bytes()[: first.offset + first.length]
    heads = b""
    for behind in range(20000, 0, -1):
        size = (behind - 1) * 49 + 1
        head = (1).to_bytes(8, "little") * 2 + size.to_bytes(8, "little") + b"\1\2\3\4" + bytes(4)
        heads += records.HEAD.pack(Opcode.CHUNK, 1) + head + size.to_bytes(8, "little")
    path.write_bytes(whole + heads + b"\0")
    recording = Recording(path)
    assert sum(recording.counts().values()) == 1
    assert "no whole chunk is behind it" in recording.damage.inside


def test_attachments_are_read_when_they_are_asked_for(tmp_path: Path) -> None:
    path = crafted(tmp_path / "a.mcap", "uint32 x\n", [1], [], b"")
    data = path.read_bytes()
    first = Container(path).chunks[0].offset
    attached = bytearray(records.packed(Attachment(1, 1, "a", "b", b"c" * 100)))
    attached[-20] ^= 1
    path.write_bytes(data[:first] + bytes(attached) + data[first : first + Container(path).chunks[0].length])
    container = Container(path)
    assert not container.damage.inside
    assert container.attachments == []
    assert "checksum" in container.damage.inside


@pytest.mark.parametrize(
    "bad",
    [
        records.HEAD.pack(Opcode.SCHEMA, 6) + b"\1\0\xff\0\0\0",
        records.HEAD.pack(Opcode.CHANNEL, 16) + b"\2\0\1\0" + b"\xff" * 12,
        records.HEAD.pack(Opcode.CHANNEL, 0),
        records.packed(Schema(2, b"\xff", "ros2msg", "a")),
    ],
)
def test_a_definition_that_is_none_costs_itself_alone(bad: bytes, tmp_path: Path) -> None:
    content = records.packed(Schema(1, b"\xff\0", "protobuf", "b"), Channel(1, "/b", "protobuf", {}, 1)) + bad
    content += records.packed(Message(1, 5, b"c", 5, 0))
    path = tmp_path / "a.mcap"
    chunk = records.chunk_record(5, 5, memoryview(content), "", content)
    path.write_bytes(records.MAGIC + records.packed(Header("", "")) + chunk + b"\6")
    container = Container(path)
    assert (list(container.schemas), list(container.channels)) == ([1], [1])
    assert "description of messages in a chunk is damaged" in container.damage.inside
    assert sum(len(group.rows) for group in container.groups()) == 1
