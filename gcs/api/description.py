"""The description of the interface (OpenAPI), where every error is a problem as RFC 9457 has it."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI

from gcs.api.security import COOKIE, OPEN_PATHS

_PROBLEM = {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}
_METHODS = ("get", "post", "put", "patch", "delete")
_NO_JSON = "The body is no JSON"
_TOO_LARGE = "The body has more bytes, values or levels than are taken here"
_REFUSED = {
    "401": "A token is asked for, and none or a wrong one came",
    "403": "The token's role may not do this, or a page of another site asks",
    "429": "Too many wrong tokens; wait",
}
_LATER = "The catalogue is held by another program, or the service is ending: come again"
_SLOW = "The body does not come in time"
_SCHEMES = {
    "token": {"type": "http", "scheme": "bearer", "description": "A token of the station; none where none was made"},
    "session": {"type": "apiKey", "in": "cookie", "name": COOKIE, "description": "What POST /api/login keeps"},
}


def describe(app: FastAPI) -> None:
    """Have the description of `app` say of each error what is sent, and with which content type."""
    usual = app.openapi

    def described() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _with_problems(usual())
        return app.openapi_schema

    app.openapi = described  # type: ignore[method-assign]


def _with_problems(schema: dict[str, Any]) -> dict[str, Any]:
    schema["components"]["securitySchemes"] = _SCHEMES
    for name, path in schema["paths"].items():
        for method in _METHODS:
            if method not in path:
                continue
            responses = path[method]["responses"]
            if "requestBody" in path[method]:
                responses.setdefault("400", {"description": _NO_JSON})
                responses.setdefault("408", {"description": _SLOW})
                responses.setdefault("413", {"description": _TOO_LARGE})
            responses.setdefault("503", {"description": _LATER})
            if name not in OPEN_PATHS:
                path[method]["security"] = [{scheme: []} for scheme in _SCHEMES]
            for status in ("403",) if name in OPEN_PATHS else _REFUSED:
                responses.setdefault(status, {"description": _REFUSED[status]})
            for status, response in responses.items():
                if status.startswith(("4", "5")):
                    response["content"] = _problem(response)
    for unused in ("HTTPValidationError", "ValidationError"):
        schema["components"]["schemas"].pop(unused, None)
    return schema


def _problem(response: dict[str, Any]) -> dict[str, Any]:
    """Its content: that of any problem, or the problem of its own that it names."""
    named = response.get("content", {}).get("application/json", {}).get("schema", {}).get("$ref", "")
    own = named.startswith("#/components/schemas/") and not named.endswith("/HTTPValidationError")
    return {"application/problem+json": {"schema": {"$ref": named}}} if own else _PROBLEM
