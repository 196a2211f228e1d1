"""An id for every request: in its answer, in every line of the log that it causes, and in the access log."""

from __future__ import annotations

import asyncio
import logging
import re
import secrets
import time

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs.api.problems import LATER, problem_response, unexpected_problem
from gcs.jobs.programs import STOPPED
from gcs.text.json_log import ACCESS_LOG, REQUEST_ID

HEADER = "X-Request-ID"
# What a proxy or a client may name its requests by; anything else is replaced.
_SANE = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")

_log = logging.getLogger(ACCESS_LOG)
_log.setLevel(logging.WARNING)  # until `log_as_json` asks for it


class RequestIds:
    """ASGI middleware, to be asked before all others. The access log has no queries: a token may stand in one."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        given = Headers(scope=scope).get(HEADER, "")
        number = given if _SANE.fullmatch(given) else secrets.token_hex(8)
        REQUEST_ID.set(number)  # each request has a context of its own, which ends with it
        began = time.monotonic()
        status: int | None = None

        async def named(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = int(message["status"])
                MutableHeaders(scope=message)[HEADER] = number
            await send(message)

        try:
            await self._app(scope, receive, named)
        except asyncio.CancelledError:  # uvicorn waits for nobody any longer, and would answer in plain text
            if status is None:
                await problem_response(503, STOPPED, LATER)(scope, receive, named)
        except Exception:
            if status is None:
                await unexpected_problem()(scope, receive, named)
            raise  # the server logs it
        finally:
            ms = round(1000.0 * (time.monotonic() - began), 1)
            what = {"method": scope["method"], "path": scope["path"], "status": status, "ms": ms}
            _log.info("%s %s %s", scope["method"], scope["path"], status, extra=what)
