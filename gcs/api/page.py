"""The page and its files."""

from __future__ import annotations

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import HTMLResponse, Response

from gcs.page.assets import POLICY, PREFIX, load_assets

router = APIRouter(include_in_schema=False)

_SAFE = {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer"}


@router.get("/")
def page() -> HTMLResponse:
    """The document: asked for anew each time, since it names the files of this version."""
    headers = {**_SAFE, "Content-Security-Policy": POLICY, "Cache-Control": "no-cache"}
    return HTMLResponse(load_assets().document, headers=headers)


@router.get(PREFIX + "{digest}/{name}")
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
