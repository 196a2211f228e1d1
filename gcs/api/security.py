"""Who may ask: tokens with roles, links to one flight, and no requests smuggled in by a web page of another site."""

from __future__ import annotations

import hashlib
import hmac
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import cookie_parser
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs.access.audit import Audit
from gcs.access.failures import Failures
from gcs.access.roles import ROLES, Identity, Role, least_role
from gcs.access.shares import PREFIX as SHARE
from gcs.access.shares import KnownShare, Shares
from gcs.access.token_file import STATION, TokenFile
from gcs.api.problems import problem_response
from gcs.errors import SettingsError
from gcs.page.assets import PREFIX
from gcs.settings import Settings, is_loopback

# The page and the description of the interface hold no data; all else is closed unless it is named here.
OPEN_PATHS = frozenset(
    {
        *("/", "/docs", "/openapi.json", "/manifest.webmanifest", "/icon.svg", "/shell.js"),
        *("/api/health", "/api/ready", "/api/login"),
    }
)
# The scripts and styles of /docs lie behind this.
DESCRIPTION_FILES = "/docs-files"
# In which the page keeps its token, and that of a shared link beside it, where no script can read them.
COOKIE, SHARE_COOKIE = "gcs_token", "gcs_share"
_READING = ("GET", "HEAD", "OPTIONS")
_REFUSED = (401, 403, 429)
_BEARER = {"WWW-Authenticate": "Bearer"}
# Who may make links.
_SHARING = least_role("POST", "/api/flights/ID/share")
LOCAL = Identity("this computer", Role.ADMIN)
_NO_LINK = (
    "this link has ended, was revoked, or is of a version that kept no list of links; ask who sent it for another"
)


class Access:
    """Who is who: the token of the service's start, those of the file, links to flights, and how often one may err."""

    def __init__(self, settings: Settings) -> None:
        self._token, self._closed = settings.token, not is_loopback(settings.host)
        self.tokens = TokenFile(settings.tokens)
        self.shares = Shares(settings.shares)
        self.failures = Failures()
        self.audit = Audit(settings.audit, settings.refusals)

    @property
    def demanded(self) -> bool:
        """Whether a token is needed: where others reach the station, or it has or had any, even if all are revoked."""
        return self._token is not None or self._closed or self.tokens.ever()

    def identify(self, text: str) -> Identity | None:
        """Whose token a text is. SettingsError where the station's files cannot be read."""
        if self._token is not None and hmac.compare_digest(text.encode(), self._token.encode()):
            return Identity(STATION, Role.ADMIN)
        return self.tokens.identify(text) or self._visitor(text)

    def share(self, identity: Identity, flight: str, days: float) -> tuple[str, KnownShare]:
        """Token of a new link to a flight, which holds no longer than its maker may share, and its entry."""
        token = self.tokens.good(identity.name)
        return self.shares.make(flight, days, identity.name, 0.0 if token is None else token.created)

    def links(self) -> list[KnownShare]:
        """The links that hold."""
        return [one for one in self.shares.known() if self._holds(one)]

    def _visitor(self, text: str) -> Identity | None:
        """Who comes with a link."""
        found = self.shares.find(text)
        if found is None or not self._holds(found):
            return None
        return Identity(f"link {found.id} to {found.flight}", Role.VIEWER, found.flight)

    def _holds(self, share: KnownShare) -> bool:
        """Whether the maker of a link may still share: by the same token, not by another of its name."""
        if share.since == 0.0:
            return self._token is not None if share.maker == STATION else not self.demanded
        token = self.tokens.good(share.maker)
        return token is not None and token.created == share.since and ROLES[token.role] >= _SHARING

    def admit(self, text: str, address: str) -> Identity:
        """Whose token a text is. Raises RefusedError for nobody's: 401, and 429 where the address came with too many.

        A good token passes whatever others at the address try: behind a proxy all are one address, and tokens have too
        many bits for guessing to be stopped by the wait.
        """
        try:
            identity = self.identify(text)
        except SettingsError as error:
            raise RefusedError(503, str(error)) from None
        if identity is not None:
            return identity
        if (wait := self.failures.wait_s(address)) > 0.0:
            after = {"Retry-After": f"{wait:.0f}"}
            raise RefusedError(429, f"too many wrong tokens; wait {wait:.0f} s", headers=after)
        self.failures.count(address, hashlib.sha256(text.encode()).digest())
        unknown = _NO_LINK if text.startswith(SHARE) else "the station does not know this token"
        raise RefusedError(401, unknown, headers=_BEARER)


