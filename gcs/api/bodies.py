"""Bodies of requests: JSON of bounded size. Recordings that are uploaded have a limit of their own."""

from __future__ import annotations

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs.api.problems import problem_response
from gcs.text.sizes import size_text

# A model with its correlations is a tenth of it.
MOST_BYTES = 4_000_000
_UPLOADS = "/api/flights"


class BodyLimit:
    """ASGI middleware that refuses a body of more than `most` bytes, whether its length is declared or not."""

    def __init__(self, app: ASGIApp, most: int = MOST_BYTES) -> None:
        self._app, self._most = app, most

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["path"] == _UPLOADS:
            await self._app(scope, receive, send)
            return
        too_large = f"the body is larger than {size_text(self._most)}, the most that is taken here"
        declared = Headers(scope=scope).get("content-length", "")
        if declared.isdecimal() and int(declared) > self._most:
            await problem_response(413, too_large, {"Connection": "close"})(scope, receive, send)
            return
        received = 0

        async def counted() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > self._most:
                raise HTTPException(413, too_large, {"Connection": "close"})
            return message

        await self._app(scope, counted, send)
