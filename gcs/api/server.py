"""uvicorn's server, as this service runs it."""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import Callable
from types import FrameType

import uvicorn

from gcs.live.feed import LiveFeed
from gcs.station.supervisor import Supervisor

# So many connections may wait to be accepted. One is at a time, in between which requests are read and answered: of a
# rush that is accepted at once, hundreds would be in the way of one another.
WAITING, AT_A_TIME = 128, 1


class Server(uvicorn.Server):
    """Ends the streams of events when it is asked to stop: it waits for every answer to be complete.

    tls: None for plain HTTP. supervisor: hears when it serves and when it ends, and in between that it lives, for as
    long as this loop goes round and `works` says that the recording does. stop: ends what requests wait for.
    """

    def __init__(
        self,
        config: uvicorn.Config,
        live: LiveFeed,
        supervisor: Supervisor,
        works: Callable[[], bool],
        stop: Callable[[], None],
        tls: ssl.SSLContext | None = None,
    ) -> None:
        super().__init__(config)
        config.load()
        config.ssl = tls
        self._live, self._supervisor, self._works = live, supervisor, works
        self._stop = stop
        self._signs: asyncio.Task[None] | None = None

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Stop."""
        self._live.ending.set()
        super().handle_exit(sig, frame)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to serve, and say so."""
        await super().startup(sockets)
        for listener in sockets or ():
            listener.listen(WAITING)  # asyncio takes the number of those that it accepts at a time for it
        if self.started:
            self._supervisor.ready()
            self._signs = asyncio.create_task(self._give_signs())

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Say that it ends, and end."""
        self._supervisor.stopping()
        self._stop()
        if self._signs is not None:
            self._signs.cancel()
        await super().shutdown(sockets)

    async def _give_signs(self) -> None:
        """Signs of life, by a clock that nobody sets; without one the supervisor starts the service again."""
        every_s = self._supervisor.every_s
        while every_s is not None:
            if self._works():
                self._supervisor.alive()
            await asyncio.sleep(every_s)
