"""MCAP records (mcap.dev/spec, "Records"), by the library `mcap`: here is what it does not do, or not fast enough."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from io import BytesIO

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Footer, McapRecord, SummaryOffset

MAGIC = b"\x89MCAP0\r\n"
LIBRARY = "flight-model-ground-station"
#: Opcode and length of the content, in front of every record.
HEAD = struct.Struct("<BQ")


@dataclass(frozen=True)
class ChunkInfo:
    """One chunk in the file: place and length of the whole record, times in ns, sizes in bytes.

    bare: it is none, but records of messages behind one another that stand in no chunk, and is read like one.
    """

    offset: int
    length: int
    start_ns: int
    end_ns: int
    compression: str
    compressed_size: int
    uncompressed_size: int
    bare: bool = False


class Content(ReadDataStream):
    """One record's content, for the library's readers; ValueError, and no other, where it ends too early."""

    def __init__(self, content: bytes) -> None:
        super().__init__(BytesIO(content))
        self._size = len(content)

    def read(self, length: int) -> bytes:
        """The next `length` bytes."""
        if length > self._size - self.count:
            raise ValueError("record is too short")
        return super().read(length)


def packed(*records: McapRecord) -> bytes:
    """Records as they stand in a file."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def chunk_record(start_ns: int, end_ns: int, content: memoryview, compression: str, stored: bytes) -> bytes:
    """Chunk of `content`, whose compressed form is `stored`; the library's copies that several times."""
    name = compression.encode()
    fields = struct.pack("<QQQII", start_ns, end_ns, len(content), zlib.crc32(content), len(name))
    fields += name + struct.pack("<Q", len(stored))
    return HEAD.pack(Opcode.CHUNK, len(fields) + len(stored)) + fields + stored


def summary_section(groups: list[bytes], start: int) -> bytes:
    """Summary, summary offsets, footer and closing magic. groups: records of one kind; start: place in the file."""
    body = b""
    offsets = b""
    for group in filter(None, groups):
        offsets += packed(SummaryOffset(group[0], start + len(body), len(group)))
        body += group
    place = start + len(body)
    checksum = zlib.crc32(body + offsets + packed(Footer(start, place, 0))[:-4])
    return body + offsets + packed(Footer(start, place, checksum)) + MAGIC


def read_attachment(content: bytes) -> Attachment:
    """Attachment from a record's content; ValueError if its checksum, which the library passes over, is wrong."""
    stream = Content(content)
    attachment: Attachment = Attachment.read(stream)
    checksum = int.from_bytes(content[stream.count - 4 : stream.count], "little")
    if checksum and checksum != zlib.crc32(content[: stream.count - 4]):
        raise ValueError("attachment has a wrong checksum")
    return attachment


def read_chunk_head(content: bytes, offset: int, length: int) -> tuple[ChunkInfo, int, int]:
    """A chunk's fields in front of its data, from the beginning of its record: info, checksum, place of its data.

    The library reads a chunk with all its data only.
    """
    stream = Content(content)
    start_ns, end_ns, size, checksum = struct.unpack("<QQQI", stream.read(28))
    compression = stream.read_prefixed_string()
    info = ChunkInfo(offset, length, start_ns, end_ns, compression, stream.read8(), size)
    return info, checksum, offset + HEAD.size + stream.count


def read_chunk_index(content: bytes) -> tuple[ChunkInfo, frozenset[int]]:
    """Chunk index from a record's content, and the channels that its message indexes name; empty where it has none.

    The library's reader takes the names one by one: a large file has millions.
    """
    stream = Content(content)
    start_ns, end_ns, offset, length, size = struct.unpack("<QQQQI", stream.read(36))
    named = stream.read(size)
    stream.read(8)  # length of the message indexes
    compression = stream.read_prefixed_string()
    info = ChunkInfo(offset, length, start_ns, end_ns, compression, *struct.unpack("<QQ", stream.read(16)))
    return info, frozenset(channel for channel, _ in struct.iter_unpack("<HQ", named[: size // 10 * 10]))
