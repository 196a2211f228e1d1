"""HTTP connections of a service that records: a bounded number, none of which waits for its client without end."""

from __future__ import annotations

import asyncio
import logging
import math
import select
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

import h11
from starlette.types import Message, Receive, Scope, Send
from uvicorn.protocols.http.flow_control import CLOSE_HEADER, FlowControl
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

_log = logging.getLogger(__name__)

# Connections at a time; files and sockets of the recording need the other descriptors.
MOST = 256
# How long a client may keep the service waiting for a request, or for the next bytes of one, s.
PATIENCE_S = 20.0
# How long an answer may wait to be read on, s.
UNREAD_S = 60.0
# Of a body that comes in chunks so many bytes are read before others have their turn, once as many bytes of it are
# there, and before that no more than the first number: each chunk costs as much as a kilobyte does.
_FIRST_SLICE, _SLICE = 256, 2048
# What frames the chunks of a body may be so many bytes, and this share of what they hold: they hold 48 bytes or more.
_MOST_FRAMING, _FRAMING_SHARE = 512, 1 / 8
# What is left of a body when it is answered is read up to this, and else thrown away for so long, s.
_MOST_LEFT, LINGER_S = 64_000, 2.0
# The log says that there are too many once in so long, s.
_QUIET_S = 60.0


class _Flow(FlowControl):
    """uvicorn's flow control, but what has been read already comes before what is read next."""

    def __init__(self, transport: asyncio.Transport, go_on: Callable[[], None]) -> None:
        super().__init__(transport)
        self._go_on = go_on

    def resume_reading(self) -> None:
        """uvicorn takes more."""
        if self.read_paused:
            self.read_paused = False
            self._go_on()


