"""MCAP records that are written and read one at a time (mcap.dev/spec, "Records"); little-endian, in file order."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

MAGIC = b"\x89MCAP0\r\n"
LIBRARY = "flight-model-ground-station"

HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(9, 16)


@dataclass(frozen=True)
class Schema:
    """A message definition."""

    id: int
    name: str
    encoding: str
    text: str


@dataclass(frozen=True)
class Channel:
    """One stream of messages of one schema."""

    id: int
    schema_id: int
    topic: str
    encoding: str
    metadata: Mapping[str, str]


@dataclass(frozen=True)
class Attachment:
    """A file inside the recording; log_time in ns, UTC."""

    name: str
    media_type: str
    log_time: int
    data: bytes


@dataclass(frozen=True)
class ChunkInfo:
    """One chunk in the file: place and length of the whole record, times in ns, sizes in bytes."""

    offset: int
    length: int
    start_ns: int
    end_ns: int
    compression: str
    compressed_size: int
    uncompressed_size: int


def record_head(opcode: int, length: int) -> bytes:
    """Opcode and length of the content, in front of every record."""
    return struct.pack("<BQ", opcode, length)


def read_record_head(head: bytes) -> tuple[int, int]:
    """Opcode and length of the content from a record's nine bytes in front."""
    opcode, length = struct.unpack("<BQ", head)
    return opcode, length


def record(opcode: int, content: bytes) -> bytes:
    """Opcode, length and content."""
    return record_head(opcode, len(content)) + content


def text(value: str) -> bytes:
    """A string behind its 32-bit length."""
    data = value.encode()
    return struct.pack("<I", len(data)) + data


def mapping(values: Mapping[str, str]) -> bytes:
    """A map of strings behind its 32-bit length in bytes."""
    data = b"".join(text(key) + text(value) for key, value in values.items())
    return struct.pack("<I", len(data)) + data


def header_record(profile: str) -> bytes:
    """Header."""
    return record(HEADER, text(profile) + text(LIBRARY))


def schema_record(schema: Schema) -> bytes:
    """Schema."""
    fields = struct.pack("<H", schema.id) + text(schema.name) + text(schema.encoding) + text(schema.text)
    return record(SCHEMA, fields)


def channel_record(channel: Channel) -> bytes:
    """Channel."""
    fields = struct.pack("<HH", channel.id, channel.schema_id) + text(channel.topic) + text(channel.encoding)
    return record(CHANNEL, fields + mapping(channel.metadata))


def attachment_record(attachment: Attachment) -> bytes:
    """Attachment with its checksum; created when it was logged."""
    content = struct.pack("<QQ", attachment.log_time, attachment.log_time)
    content += text(attachment.name) + text(attachment.media_type)
    content += struct.pack("<Q", len(attachment.data)) + attachment.data
    return record(ATTACHMENT, content + struct.pack("<I", zlib.crc32(content)))


def attachment_index_record(offset: int, length: int, attachment: Attachment) -> bytes:
    """Attachment index."""
    numbers = (offset, length, attachment.log_time, attachment.log_time, len(attachment.data))
    return record(ATTACHMENT_INDEX, struct.pack("<5Q", *numbers) + text(attachment.name) + text(attachment.media_type))


def metadata_record(name: str, values: Mapping[str, str]) -> bytes:
    """Metadata."""
    return record(METADATA, text(name) + mapping(values))


def metadata_index_record(offset: int, length: int, name: str) -> bytes:
    """Metadata index."""
    return record(METADATA_INDEX, struct.pack("<QQ", offset, length) + text(name))


def chunk_record(start_ns: int, end_ns: int, content: memoryview, compression: str, stored: bytes) -> bytes:
    """Chunk of `content`, whose compressed form is `stored`."""
    fields = struct.pack("<QQQI", start_ns, end_ns, len(content), zlib.crc32(content))
    fields += text(compression) + struct.pack("<Q", len(stored))
    return struct.pack("<BQ", CHUNK, len(fields) + len(stored)) + fields + stored


def chunk_index_record(chunk: ChunkInfo, index_offsets: Mapping[int, int], index_length: int) -> bytes:
    """Chunk index. index_offsets: channel -> place in the file of its message index record."""
    content = struct.pack("<4Q", chunk.start_ns, chunk.end_ns, chunk.offset, chunk.length)
    content += struct.pack("<I", 10 * len(index_offsets))
    content += b"".join(struct.pack("<HQ", channel, offset) for channel, offset in index_offsets.items())
    content += struct.pack("<Q", index_length) + text(chunk.compression)
    return record(CHUNK_INDEX, content + struct.pack("<QQ", chunk.compressed_size, chunk.uncompressed_size))


