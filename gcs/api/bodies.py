"""Bodies of requests: JSON of bounded size and structure. Recordings that are uploaded have a limit of their own."""

from __future__ import annotations

import asyncio
import re

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs.api.problems import LATER, problem_response
from gcs.text.sizes import size_text

# Bodies of JSON, and those of a model or a vehicle file, which take 10 to 100 kB.
MOST_BYTES, MOST_LARGE_BYTES = 64_000, 256_000
# A token; nobody who sends one is known yet.
_LOGIN_BYTES = 4000
# Texts, brackets and commas of a body, and brackets within one another: an object of Python takes 20 times its text.
MOST_PARTS, MOST_LARGE_PARTS, _DEEPEST = 5000, 20_000, 64
# So many large bodies come or are worked on at a time; and so long a body may take to come, s.
_MOST_PLACES, _LONGEST_S = 4, 30.0
_UPLOADS, _LOGIN = "/api/flights", "/api/login"
_WITH_BODY = ("POST", "PUT", "PATCH")
# Models of jobs; vehicle files; a remark of 20,000 characters.
_LARGE = re.compile(r"/api/(?:flights/[^/]+(?:/jobs)?|jobs/[^/]+/rerun|vehicles(?:/[^/]+)?)")
# The end of a text is not demanded: nothing is looked at twice.
_PART = re.compile(rb'"(?:[^"\\]++|\\.)*+"?|[\[\]{},]', re.DOTALL)


class BodyLimit:
    """ASGI middleware that refuses a body of more than is taken there, whether its length is declared or not.

    It comes as a whole to those who read it, once it is known to hold no more than anybody has to say; and one in each
    round of the loop of events, which goes on to others in between. Nobody waits for one longer than `longest_s`.
    """

    def __init__(self, app: ASGIApp, longest_s: float = _LONGEST_S) -> None:
        self._app, self._longest_s = app, longest_s
        self._places, self._turn = _MOST_PLACES, asyncio.Lock()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["path"] == _UPLOADS:
            await self._app(scope, receive, send)
            return
        most, parts = _limits(scope["method"], scope["path"])
        declared = Headers(scope=scope).get("content-length", "")
        body = _Body(self, receive, most, parts)
        if declared.isdecimal():
            try:
                body.admit(int(declared))
            except HTTPException as error:
                await problem_response(error.status_code, str(error.detail), error.headers)(scope, receive, send)
                return
        try:
            await self._app(scope, body.receive, send)
        finally:
            body.leave()

    def take_place(self) -> None:
        """HTTP 503 where as many large bodies come as are taken at a time."""
        if self._places == 0:
            detail = f"{_MOST_PLACES} other large requests are being worked on; send this one again in a moment"
            raise HTTPException(503, detail, LATER)
        self._places -= 1

    def leave_place(self) -> None:
        """Give a place back."""
        self._places += 1

    async def turn(self) -> None:
        """Wait for a round of the loop in which nobody else reads a body as JSON."""
        await self._turn.acquire()
        asyncio.get_running_loop().call_soon(self._turn.release)

    @property
    def longest_s(self) -> float:
        """What a body may take to come."""
        return self._longest_s


class _Body:
    """The body of one request as it comes."""

    def __init__(self, limit: BodyLimit, receive: Receive, most: int, parts: int) -> None:
        self._limit, self._receive, self._most, self._parts = limit, receive, most, parts
        self._complete = self._has_place = False

    def admit(self, size: int) -> None:
        """HTTP 413 or 503 for a body of `size` bytes that is not taken."""
        if size > self._most:
            detail = f"the body is larger than {size_text(self._most)}, the most that is taken here"
            raise HTTPException(413, detail)
        if size > MOST_BYTES and not self._has_place:
            self._limit.take_place()
            self._has_place = True

    def leave(self) -> None:
        """The request is over."""
        if self._has_place:
            self._has_place = False
            self._limit.leave_place()

    async def receive(self) -> Message:
        """The whole body, and after it what becomes of the client."""
        if self._complete:
            return await self._receive()
        body = bytearray()
        try:
            async with asyncio.timeout(self._limit.longest_s):
                while not self._complete:
                    message = await self._receive()
                    if message["type"] != "http.request":
                        return message
                    body += message.get("body", b"")
                    self.admit(len(body))
                    self._complete = not message.get("more_body", False)
        except TimeoutError:
            detail = f"the body did not come within {self._limit.longest_s:g} s; send it again"
            raise HTTPException(408, detail, {"Connection": "close"}) from None
        if body:
            await self._limit.turn()
            check_structure(body, self._parts)
        return {"type": "http.request", "body": bytes(body), "more_body": False}


def _limits(method: str, path: str) -> tuple[int, int]:
    """Bytes and parts that a body may have."""
    if method not in _WITH_BODY or path == _LOGIN:
        return _LOGIN_BYTES, MOST_PARTS
    return (MOST_LARGE_BYTES, MOST_LARGE_PARTS) if _LARGE.fullmatch(path) else (MOST_BYTES, MOST_PARTS)


def check_structure(body: bytes | bytearray, most: int) -> None:
    """HTTP 413 or 422 for JSON of more parts, or nested deeper, than is taken; found without reading it as JSON."""
    if b"\0" in body:  # as UTF-16 has, in which a quote is none
        raise HTTPException(422, "the body is no JSON in UTF-8; send it in UTF-8")
    depth = 0
    for number, part in enumerate(_PART.finditer(body), 1):
        if number > most:
            raise HTTPException(413, f"the body has more than {most} values and brackets; send fewer")
        first = body[part.start()]
        depth += (first in b"[{") - (first in b"]}")
        if depth > _DEEPEST:
            raise HTTPException(422, f"the body is nested more than {_DEEPEST} deep; send it flatter")
