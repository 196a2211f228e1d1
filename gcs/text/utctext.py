"""Times as text."""

from __future__ import annotations

from datetime import UTC, datetime


def utc_text(ns: int) -> str:
    """UTC ns as ISO 8601 with milliseconds."""
    moment = datetime.fromtimestamp(ns // 1_000_000_000, UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{ns // 1_000_000 % 1000:03d}Z"
