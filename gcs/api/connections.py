"""HTTP connections of a service that records: a bounded number, none of which waits for its client without end."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from gcs.links.link import readable

_log = logging.getLogger(__name__)

# Connections at a time; files and sockets of the recording need the other descriptors.
MOST = 256
# How long a client may keep the service waiting for a request, or for the next bytes of one, s.
PATIENCE_S = 20.0
# How long an answer may wait to be read on, s.
UNREAD_S = 60.0
# So many of those that have waited longest are looked at for one to end.
_LOOKED_AT = 64
# The log says that there are too many once in so long, s.
_QUIET_S = 60.0


class BoundedProtocol(H11Protocol):
    """uvicorn's HTTP/1.1, which counts connections only where a request comes.

    Beyond `most` connections the one that has waited longest for its client is ended, be it for a request or for an
    answer to be read. So is every one whose client sends nothing for `patience_s` where it is to send, or reads nothing
    for `unread_s`. An answer that is read takes as long as it takes: a stream of events ends with its client.
    """

    most, patience_s, unread_s = MOST, PATIENCE_S, UNREAD_S
    _warned = -math.inf

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take in the connection, at the expense of the longest idle one where there are too many."""
        super().connection_made(transport)
        self._heard = time.monotonic()
        self._timer: asyncio.TimerHandle | None = None
        self._unread: asyncio.TimerHandle | None = None
        self._wait_for_client()
        if len(self.connections) <= self.most:
            return
        ours = [one for one in self.connections if isinstance(one, BoundedProtocol) and one is not self]
        idle = [one for one in ours if one.waits_for_client] or [one for one in ours if one.flow.write_paused]
        longest = sorted(idle, key=lambda one: one._heard)
        # What came in one rush may have sent its request, which is only not read yet.
        victim = next((one for one in longest[:_LOOKED_AT] if not one._has_bytes_waiting()), self)
        if time.monotonic() - BoundedProtocol._warned > _QUIET_S:
            BoundedProtocol._warned = time.monotonic()
            _log.warning("more than %d connections: those that wait longest for their client are ended", self.most)
        victim.transport.abort()
        self.connections.discard(victim)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._cancel()
        self._cancel_unread()
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        """The client does not read: it may for a while."""
        super().pause_writing()
        self._cancel_unread()
        self._unread = self.loop.call_later(self.unread_s, self.transport.abort)

    def resume_writing(self) -> None:
        """The client reads again."""
        self._heard = time.monotonic()
        self._cancel_unread()
        super().resume_writing()

    def data_received(self, data: bytes) -> None:
        """Take the bytes, and wait for the next where more are to come."""
        self._heard = time.monotonic()
        super().data_received(data)
        self._wait_for_client()

    def _has_bytes_waiting(self) -> bool:
        sock = self.transport.get_extra_info("socket")
        return sock is not None and readable(sock.fileno(), 0.0)

    @property
    def waits_for_client(self) -> bool:
        """Whether it is the client's turn: it has sent no request, or not all of one."""
        return self.conn.their_state in (h11.IDLE, h11.SEND_BODY)

    def _wait_for_client(self) -> None:
        self._cancel()
        if self.waits_for_client and not self.transport.is_closing():
            self._timer = self.loop.call_later(self.patience_s, self._too_late)

    def _too_late(self) -> None:
        # What is not read because the disk is slower than the network is not late.
        if self.flow.read_paused:
            self._wait_for_client()
        elif self.waits_for_client:
            self.transport.abort()

    def _cancel_unread(self) -> None:
        if self._unread is not None:
            self._unread.cancel()
            self._unread = None

    def _cancel(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def limited(most: int = MOST, patience_s: float = PATIENCE_S, unread_s: float = UNREAD_S) -> type[BoundedProtocol]:
    """The protocol with other limits."""
    limits: dict[str, Any] = {"most": most, "patience_s": patience_s, "unread_s": unread_s}
    return type("LimitedProtocol", (BoundedProtocol,), limits)