class BoundedProtocol(H11Protocol):
    """uvicorn's HTTP/1.1, which counts connections only where a request comes.

    Beyond `most` connections the one that has waited longest for its client is ended, be it for a request or for an
    answer to be read. So is every one whose client sends nothing for `patience_s` where it is to send, or reads nothing
    for `unread_s`. An answer that is read takes as long as it takes: a stream of events ends with its client.

    Chunks of a body are read a few at a time, and a body of tiny ones ends its connection. So does a long one that is
    answered before all of it came: the rest is thrown away for `linger_s`, in which the client can read the answer.
    """

    most, patience_s, unread_s, linger_s = MOST, PATIENCE_S, UNREAD_S, LINGER_S
    _warned = -math.inf

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take in the connection, at the expense of the longest idle one where there are too many."""
        super().connection_made(transport)
        self.app = self._answer
        self.flow = _Flow(transport, self._go_on)
        self._rest = bytearray()
        self._next: asyncio.Handle | None = None
        self._counted: RequestResponseCycle | None = None
        self._framing = self._held = 0
        self._over, self._lost = False, asyncio.Event()
        self._heard = time.monotonic()
        self._timer: asyncio.TimerHandle | None = None
        self._unread: asyncio.TimerHandle | None = None
        self._wait_for_client()
        if len(self.connections) <= self.most:
            return
        ours = [one for one in self.connections if isinstance(one, BoundedProtocol) and one is not self]
        victim = min(_silent(ours) or [one for one in ours if one.flow.write_paused] or [self], key=_heard_at)
        if time.monotonic() - BoundedProtocol._warned > _QUIET_S:
            BoundedProtocol._warned = time.monotonic()
            _log.warning("more than %d connections: those that wait longest for their client are ended", self.most)
        victim.transport.abort()
        self.connections.discard(victim)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._cancel()
        self._cancel_unread()
        self._drop_rest()
        self._lost.set()
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
        if self._over:
            return
        self._rest += data
        if self._next is None and not self.flow.read_paused:
            self._take()
        else:
            self.transport.pause_reading()

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Have the application answer; of a long body that it does not wait for no more is read."""

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start" and self._is_long:
                self._over = True
                self._drop_rest()
                self.transport.resume_reading()
                message = {**message, "headers": [*message.get("headers", ()), CLOSE_HEADER]}
            last = message["type"] == "http.response.body" and not message.get("more_body", False)
            if last and self._over:  # who is cut off while it sends may not see the answer
                await send({**message, "more_body": True})
                with suppress(TimeoutError, asyncio.CancelledError):  # a stop does not wait either
                    await asyncio.wait_for(self._lost.wait(), self.linger_s)
                message = {"type": "http.response.body", "body": b""}
            await send(message)

        await self.config.loaded_app(scope, receive, sent)

    @property
    def _is_long(self) -> bool:
        """Whether much of the body may be still to come."""
        return self.conn.their_state is h11.SEND_BODY and (self._in_chunks or self._declared > _MOST_LEFT)

    @property
    def _in_chunks(self) -> bool:
        return any(name == b"transfer-encoding" for name, _ in self.headers or ())

    @property
    def _declared(self) -> int:
        return int(next((value for name, value in self.headers or () if name == b"content-length"), b"0"))

    def _take(self) -> None:
        """Read what has come, a slice of it where it may be made of chunks; the rest after others had their turn."""
        self._next = None
        if self.transport.is_closing():
            self._drop_rest()
            return
        self._count_anew()
        cycle = self.cycle if self.conn.their_state is h11.SEND_BODY else None
        taken = bytes(self._rest[: self._next_size(cycle)])
        del self._rest[: len(taken)]
        before = 0 if cycle is None else len(cycle.body)
        super().data_received(taken)
        # Behind the end of a body the next request may stand.
        if cycle is not None and cycle is self.cycle and cycle.more_body:
            held = len(cycle.body) - before
            self._held += held
            self._framing += len(taken) - held
        self._count_anew()
        if self._in_chunks and self._framing > _MOST_FRAMING + self._held * _FRAMING_SHARE:
            self.transport.abort()
            self._drop_rest()
            return
        if self._rest:
            self.transport.pause_reading()
        if not self.flow.read_paused:
            self._go_on()
        self._wait_for_client()

    def _next_size(self, cycle: RequestResponseCycle | None) -> int:
        """How many bytes are read now: of a body as many as it may be worth, else no more than one head."""
        if cycle is None:
            end = self._rest.find(b"\r\n\r\n", 0, _SLICE)
            return _SLICE if end < 0 else end + 4
        if self._in_chunks:
            return min(max(self._held, _FIRST_SLICE), _SLICE)
        return _SLICE if self.conn.our_state is h11.DONE else max(self._declared - self._held, _SLICE)

    def _count_anew(self) -> None:
        """Where another request has begun."""
        if self.cycle is not self._counted:
            self._counted, self._framing, self._held = self.cycle, 0, len(self.cycle.body)

    def _go_on(self) -> None:
        """Read what has come already, or what comes next."""
        if not self._rest:
            self.transport.resume_reading()
        elif self._next is None:
            self._next = self.loop.call_soon(self._take)

    def _drop_rest(self) -> None:
        self._rest.clear()
        if self._next is not None:
            self._next.cancel()
            self._next = None

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
        if self.flow.read_paused or self._rest:
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


def _heard_at(one: BoundedProtocol) -> float:
    return one._heard


def _silent(ours: Iterable[BoundedProtocol]) -> list[BoundedProtocol]:
    """Those that wait for their client. What came in one rush may have sent its request, which is only not read yet."""
    poll, waiting = select.poll(), {}
    for one in ours:
        sock = one.transport.get_extra_info("socket")
        if one.waits_for_client and not one._rest and sock is not None and sock.fileno() >= 0:
            poll.register(sock.fileno(), select.POLLIN)
            waiting[sock.fileno()] = one
    for descriptor, _ in poll.poll(0):
        del waiting[descriptor]
    return list(waiting.values())


def limited(
    most: int = MOST, patience_s: float = PATIENCE_S, unread_s: float = UNREAD_S, linger_s: float = LINGER_S
) -> type[BoundedProtocol]:
    """The protocol with other limits."""
    limits: dict[str, Any] = {"most": most, "patience_s": patience_s, "unread_s": unread_s, "linger_s": linger_s}
    return type("LimitedProtocol", (BoundedProtocol,), limits)
