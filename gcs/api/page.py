"""The page and its files."""

from __future__ import annotations

import json

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import HTMLResponse, Response

from gcs.page.assets import ICON, MANIFEST, POLICY, PREFIX, load_assets

router = APIRouter(include_in_schema=False)

_SAFE = {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer"}


@router.get("/")
def page() -> HTMLResponse:
    """The document: asked for anew each time, since it names the files of this version."""
    headers = {**_SAFE, "Content-Security-Policy": POLICY, "Cache-Control": "no-cache"}
    return HTMLResponse(load_assets().document, headers=headers)


@router.get("/manifest.webmanifest")
def manifest() -> Response:
    """By which a phone puts the page on its home screen."""
    return Response(json.dumps(MANIFEST), media_type="application/manifest+json", headers=_SAFE)


@router.get("/icon.svg")
def icon() -> Response:
    """The picture of the page."""
    return Response(ICON, media_type="image/svg+xml", headers=_SAFE)


@router.get("/shell.js")
def shell() -> Response:
    """The script that keeps the page's files in the browser; asked for anew each time, since it names them."""
    headers = {**_SAFE, "Cache-Control": "no-cache"}
    return Response(load_assets().shell, media_type="text/javascript; charset=utf-8", headers=headers)


@router.get(PREFIX + "{digest}/{name:path}")
def asset(request: Request, digest: str, name: str) -> Response:
    """A file of the page. Its address changes with its content, so the browser may keep it for good."""
    found = load_assets().files.get(f"{PREFIX}{digest}/{name}")
    if found is None:
        raise HTTPException(404, "the page has no such file in this version; load the page again")
    headers = {**_SAFE, "Cache-Control": "public, max-age=31536000, immutable", "Vary": "Accept-Encoding"}
    accepted = {part.partition(";")[0].strip() for part in request.headers.get("accept-encoding", "").split(",")}
    if "gzip" in accepted:
        return Response(found.packed, media_type=found.kind, headers={**headers, "Content-Encoding": "gzip"})
    return Response(found.content, media_type=found.kind, headers=headers)
