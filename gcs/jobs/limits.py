"""What a worker may take of the machine: the service, which records, comes first."""

from __future__ import annotations

import os
import resource
import sys
from pathlib import Path

# Of workers, and of those for which somebody waits in front of a page.
NICENESS, NICENESS_WAITED_FOR = 10, 3
# An hour's flight takes 0.7 GB to identify.
_MOST_BYTES, _SHARE = 4_000_000_000, 0.5
_FIRST_TO_END = "1000"


def memory_limit() -> int:
    """Bytes that a worker may allocate: half of this machine's memory, and no more than any flight needs."""
    installed = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return min(_MOST_BYTES, int(_SHARE * installed))


def stand_back(memory_bytes: int, niceness: int = NICENESS) -> None:
    """Low priority, bounded memory, and the first to be ended where the machine has none left."""
    os.nice(niceness)
    # A recording that is mapped for reading does not count; what is allocated does.
    resource.setrlimit(resource.RLIMIT_DATA, (memory_bytes, memory_bytes))
    if sys.platform == "linux":
        Path("/proc/self/oom_score_adj").write_text(_FIRST_TO_END, encoding="ascii")