def statistics_record(
    schemas: int,
    attachments: int,
    metadata: int,
    chunks: int,
    start_ns: int,
    end_ns: int,
    channel_counts: Mapping[int, int],
) -> bytes:
    """Statistics. channel_counts: channel -> messages."""
    total = sum(channel_counts.values())
    numbers = (total, schemas, len(channel_counts), attachments, metadata, chunks, start_ns, end_ns)
    content = struct.pack("<QHIIIIQQI", *numbers, 10 * len(channel_counts))
    content += b"".join(struct.pack("<HQ", channel, count) for channel, count in channel_counts.items())
    return record(STATISTICS, content)


def summary_section(groups: list[tuple[int, bytes]], start: int) -> bytes:
    """Summary, summary offsets, footer and closing magic. groups: (opcode, records); start: place in the file."""
    body = b""
    offsets = b""
    for opcode, records in groups:
        if records:
            offsets += record(SUMMARY_OFFSET, struct.pack("<BQQ", opcode, start + len(body), len(records)))
            body += records
    footer = struct.pack("<BQQQ", FOOTER, 20, start, start + len(body))
    checksum = zlib.crc32(body + offsets + footer)
    return body + offsets + footer + struct.pack("<I", checksum) + MAGIC


class Cursor:
    """Reads the fields of one record's content; ValueError where it ends too early or is no text."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def numbers(self, form: str) -> tuple[int, ...]:
        """Integers by a struct format without the byte order."""
        size = struct.calcsize("<" + form)
        return struct.unpack("<" + form, self.take(size))

    def take(self, size: int) -> bytes:
        """The next `size` bytes."""
        if self._at + size > len(self._data):
            raise ValueError("record is too short")
        self._at += size
        return self._data[self._at - size : self._at]

    def text(self) -> str:
        """A string."""
        return self.take(self.numbers("I")[0]).decode()

    def mapping(self) -> dict[str, str]:
        """A map of strings."""
        inner = Cursor(self.take(self.numbers("I")[0]))
        values = {}
        while inner._at < len(inner._data):
            key = inner.text()
            values[key] = inner.text()
        return values


def read_schema(content: bytes) -> Schema:
    """Schema from a record's content."""
    cursor = Cursor(content)
    return Schema(cursor.numbers("H")[0], cursor.text(), cursor.text(), cursor.text())


def read_channel(content: bytes) -> Channel:
    """Channel from a record's content."""
    cursor = Cursor(content)
    identity, schema = cursor.numbers("HH")
    return Channel(identity, schema, cursor.text(), cursor.text(), cursor.mapping())


def read_attachment(content: bytes) -> Attachment:
    """Attachment from a record's content; ValueError if its checksum is wrong."""
    cursor = Cursor(content)
    log_time, _ = cursor.numbers("QQ")
    name, media_type = cursor.text(), cursor.text()
    data = cursor.take(cursor.numbers("Q")[0])
    (checksum,) = cursor.numbers("I")
    if checksum and checksum != zlib.crc32(content[:-4]):
        raise ValueError("attachment has a wrong checksum")
    return Attachment(name, media_type, log_time, data)


def read_metadata(content: bytes) -> tuple[str, dict[str, str]]:
    """Name and values of a metadata record."""
    cursor = Cursor(content)
    return cursor.text(), cursor.mapping()


def read_chunk_head(content: bytes, offset: int, length: int) -> tuple[ChunkInfo, int, int]:
    """A chunk's fields in front of its data, from the beginning of its record: info, checksum, place of its data."""
    cursor = Cursor(content)
    start_ns, end_ns, size, checksum = cursor.numbers("QQQI")
    compression = cursor.text()
    (stored,) = cursor.numbers("Q")
    info = ChunkInfo(offset, length, start_ns, end_ns, compression, stored, size)
    return info, checksum, offset + 9 + cursor._at


def read_chunk_index(content: bytes) -> ChunkInfo:
    """Chunk index from a record's content, without the offsets of message indexes."""
    cursor = Cursor(content)
    start_ns, end_ns, offset, length = cursor.numbers("4Q")
    cursor.take(cursor.numbers("I")[0])
    cursor.numbers("Q")
    compression = cursor.text()
    stored, size = cursor.numbers("QQ")
    return ChunkInfo(offset, length, start_ns, end_ns, compression, stored, size)


def read_index_channels(content: bytes) -> frozenset[int]:
    """Channels that a chunk's message indexes name, from its chunk index; empty where it has none."""
    cursor = Cursor(content)
    cursor.numbers("4Q")
    pairs = cursor.take(cursor.numbers("I")[0])
    return frozenset(channel for channel, _ in struct.iter_unpack("<HQ", pairs[: len(pairs) // 10 * 10]))


def read_statistics(content: bytes) -> dict[int, int]:
    """Channel -> number of messages."""
    cursor = Cursor(content)
    cursor.numbers("QHIIIIQQ")
    pairs = Cursor(cursor.take(cursor.numbers("I")[0]))
    counts = {}
    while pairs._at < len(pairs._data):
        channel, count = pairs.numbers("HQ")
        counts[channel] = count
    return counts
