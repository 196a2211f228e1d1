"""Columns of one message type from the chunks of a file, a bounded part at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import RecordingError
from gcs.mavlink.cdr import Layout
from gcs.recording import scan
from gcs.recording.container import Container, Group
from gcs.recording.joined import JoinedContainer

# A message repeated over another link is the same one only if it comes within this time.
_SAME_MESSAGE_NS = 2_000_000_000

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class MessageColumns:
    """All N messages of one type from one component, in the order of reception.

    log_time: (N,) UTC of reception, ns. publish_time: (N,) the sender's stamp in ns, 32-bit ones unwrapped, or
    log_time where the message has none. sequence: (N,) the sender's counter, unwrapped.
    fields: (N,) structured, the message's fields in lower case, units as in the dialect.
    """

    name: str
    system: int
    component: int
    log_time: Ints
    publish_time: Ints
    sequence: Ints
    fields: NDArray[Any]
    text_fields: tuple[str, ...]

    def __len__(self) -> int:
        return int(self.log_time.size)

    def __getitem__(self, field: str) -> NDArray[Any]:
        """One field, (N,) or (N, array length)."""
        values: NDArray[Any] = self.fields[field]
        return values

    def text(self, field: str) -> NDArray[np.str_]:
        """(N,) a char array as text: up to its first zero byte."""
        letters = np.ascontiguousarray(self.fields[field])
        ended = np.cumsum(letters == 0, axis=1) > 0
        cut = np.where(ended, 0, letters).astype(np.uint8)
        joined = cut.view(f"S{cut.shape[1]}").reshape(-1)
        return np.char.decode(joined, "utf-8", "replace") if joined.size else np.empty(0, np.str_)


@dataclass(frozen=True)
class MessageChannel:
    """One channel of MAVLink messages."""

    id: int
    topic: str
    name: str
    link: str
    system: int
    component: int
    message_id: int
    crc_extra: int
    base_length: int
    text_fields: tuple[str, ...]
    schema_id: int


def message_channel(identity: int, topic: str, schema_id: int, metadata: Any) -> MessageChannel | None:
    """What a channel says about its MAVLink messages; None for other channels."""
    try:
        channel = MessageChannel(
            identity,
            topic,
            metadata["message"],
            metadata["link"],
            int(metadata["system"]),
            int(metadata["component"]),
            int(metadata["message_id"]),
            int(metadata["crc_extra"]),
            int(metadata["base_length"]),
            tuple(filter(None, metadata["text_fields"].split(","))),
            schema_id,
        )
    except (KeyError, ValueError):
        return None
    in_a_byte = (channel.system, channel.component, channel.crc_extra, channel.base_length)
    sound = all(0 <= value < 1 << 8 for value in in_a_byte) and 0 <= channel.message_id < 1 << 24
    return channel if sound else None


@dataclass(frozen=True)
class Selection:
    """Which of the messages are wanted.

    start_ns, end_ns: log time, both ends included; None is open. fields: names in lower case; None is all of them.
    group_bytes: about how much of the file is held uncompressed at a time; None is as much as is usual.
    """

    start_ns: int | None = None
    end_ns: int | None = None
    fields: Sequence[str] | None = None
    group_bytes: int | None = None


@dataclass(frozen=True)
class _Rows:
    """N messages as they lie in the file: links (N,) channel numbers, heads (3, N), bodies (N * size,)."""

    links: NDArray[np.uint16]
    heads: Ints
    bodies: Bytes

    def only(self, keep: NDArray[np.bool_], size: int) -> _Rows:
        """The messages chosen by a mask."""
        if keep.all():
            return self
        return _Rows(self.links[keep], self.heads[:, keep], self.bodies.reshape(-1, size)[keep].reshape(-1))


def iter_columns(
    file: Container | JoinedContainer, channels: Sequence[MessageChannel], layout: Layout, wanted: Selection
) -> Iterator[MessageColumns]:
    """The messages of one type and component, from one or several links each once, a part of the file at a time."""
    names = [field.name for field in layout.fields]
    for name in wanted.fields or ():
        if name not in names:
            raise RecordingError(f"{channels[0].name} has no field {name}; it has {', '.join(names)}")
    several = len(channels) > 1
    start_ns = wanted.start_ns
    if start_ns is not None and several:
        start_ns -= _SAME_MESSAGE_NS
    ids = [channel.id for channel in channels]
    size = layout.cdr_size
    before: _Rows | None = None
    for group in file.selected_groups(ids, start_ns, wanted.end_ns, wanted.group_bytes):
        rows = _gather(group, ids, size)
        if several:
            rows, before = _each_once(rows, before, size)
        rows = rows.only(_inside(rows.heads[1], wanted), size)
        if rows.links.size:
            yield _as_columns(channels[0], rows, layout, wanted)


def _gather(group: Group, channels: Sequence[int], size: int) -> _Rows:
    """These channels' messages in a group. One channel is one link here: all carry one component's same message."""
    picked = group.rows_of(channels)
    bodies = np.empty(picked.size * size, np.uint8)
    heads = np.empty((3, picked.size), np.int64)
    scan.gather(group.data, group.rows, picked, size, bodies, heads)
    links = group.channel[picked] if len(channels) > 1 else np.zeros(picked.size, np.uint16)
    return _Rows(links, heads, bodies)


def _inside(log_time: Ints, wanted: Selection) -> NDArray[np.bool_]:
    keep = np.ones(log_time.size, bool)
    if wanted.start_ns is not None:
        keep &= log_time >= wanted.start_ns
    if wanted.end_ns is not None:
        keep &= log_time <= wanted.end_ns
    return keep


def _each_once(rows: _Rows, before: _Rows | None, size: int) -> tuple[_Rows, _Rows | None]:
    """The rows without what another link had brought already, and those that the next ones are to be compared with.

    before: rows in front of these that may come again.
    """
    known = 0 if before is None else before.links.size
    if before is not None:
        rows = _Rows(
            np.concatenate((before.links, rows.links)),
            np.concatenate((before.heads, rows.heads), axis=1),
            np.concatenate((before.bodies, rows.bodies)),
        )
    if rows.links.size == 0:
        return rows, None
    keep = np.ones(rows.links.size, bool)
    if np.unique(rows.links).size > 1:
        keep = _first_of_each(rows.links, rows.heads, rows.bodies, size)
    recent = keep & (rows.heads[1] >= rows.heads[1].max() - _SAME_MESSAGE_NS)
    fresh = keep.copy()
    fresh[:known] = False
    return rows.only(fresh, size), rows.only(recent, size)


def _as_columns(channel: MessageChannel, rows: _Rows, layout: Layout, wanted: Selection) -> MessageColumns:
    fields = rows.bodies.view(layout.dtype)
    texts = channel.text_fields
    if wanted.fields is not None:
        names = list(wanted.fields)
        chosen = np.empty(fields.size, [(name, *_kind(layout.dtype[name])) for name in names])
        for name in names:
            chosen[name] = fields[name]
        fields, texts = chosen, tuple(name for name in texts if name in names)
    heads = rows.heads
    return MessageColumns(channel.name, channel.system, channel.component, heads[1], heads[2], heads[0], fields, texts)


def _kind(dtype: np.dtype[Any]) -> tuple[Any, ...]:
    return (dtype.base, dtype.shape) if dtype.shape else (dtype,)


def joined(parts: Sequence[MessageColumns]) -> MessageColumns:
    """Consecutive parts of one message type and component as one."""
    first = parts[0]
    if len(parts) == 1:
        return first
    return MessageColumns(
        first.name,
        first.system,
        first.component,
        np.concatenate([part.log_time for part in parts]),
        np.concatenate([part.publish_time for part in parts]),
        np.concatenate([part.sequence for part in parts]),
        # As bytes, so that padding between fields is copied too, and the same file always gives the same bytes.
        np.concatenate([part.fields.view(np.uint8) for part in parts]).view(first.fields.dtype),
        first.text_fields,
    )


def _first_of_each(links: NDArray[np.uint16], heads: Ints, bodies: Bytes, size: int) -> NDArray[np.bool_]:
    """(N,) False for what another link had brought already."""
    keys = np.empty(links.size, np.uint64)
    scan.hash_bodies(bodies, size, heads[0], keys)
    keep = np.ones(links.size, np.uint8)
    order = np.lexsort((heads[1], keys))
    scan.keep_first(keys, links.astype(np.int64), heads[1], order, _SAME_MESSAGE_NS, keep)
    return keep.astype(bool)
