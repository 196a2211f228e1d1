"""Answers that hold a place for as long as they take: who reads slowly keeps a connection from others."""

from __future__ import annotations

from typing import Any

from fastapi.responses import FileResponse, StreamingResponse
from starlette.types import Receive, Scope, Send

from gcs.jobs.places import Places


class _Held:
    """places: of which one is held, by `who`, until the answer ends, however it does. BusyError where there is none."""

    def __init__(self, *given: Any, places: Places, who: str, **named: Any) -> None:
        super().__init__(*given, **named)
        self._places, self._who = places, who

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with self._places.held(self._who):
            await super().__call__(scope, receive, send)  # type: ignore[misc]


class HeldFile(_Held, FileResponse):
    """A file."""


class HeldStream(_Held, StreamingResponse):
    """What comes bit by bit."""
