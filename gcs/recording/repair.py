"""Making whole, indexed recordings out of files that were cut off or damaged, or out of the parts of one.

Chunks are copied as they are, once their checksum has been found right; only the index is made anew.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode

from gcs.errors import RecordingError
from gcs.recording.container import Container, Damage
from gcs.recording.joined import JoinedContainer
from gcs.recording.records import HEAD, ChunkInfo, chunk_record
from gcs.recording.scan import list_messages
from gcs.recording.sink import RecordingSink
from gcs.recording.storage import SyncPolicy

#: Behind the name of a file that is being made out of another.
UNFINISHED = ".unfinished"
#: Metadata of a recording that was completed after it had been cut off; its `notes` say what was left out.
COMPLETED = "completed"
# Of a message's record in front of its data: opcode, length, channel, sequence and two times.
_MESSAGE_HEAD = HEAD.size + 22
_WAITING_BYTES = 64 << 20


def repair(sources: Sequence[Path], target: Path, remember: bool = False) -> Damage:
    """Write all that is whole in a recording to `target`; what had to be left out.

    sources: its file, or its parts in order. remember: whether the new file is to say that it was cut off. Raises
    RecordingError if there is nothing in them, or if `target` cannot be written, which is then not there.
    """
    container = JoinedContainer(sources)
    sink = RecordingSink(target, "none", SyncPolicy(at_close=True), 0, 0)
    try:
        for name, values in container.metadata:
            sink.put_metadata(name, values)
        if remember and container.damage.truncated:
            sink.put_metadata(COMPLETED, {"notes": "; ".join(container.damage.notes)})
        for file in container.attachments:
            sink.put_attachment(file)
        copied = sum(_copy_chunks(part, sink, sorted(container.channels)) for part in container.containers)
    finally:
        sink.finish(list(container.schemas.values()), list(container.channels.values()))
        sink.wait()
    try:
        sink.check()
        written = Container(target)
        if written.damage.truncated or sum((written.message_counts or {}).values()) != copied:
            raise RecordingError(f"{target} was not written as it should have been; look after the disk")
    except RecordingError:
        target.unlink(missing_ok=True)
        raise
    return container.damage


def _copy_chunks(container: Container, sink: RecordingSink, channels: list[int]) -> int:
    """Copy the chunks whose content is right; the messages in them that are of one of these channels."""
    copied = waiting = unknown = 0
    for chunk in container.chunks:
        content = container.content_of(chunk)
        if content is None:
            continue
        index = _index(np.frombuffer(content, np.uint8))
        known = np.isin(index[:, 0], channels)
        unknown += len(known) - int(known.sum())
        data = _record(container, chunk, content)
        sink.copy_chunk(data, replace(chunk, length=len(data)), index[known], channels[-1])
        copied += int(known.sum())
        waiting += chunk.length
        if waiting > _WAITING_BYTES:
            sink.flush()
            waiting = 0
    if unknown:
        container.damage.note(f"{unknown} messages are of channels that nothing in the file describes", inside=True)
    return copied


def _record(container: Container, chunk: ChunkInfo, content: bytes) -> bytes:
    """The chunk's record; its opcode and length, which nothing protects, are made anew.

    Messages that stood in no chunk get one.
    """
    if chunk.bare:
        return chunk_record(chunk.start_ns, chunk.end_ns, memoryview(content), "", content)
    fields = container.bytes[chunk.offset + HEAD.size : chunk.offset + chunk.length].tobytes()
    return HEAD.pack(Opcode.CHUNK, len(fields)) + fields


def _index(content: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """(N, 3) channel, log time and place of each message."""
    rows = np.empty((content.size // _MESSAGE_HEAD + 1, 6), np.int64)
    count = int(list_messages(content, 0, content.size, rows, 0))
    index = rows[:count][:, (0, 2, 4)]
    index[:, 2] -= _MESSAGE_HEAD
    return index


def complete(path: Path) -> str:
    """Give a recording that was cut off its index and end, in place; why that was not done, empty if all is well.

    The file is replaced by the whole one only when the disk has that, and only if nothing is left out but the one
    record that was being written. Any other stays as it is: nothing is taken away that might still be saved.
    """
    unfinished = path.with_name(path.name + UNFINISHED)
    try:
        damage = Container(path).damage
        if not damage.truncated:
            return ""
        if not damage.inside:
            damage = repair([path], unfinished)
        if not damage.inside:
            os.replace(unfinished, path)
            return ""
        reason = f", damaged inside: {damage.inside}"
    except (RecordingError, OSError) as error:
        reason = f": {error}"
    with contextlib.suppress(OSError):
        unfinished.unlink(missing_ok=True)
    return f"left as it is{reason}"
