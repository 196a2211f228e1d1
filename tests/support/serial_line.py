"""A serial line between two programs: two pseudo-terminals and what carries bytes from one to the other."""

from __future__ import annotations

import os
import select
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager

_CHUNK = 1024


@contextmanager
def serial_line() -> Iterator[tuple[str, str]]:
    """Device names of the two ends, both raw. Bytes flow both ways; a reader that is slow holds the writer up."""
    pairs = [os.openpty() for _ in range(2)]
    for _, device in pairs:
        tty.setraw(device)
    stopping = threading.Event()
    ends = (pairs[0][0], pairs[1][0])
    threads = [
        threading.Thread(target=_carry, args=(source, target, stopping), daemon=True)
        for source, target in (ends, ends[::-1])
    ]
    for thread in threads:
        thread.start()
    try:
        yield os.ttyname(pairs[0][1]), os.ttyname(pairs[1][1])
    finally:
        stopping.set()
        for thread in threads:
            thread.join()
        for pair in pairs:
            for handle in pair:
                os.close(handle)


def _carry(source: int, target: int, stopping: threading.Event) -> None:
    while not stopping.is_set():
        if not select.select([source], [], [], 0.05)[0]:
            continue
        data = os.read(source, _CHUNK)
        while data and not stopping.is_set():
            if select.select([], [target], [], 0.05)[1]:
                data = data[os.write(target, data) :]
