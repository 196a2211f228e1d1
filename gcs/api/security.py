"""Who may ask: a bearer token, and no requests smuggled in by a web page of another site."""

from __future__ import annotations

import hmac
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from gcs.api.problems import problem_response
from gcs.page.assets import PREFIX
from gcs.settings import is_loopback

# The page and the description of the interface hold no data; all else is closed unless it is named here.
_OPEN_PATHS = frozenset(
    {"/", "/docs", "/openapi.json", "/api/health", "/manifest.webmanifest", "/icon.svg", "/shell.js"}
)
# The scripts and styles of /docs lie behind this.
DESCRIPTION_FILES = "/docs-files"


class Guard:
    """ASGI middleware. Without a token only this machine can connect, so the Host must be this machine's name:

    a page that has its own name resolve to 127.0.0.1 would otherwise reach the service through the user's browser.
    """

    def __init__(self, app: ASGIApp, token: str | None) -> None:
        self._app = app
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        refusal = self._refusal(scope) if scope["type"] in ("http", "websocket") else None
        if refusal is None:
            await self._app(scope, receive, send)
            return
        status, detail = refusal
        headers = {"WWW-Authenticate": "Bearer"} if status == 401 else {}
        await problem_response(status, detail, headers)(scope, receive, send)

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        headers = Headers(scope=scope)
        origin = headers.get("origin")
        try:
            host = urlsplit("//" + headers.get("host", ""))
            site = None if origin is None else urlsplit(origin).netloc
        except ValueError:
            return 400, "the header Host or Origin names no host"
        if site is not None and site != host.netloc:
            return 403, "requests from the page of another site are refused"
        if self._token is None:
            if is_loopback(host.hostname or ""):
                return None
            return 403, "without a token the service answers only to localhost; set GCS_TOKEN to serve others"
        if scope["path"] in _OPEN_PATHS or scope["path"].startswith((PREFIX, f"{DESCRIPTION_FILES}/")):
            return None
        scheme, _, given = headers.get("authorization", "").partition(" ")
        right = hmac.compare_digest(given.strip().encode(), self._token.encode())
        if scheme.lower() == "bearer" and right:
            return None
        return 401, "send the token of the service as 'Authorization: Bearer TOKEN'"
