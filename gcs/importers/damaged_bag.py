"""Bags in MCAP that were cut off or carry no index: read from the front, by mcap's own reader, as far as they go."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Channel, Footer, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

MAGIC = b"\x89MCAP0\r\n"


@contextmanager
def as_far_as_it_goes(path: Path) -> Iterator[tuple[Path, str]]:
    """The file itself where it is whole or no MCAP; else one of all its messages that can be read, for as long as the
    context lasts, and a sentence where messages are missing.
    """
    if not _is_mcap(path) or _is_indexed(path):
        yield path, ""
        return
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / path.name
        yield whole, _rewrite(path, whole)


def _is_mcap(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False  # whoever reads it says why


def _is_indexed(path: Path) -> bool:
    """Whether its end lists every channel that it has messages of."""
    try:
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
    except Exception:  # whatever reading a damaged summary raises
        return False
    if summary is None or summary.statistics is None:
        return False
    return bool(summary.chunk_indexes) and set(summary.statistics.channel_message_counts) <= set(summary.channels)


def _rewrite(path: Path, target: Path) -> str:
    """Write what can be read anew; a sentence where the file ends before its own end."""
    schemas, channels, count, ended = {0: 0}, dict[int, int](), 0, False
    with path.open("rb") as source, target.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "")
        records = iter(StreamReader(source, validate_crcs=True).records)
        while True:
            try:
                record = next(records)
            except Exception:  # its end, or whatever unpacking a record that was cut off raises
                # What comes behind a damaged record cannot be distinguished from noise.
                break
            if isinstance(record, Footer):
                ended = True
            elif isinstance(record, Schema):
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel):
                schema = schemas.get(record.schema_id, 0)
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schema, record.metadata
                )
            elif isinstance(record, Message) and record.channel_id in channels:
                number = channels[record.channel_id]
                writer.add_message(number, record.log_time, record.data, record.publish_time, record.sequence)
                count += 1
        writer.finish()  # type: ignore[no-untyped-call]
    return "" if ended else f"the bag is cut off or damaged: the {count} messages before that are read"


__all__ = ["as_far_as_it_goes"]
