"""What operating systems call differently, or lack: priority, limits, locks, room on the disk.

Where a system has no such thing the function does nothing, and what it guards against is not guarded against there.
"""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import IO, Any


def _of_posix(name: str) -> Any:
    """A module that not every system has; None where this one does not."""
    try:
        return import_module(name)
    except ImportError:
        return None


_resource, _fcntl, _termios = (_of_posix(name) for name in ("resource", "fcntl", "termios"))
#: What a serial device says where it refuses a setting.
TERMINAL_ERROR: type[Exception] = OSError if _termios is None else _termios.error
_FIRST_TO_END = "1000"
# Of memory where a system does not say how much it has, bytes.
_USUAL_MEMORY = 4_000_000_000


def stand_back(niceness: int) -> None:
    """Let others have the processor first."""
    if hasattr(os, "nice"):
        os.nice(niceness)


def installed_memory() -> int:
    """Bytes of memory that this machine has."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return _USUAL_MEMORY


def limit_memory(most_bytes: int) -> None:
    """Bound what this process may allocate, and be the first to be ended where the machine has no memory left."""
    if _resource is not None:
        # A recording that is mapped for reading does not count; what is allocated does.
        _resource.setrlimit(_resource.RLIMIT_DATA, (most_bytes, most_bytes))
    if sys.platform == "linux":
        Path("/proc/self/oom_score_adj").write_text(_FIRST_TO_END, encoding="ascii")


def used() -> tuple[float, int | None]:
    """Processor time of this process, s, and the most memory that it had, bytes, where the system says it."""
    if _resource is None:
        return time.process_time(), None
    found = _resource.getrusage(_resource.RUSAGE_SELF)
    return found.ru_utime + found.ru_stime, found.ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def open_files(wanted: int) -> int:
    """Files and sockets that this process may have open, once as many as allowed were asked for.

    wanted: where the system sets no bound of its own.
    """
    if _resource is None:
        return wanted
    soft, hard = _resource.getrlimit(_resource.RLIMIT_NOFILE)
    # Some systems say that there is no limit, and then take no number that is one.
    most = max(soft, wanted) if hard == _resource.RLIM_INFINITY else hard
    if soft != most:
        _resource.setrlimit(_resource.RLIMIT_NOFILE, (most, hard))
    return int(most)


def lock(file: IO[str]) -> None:
    """Hold a file for this process alone; OSError where another has it."""
    if _fcntl is not None:
        _fcntl.flock(file, _fcntl.LOCK_EX | _fcntl.LOCK_NB)
    elif sys.platform == "win32":
        import msvcrt

        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold a folder for one thread of one process alone, once others have let it go; where none can be held, go on."""
    if _fcntl is None:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        _fcntl.flock(handle, _fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def free_bytes(file: IO[bytes], path: Path) -> int | None:
    """Room left on the disk of an open file, bytes; None for what has no size, as a pipe."""
    if hasattr(os, "fstatvfs"):
        disk = os.fstatvfs(file.fileno())
        return disk.f_bavail * disk.f_frsize if disk.f_blocks else None
    return shutil.disk_usage(path.parent).free
