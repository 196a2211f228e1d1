"""What the service says to systemd, or to whoever else started it and listens: it serves, it lives, it ends.

The protocol is that of sd_notify(3): datagrams to the Unix socket that NOTIFY_SOCKET names.
"""

from __future__ import annotations

import os
import socket
from collections.abc import MutableMapping


class Supervisor:
    """Sends states to whoever supervises the service; to nobody where nobody asked for them.

    The variables are taken out of `environment`, so that no worker speaks in the service's name.
    """

    def __init__(self, environment: MutableMapping[str, str] = os.environ) -> None:
        address = environment.pop("NOTIFY_SOCKET", "")
        self._address = f"\0{address[1:]}" if address.startswith("@") else address
        period_us, process = environment.pop("WATCHDOG_USEC", ""), environment.pop("WATCHDOG_PID", "")
        ours = process in ("", str(os.getpid()))
        self._period_s = 1e-6 * int(period_us) if ours and address and period_us.isdecimal() else 0.0

    @property
    def every_s(self) -> float | None:
        """How often to look for signs of life, a tenth of what it waits for one: a moment's pause is not the end. None
        where it wants none.
        """
        return 0.1 * self._period_s or None

    def ready(self) -> None:
        """The service answers."""
        self._send(f"READY=1\nMAINPID={os.getpid()}\nSTATUS=serving")

    def alive(self) -> None:
        """The service does its work."""
        self._send("WATCHDOG=1")

    def stopping(self) -> None:
        """The service ends its flights and itself."""
        self._send("STOPPING=1\nSTATUS=ending")

    def _send(self, state: str) -> None:
        """Send it without waiting; a supervisor that cannot be reached is none of the recording's business."""
        if not self._address:
            return
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
                sock.setblocking(False)
                sock.sendto(state.encode(), self._address)
        except OSError:
            return
