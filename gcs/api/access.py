"""Logging in, links to one flight, and what administrators see of users."""

from __future__ import annotations

from typing import Annotated, cast

from fastapi import APIRouter, HTTPException, Query, Request
from fastapi.responses import JSONResponse, Response

from gcs.access.roles import Identity, Role
from gcs.access.shares import PREFIX, KnownShare
from gcs.access.token_file import without_hash
from gcs.api.access_schemas import AuditLine, Login, Me, Share, ShareEntry, ShareRequest, TokenEntry
from gcs.api.schemas.problem import Problem
from gcs.api.security import COOKIE, LOCAL, SHARE_COOKIE, Access, RefusedError, address_of
from gcs.api.service import Serving
from gcs.errors import SettingsError

router = APIRouter(tags=["access"])
_MONTH_S = 30 * 86400


def _access(request: Request) -> Access:
    return cast(Access, request.app.state.access)


@router.post("/api/login", responses={401: {"model": Problem}, 429: {"model": Problem}})
async def login(request: Request, body: Login) -> Me:
    """Keep a token, or that of a shared link, in a cookie that no script can read. Needs no token."""
    access = _access(request)
    try:
        # Where no token is asked for a link still says which flight it shows.
        asked = access.demanded or body.token.startswith(PREFIX)
        identity = access.admit(body.token, address_of(request.scope)) if asked else LOCAL
    except RefusedError as error:
        raise HTTPException(error.status, str(error), error.headers) from None
    request.scope["state"]["identity"] = identity
    answer = JSONResponse(_me(identity).model_dump())
    if access.demanded:  # else whatever was sent is no token
        # A link that somebody looks at ends nobody's own session.
        name, secure = SHARE_COOKIE if identity.flight else COOKIE, request.url.scheme == "https"
        answer.set_cookie(name, body.token, max_age=_MONTH_S, httponly=True, samesite="strict", secure=secure)
    return cast(Me, answer)


@router.post("/api/logout", status_code=204)
async def logout() -> Response:
    """Forget the cookies."""
    answer = Response(status_code=204)
    for name in (COOKIE, SHARE_COOKIE):
        answer.delete_cookie(name)
    return answer


@router.get("/api/me")
async def me(request: Request) -> Me:
    """Who asks, and what that role may do."""
    return _me(request.state.identity)


@router.post("/api/flights/{flight_id}/share", responses={404: {"model": Problem}})
def share(request: Request, service: Serving, flight_id: str, body: ShareRequest) -> Share:
    """A link that shows this flight and its results to whoever has it, for some days, and nothing else."""
    service.catalogue.flight(flight_id)
    token, made = _access(request).share(request.state.identity, flight_id, body.days)
    return Share(id=made.id, path=f"/#/shared/{token}", expires=made.expires)


@router.get("/api/shares")
def shares(request: Request) -> list[ShareEntry]:
    """The links that hold: to administrators all, to others those that they made."""
    return [ShareEntry.model_validate(one.shown()) for one in _links_of(request)]


@router.delete("/api/shares/{share_id}", status_code=204, responses={404: {"model": Problem}})
def revoke_share(request: Request, share_id: str) -> None:
    """End a link at once: an administrator any, others one that they made."""
    if not any(one.id == share_id for one in _links_of(request)):
        raise HTTPException(404, f"you have no link {share_id}; GET /api/shares lists those that there are")
    _access(request).shares.revoke(share_id)


def _links_of(request: Request) -> list[KnownShare]:
    access, who = _access(request), request.state.identity
    try:
        return [one for one in access.links() if who.role is Role.ADMIN or one.maker == who.name]
    except SettingsError as error:
        raise HTTPException(503, str(error)) from None


@router.get("/api/tokens")
def tokens(request: Request) -> list[TokenEntry]:
    """Names and roles of all tokens; the tokens themselves are kept nowhere. `gcs token` makes and revokes them."""
    try:
        found = _access(request).tokens.tokens()
    except SettingsError as error:
        raise HTTPException(503, str(error)) from None
    return [TokenEntry.model_validate(without_hash(one)) for one in found]


@router.get("/api/audit")
def audit(
    request: Request,
    limit: Annotated[int, Query(ge=1, le=10_000)] = 200,
    changes: Annotated[bool, Query(description="Those alone that changed something")] = False,
) -> list[AuditLine]:
    """Who did what, the newest first: requests that changed something, and those that were refused."""
    return [AuditLine.model_validate(line) for line in _access(request).audit.last(limit, changes)]


def _me(identity: Identity) -> Me:
    return Me.model_validate({"name": identity.name, "role": identity.role.word, "flight": identity.flight})
