"""Bodies of requests: JSON of bounded size and structure. Recordings that are uploaded have a limit of their own."""

from __future__ import annotations

import re

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs.api.problems import problem_response
from gcs.text.sizes import size_text

# A model with its correlations is a tenth of it.
MOST_BYTES = 4_000_000
# A token; nobody who sends one is known yet.
_LOGIN_BYTES = 4000
# Texts, brackets and commas of a body, and brackets within one another: an object of Python takes 20 times its text.
MOST_PARTS, _DEEPEST = 100_000, 64
_UPLOADS, _LOGIN = "/api/flights", "/api/login"
_WITH_BODY = ("POST", "PUT", "PATCH")
# The end of a text is not demanded: nothing is looked at twice.
_PART = re.compile(rb'"(?:[^"\\]++|\\.)*+"?|[\[\]{},]', re.DOTALL)


class BodyLimit:
    """ASGI middleware that refuses a body of more than `most` bytes, whether its length is declared or not.

    It comes as a whole to those who read it, once it is known to hold no more than anybody has to say.
    """

    def __init__(self, app: ASGIApp, most: int = MOST_BYTES) -> None:
        self._app, self._most = app, most

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["path"] == _UPLOADS:
            await self._app(scope, receive, send)
            return
        large = scope["method"] in _WITH_BODY and scope["path"] != _LOGIN
        most = self._most if large else _LOGIN_BYTES
        too_large = f"the body is larger than {size_text(most)}, the most that is taken here"
        declared = Headers(scope=scope).get("content-length", "")
        if declared.isdecimal() and int(declared) > most:
            await problem_response(413, too_large, {"Connection": "close"})(scope, receive, send)
            return
        complete = False

        async def checked() -> Message:
            nonlocal complete
            body = bytearray()
            while not complete:
                message = await receive()
                if message["type"] != "http.request":
                    return message
                body += message.get("body", b"")
                if len(body) > most:
                    raise HTTPException(413, too_large, {"Connection": "close"})
                complete = not message.get("more_body", False)
                if complete:
                    whole = bytes(body)
                    check_structure(whole)
                    return {"type": "http.request", "body": whole, "more_body": False}
            return await receive()

        await self._app(scope, checked, send)


def check_structure(body: bytes) -> None:
    """HTTP 413 or 422 for JSON of more parts, or nested deeper, than is taken; found without reading it as JSON."""
    if b"\0" in body:  # as UTF-16 has, in which a quote is none
        raise HTTPException(422, "the body is no JSON in UTF-8; send it in UTF-8")
    depth = 0
    for number, part in enumerate(_PART.finditer(body), 1):
        if number > MOST_PARTS:
            raise HTTPException(413, f"the body has more than {MOST_PARTS} values and brackets; send fewer")
        first = body[part.start()]
        depth += (first in b"[{") - (first in b"]}")
        if depth > _DEEPEST:
            raise HTTPException(422, f"the body is nested more than {_DEEPEST} deep; send it flatter")
