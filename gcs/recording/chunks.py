"""Chunks of an MCAP file: their content, checked, and where the next whole one is when the records are damaged."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import replace

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode
from numpy.typing import NDArray

from gcs.recording import records
from gcs.recording.records import ChunkInfo
from gcs.recording.scan import next_chunk_head
from gcs.text.sizes import size_text

#: Uncompressed bytes of a chunk beyond which it is treated as damaged, or as an attack.
LARGEST_CHUNK = 256 << 20
# A search gives up once chunks that turned out to be none held this many bytes, and some for each byte searched.
_SEARCH_BYTES = 64 << 20
_SEARCH_SHARE = 8
_RECORD_HEAD = records.HEAD.size
_LONGEST_HEAD = 4096

Bytes = NDArray[np.uint8]
Decompress = Callable[[ChunkInfo, bytes], bytes]


def decompress(chunk: ChunkInfo, stored: bytes) -> bytes:
    """What a chunk's stored bytes hold; of more than it announces one byte more at most, and not the rest.

    ValueError, RuntimeError or zstandard.ZstdError if they are not what was written.
    """
    size = chunk.uncompressed_size
    if chunk.compression == "zstd":
        announced = zstandard.get_frame_parameters(stored).content_size
        if announced not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise ValueError("a chunk's lengths are damaged")
        return zstandard.ZstdDecompressor().decompress(stored, max_output_size=size, allow_extra_data=False)
    if chunk.compression == "lz4":
        frame = lz4.frame.LZ4FrameDecompressor()
        data = bytes(frame.decompress(stored, max_length=size + 1))
        if frame.unused_data:
            raise ValueError("a chunk's lengths are damaged")
        return data
    if chunk.compression == "":
        return stored
    raise ValueError(f"compression {chunk.compression!r} is not known")


def checked_content(file: Bytes, chunk: ChunkInfo, unpack: Decompress = decompress) -> bytes:
    """The content of a chunk of the file; ValueError, with what is wrong, if it is not what was written."""
    if chunk.bare:
        return file[chunk.offset : chunk.offset + chunk.length].tobytes()
    info, checksum, at = _head(file, chunk.offset, chunk.length)
    if at + info.compressed_size > chunk.offset + chunk.length:
        raise ValueError("a chunk's lengths are damaged")
    if info.uncompressed_size > LARGEST_CHUNK:
        raise ValueError(f"a chunk of more than {size_text(LARGEST_CHUNK)}")
    try:
        data = unpack(info, file[at : at + info.compressed_size].tobytes())
    except (RuntimeError, zstandard.ZstdError) as error:
        raise ValueError(str(error)) from None
    if len(data) != info.uncompressed_size or (checksum and zlib.crc32(data) != checksum):
        raise ValueError("a chunk's checksum is wrong")
    return data


def find_chunk(file: Bytes, start: int, stop: int) -> tuple[ChunkInfo | None, int]:
    """The first whole chunk in file[start:stop], and how many that looked like one were none.

    Its opcode and the length of its record may be damaged; its own lengths, and its checksum if it has one, are right.
    """
    budget = _SEARCH_BYTES + _SEARCH_SHARE * (stop - start)
    wrong = 0
    at = start
    while budget > 0 and (at := int(next_chunk_head(file, at, stop, LARGEST_CHUNK))) >= 0:
        info, checksum, data_at = _head(file, at, stop - at)
        length = data_at + info.compressed_size - at
        chunk = replace(info, length=length)
        named = records.HEAD.pack(Opcode.CHUNK, length - _RECORD_HEAD)
        try:
            if not checksum and file[at : at + _RECORD_HEAD].tobytes() != named:
                raise ValueError("nothing says that this is a chunk")
            checked_content(file, chunk)
        except ValueError:
            wrong += 1
            budget -= info.compressed_size + info.uncompressed_size
            at += 1
        else:
            return chunk, wrong
    return None, wrong


def is_cut_off(file: Bytes, start: int, stop: int) -> bool:
    """Whether file[start:stop] is what an interrupted write leaves: the beginning of one record, or zeros."""
    rest = file[start:stop]
    if rest.size < _RECORD_HEAD or not rest.any():
        return True
    opcode, length = records.HEAD.unpack(rest[:_RECORD_HEAD].tobytes())
    if not Opcode.HEADER <= opcode <= Opcode.DATA_END or length <= rest.size - _RECORD_HEAD:
        return False
    if opcode != Opcode.CHUNK:
        return True
    try:
        info, _, at = _head(file, start, stop - start)
    except ValueError:
        return True
    return bool(at + info.compressed_size == start + _RECORD_HEAD + length)


def _head(file: Bytes, offset: int, length: int) -> tuple[ChunkInfo, int, int]:
    head = file[offset + _RECORD_HEAD : offset + min(length, _LONGEST_HEAD)].tobytes()
    return records.read_chunk_head(head, offset, length)
