"""A station asked plainly: each method returns when the answer is there."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
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


def _asked(operation: Callable[P, Steps[T]]) -> Callable[Concatenate[Station, P], T]:
    def method(self: Station, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self._result(operation(*args, **kwargs))

    return described(method, operation)


class Station:
    """A client of the station at an address; a context manager that closes its connections.

    token: the service's, where it demands one. timeout: how long it may be silent, s. Raises SettingsError for an
    address, token or time that cannot be meant; every method raises StationError, in one line.
    """

    def __init__(self, url: str, token: str = "", timeout: float = 30.0) -> None:
        self._connection = Connection(url, token, timeout)
        self._http = httpx.Client(**self._connection.settings())

    def __enter__(self) -> Station:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections; nothing more can be asked."""
        self._http.close()

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

    def _result(self, steps: Steps[T]) -> T:
        try:
            step = next(steps)
            while True:
                try:
                    content = self._take(step)
                except StationError as error:
                    step = steps.throw(error)
                else:
                    step = steps.send(content)
        except StopIteration as end:
            found: T = end.value
            return found

    def _take(self, step: Request | Pause) -> bytes:
        if isinstance(step, Pause):
            time.sleep(step.seconds)
            return b""
        arguments: dict[str, Any] = self._connection.arguments(step)
        if step.upload is not None:
            arguments["content"] = _sent(step.upload)
        with (
            self._connection.failures(),
            self._http.stream(**arguments) as response,
            received(step.target if response.is_success else None) as body,
        ):
            for piece in response.iter_bytes():
                body.take(piece)
        if not response.is_success:
            raise self._connection.refusal(response.status_code, body.content)
        return body.content


def _sent(upload: Upload) -> Iterator[bytes]:
    sent = 0
    for piece in upload.pieces():
        yield piece
        sent += len(piece)
        upload.progress(sent)
