"""Serial devices that come and go, over real pseudo-terminals, and links that follow."""

import os
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from traffic import wait_until

from gcs.links.opening import Link


@contextmanager
def plugged(device: Path) -> Iterator[tuple[int, int]]:
    """A device at this path while the block lasts: what the vehicle writes to, and the terminal behind the path."""
    vehicle, terminal = os.openpty()
    tty.setraw(terminal)
    device.symlink_to(os.ttyname(terminal))
    try:
        yield vehicle, terminal
    finally:
        device.unlink()
        os.close(terminal)
        os.close(vehicle)


def connected(link: Link) -> None:
    wait_until(lambda: link.receive(0.01) is None and link.connected)


def lost(link: Link) -> None:
    wait_until(lambda: link.receive(0.01) is None and not link.connected)
