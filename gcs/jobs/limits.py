"""What a worker may take of the machine: the service, which records, comes first."""

from __future__ import annotations

from gcs import portable

# Of workers, and of those for which somebody waits in front of a page.
NICENESS, NICENESS_WAITED_FOR = 10, 3
# An hour's flight takes 0.7 GB to identify.
_MOST_BYTES, _SHARE = 4_000_000_000, 0.5


def memory_limit() -> int:
    """Bytes that a worker may allocate: half of this machine's memory, and no more than any flight needs."""
    return min(_MOST_BYTES, int(_SHARE * portable.installed_memory()))


def stand_back(memory_bytes: int, niceness: int = NICENESS) -> None:
    """Low priority, bounded memory, and the first to be ended where the machine has none left."""
    portable.stand_back(niceness)
    portable.limit_memory(memory_bytes)
