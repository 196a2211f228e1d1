"""A station asked from asyncio: the methods of `Station`, each to be awaited."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, TypeVar

import httpx

from gcs.client import operations
from gcs.client.connection import Connection
from gcs.client.methods import described
from gcs.client.steps import Pause, Request, Steps
from gcs.client.transfer import Upload, received
from gcs.errors import StationError

P = ParamSpec("P")
T = TypeVar("T")


def _asked(operation: Callable[P, Steps[T]]) -> Callable[Concatenate[AsyncStation, P], Coroutine[Any, Any, T]]:
    async def method(self: AsyncStation, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return await self._result(operation(*args, **kwargs))

    return described(method, operation)


class AsyncStation:
    """A client of the station at an address, for asyncio; an asynchronous context manager that closes its connections.

    Arguments and errors are those of `Station`. Files are read and written beside the event loop.
    """

    def __init__(self, url: str, token: str = "", timeout: float = 30.0) -> None:
        self._connection = Connection(url, token, timeout)
        self._http = httpx.AsyncClient(**self._connection.settings())

    async def __aenter__(self) -> AsyncStation:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connections; nothing more can be asked."""
        await self._http.aclose()

    health = _asked(operations.health)
    links = _asked(operations.links)
    live = _asked(operations.live)
    flights = _asked(operations.flights)
    flight = _asked(operations.flight)
    upload = _asked(operations.upload)
    download = _asked(operations.download)
    delete = _asked(operations.delete)
    identify = _asked(operations.identify)
    discrepancy = _asked(operations.discrepancy)
    job = _asked(operations.job)
    wait = _asked(operations.wait)
    models = _asked(operations.models)
    result = _asked(operations.result)

    async def _result(self, steps: Steps[T]) -> T:
        try:
            step = next(steps)
            while True:
                try:
                    content = await self._take(step)
                except StationError as error:
                    step = steps.throw(error)
                else:
                    step = steps.send(content)
        except StopIteration as end:
            found: T = end.value
            return found

    async def _take(self, step: Request | Pause) -> bytes:
        if isinstance(step, Pause):
            await asyncio.sleep(step.seconds)
            return b""
        arguments: dict[str, Any] = self._connection.arguments(step)
        if step.upload is not None:
            arguments["content"] = _sent(step.upload)
        with self._connection.failures():
            async with self._http.stream(**arguments) as response:
                with received(step.target if response.is_success else None) as body:
                    async for piece in response.aiter_bytes():
                        await asyncio.to_thread(body.take, piece)
        if not response.is_success:
            raise self._connection.refusal(response.status_code, body.content)
        return body.content


async def _sent(upload: Upload) -> AsyncIterator[bytes]:
    pieces, sent = upload.pieces(), 0
    while piece := await asyncio.to_thread(next, pieces, b""):
        yield piece
        sent += len(piece)
        upload.progress(sent)
