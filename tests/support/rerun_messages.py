"""MAVLink messages of a recording as rerun's own MCAP reader gives them."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

from rerun.chunk import McapReader

from gcs.recording.wire import WIRE_TOPIC


def rerun_messages(path: Path, *, recover: bool = False) -> dict[str, list[tuple[int, dict[str, Any]]]]:
    """Topic -> (time of reception in ns, fields) of every message in its order.

    recover: let the reader mend a file without an end.
    """
    found: dict[str, list[tuple[int, dict[str, Any]]]] = defaultdict(list)
    for chunk in McapReader(path, decoders=["ros2_reflection"], recover=recover).stream():
        batch = chunk.to_record_batch()
        column = next((name for name in batch.schema.names if name.endswith(":message")), None)
        topic = str(chunk.entity_path)
        if column is None or topic == WIRE_TOPIC:
            continue
        stamps = batch.column("message_log_time").cast("int64").to_pylist()
        found[topic].extend((at, row[0]) for at, row in zip(stamps, batch.column(column).to_pylist(), strict=True))
    return {topic: sorted(rows, key=lambda row: row[0]) for topic, rows in found.items()}