class Guard:
    """ASGI middleware. Without a token only this machine can connect, so the Host must be this machine's name:

    a page that has its own name resolve to 127.0.0.1 would otherwise reach the service through the user's browser.
    """

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        status, detail, more = 0, "", dict[str, str]()
        try:
            identity = self._identity(scope)
            if identity is not None:
                scope.setdefault("state", {})["identity"] = identity
        except RefusedError as error:
            identity, status, detail, more = error.identity, error.status, str(error), error.headers
        method = scope.get("method", "GET")
        sent = 500  # what a failure on the way becomes further out

        async def watched(message: Message) -> None:
            nonlocal sent
            if message["type"] == "http.response.start":
                sent = int(message["status"])
            await send(message)

        try:
            if status == 0:
                await self._app(scope, receive, watched)
            else:
                await problem_response(status, detail, more)(scope, receive, watched)
        finally:
            if method not in _READING or status in _REFUSED:
                self._note(scope, identity, method, sent)

    def _note(self, scope: Scope, identity: Identity | None, method: str, status: int) -> None:
        # Who logs in is known only once that is done.
        found = scope.get("state", {}).get("identity", identity)
        who, role = ("", "") if found is None else (found.name, found.role.word)
        self._access.audit.note(who, role, address_of(scope), method, scope["path"], status)

    def _identity(self, scope: Scope) -> Identity | None:
        """Who asks, None where that does not matter. Raises RefusedError where it may not be answered."""
        headers = Headers(scope=scope)
        origin = headers.get("origin")
        try:
            host = urlsplit("//" + headers.get("host", ""))
            site = None if origin is None else urlsplit(origin).netloc
        except ValueError:
            raise RefusedError(400, "the header Host or Origin names no host") from None
        if site is not None and site != host.netloc:
            raise RefusedError(403, "requests from the page of another site are refused")
        path, method = scope["path"], scope.get("method", "GET")
        try:
            demanded = self._access.demanded
        except SettingsError as error:
            raise RefusedError(503, str(error)) from None
        if not demanded:
            if is_loopback(host.hostname or "") and is_loopback(address_of(scope) or "localhost"):
                return LOCAL
            raise RefusedError(403, "without a token the service answers only to localhost; set GCS_TOKEN, or make"
                                " tokens with gcs token, to serve others")  # fmt: skip
        if path in OPEN_PATHS or path.startswith((PREFIX, f"{DESCRIPTION_FILES}/")):
            return None
        identity = self._whose(headers, address_of(scope), method, path)
        if not identity.may(method, path):
            wanted = f"this is for role {least_role(method, path).word}"
            reason = "a shared link shows its flight alone" if identity.flight else wanted
            raise RefusedError(403, f"{reason}; {identity.name} has role {identity.role.word}", identity)
        return identity

    def _whose(self, headers: Headers, address: str, method: str, path: str) -> Identity:
        """By the header; else by the page's token, else by that of a link where it may do what is asked."""
        scheme, _, text = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and text.strip():
            return self._access.admit(text.strip(), address)
        kept = cookie_parser(headers.get("cookie", ""))
        refused = RefusedError(401, "send a token of the station as 'Authorization: Bearer TOKEN'", headers=_BEARER)
        for name in (COOKIE, SHARE_COOKIE):
            if given := kept.get(name):
                try:
                    identity = self._access.admit(given, address)
                except RefusedError as error:
                    refused = error
                    continue
                if name == COOKIE or identity.may(method, path):
                    return identity
                if kept.get(COOKIE) is None:
                    refused = RefusedError(403, f"a shared link shows its flight alone; {identity.name}", identity)
        raise refused


class RefusedError(Exception):
    def __init__(
        self, status: int, detail: str, identity: Identity | None = None, headers: dict[str, str] | None = None
    ) -> None:
        super().__init__(detail)
        self.status, self.identity, self.headers = status, identity, headers or {}


def address_of(scope: Scope) -> str:
    """Who connected, as the socket has it."""
    client = scope.get("client")
    return client[0] if client else ""
