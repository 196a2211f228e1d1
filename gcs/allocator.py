"""How the C library keeps memory that was given back: for a service that runs for days.

Every flight takes and gives back large arrays, from threads of its own. By default glibc raises the size from which on
a block has pages of its own each time such a block is freed (up to 32 MB), and keeps up to eight heaps a core, between
whose small blocks what large ones leave cannot be given back: resident memory then grows by the hour though nothing is
kept. Both are fixed here (mallopt(3)).
"""

from __future__ import annotations

import ctypes
import sys

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
_OWN_PAGES_BYTES = 256 * 1024
_GIVEN_BACK_BYTES = 4 * 1024 * 1024
_HEAPS = 2


def give_memory_back() -> bool:
    """Set it for this process; False where there is no glibc, whose settings these are."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL("libc.so.6").mallopt
    except (OSError, AttributeError):
        return False
    settings = {
        _M_MMAP_THRESHOLD: _OWN_PAGES_BYTES,
        _M_TRIM_THRESHOLD: _GIVEN_BACK_BYTES,
        _M_ARENA_MAX: _HEAPS,
    }
    return all(mallopt(name, value) == 1 for name, value in settings.items())
