"""Times as text."""

from __future__ import annotations

from datetime import UTC, datetime

# The last time that 63 bits of nanoseconds hold, 2262.
LAST_NS = 2**63 - 1


def utc_text(ns: int) -> str:
    """UTC ns as ISO 8601 with milliseconds; ns from 0 to LAST_NS."""
    moment = datetime.fromtimestamp(ns // 1_000_000_000, UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{ns // 1_000_000 % 1000:03d}Z"
