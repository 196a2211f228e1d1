"""Errors as application/problem+json (RFC 9457), each with a sentence."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any, cast

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException

from gcs.api.schemas.jobs import JobChanges
from gcs.errors import (
    BusyError,
    CatalogueBusyError,
    CatalogueError,
    CatalogueFileError,
    ExportError,
    GcsError,
    ImportFileError,
    JobError,
    QueueFullError,
    RecordingDeletedError,
    RecordingError,
    ServiceError,
    SignalMapError,
    VehicleError,
)
from gcs.text.json_log import REQUEST_ID
from sim_vehicle.errors import SimVehicleError
from sysid.errors import SysidError

_STATUS: tuple[tuple[type[Exception], int], ...] = (
    (CatalogueError, 404),
    (CatalogueFileError, 503),
    (ServiceError, 503),
    (RecordingDeletedError, 410),
    (SignalMapError, 404),
    (QueueFullError, 503),
    (JobError, 409),
    (VehicleError, 409),
    (ExportError, 409),
    (ImportFileError, 422),
    (RecordingError, 422),
    (GcsError, 400),
    (SysidError, 422),
    (SimVehicleError, 422),
)
# When to come again where others are served, s.
LATER = {"Retry-After": "30"}
# So many of the keys that nobody knows are named in an error, each in so many characters.
_MOST_NAMED, _LONGEST_NAME = 10, 100
_AN_OBJECT = "send a JSON object{example}, with the header Content-Type: application/json"


def problem_response(
    status: int, detail: str, headers: Mapping[str, str] | None = None, more: Mapping[str, object] | None = None
) -> Response:
    """An error as JSON with the sentence `detail`, the id of the request, and what `more` there is to say."""
    body = {"type": "about:blank", "title": HTTPStatus(status).phrase, "status": status, "detail": detail}
    body |= {"request_id": request} if (request := REQUEST_ID.get()) else {}
    body |= more or {}
    return JSONResponse(body, status, headers, media_type="application/problem+json")


def _named(request: Request, error: Exception) -> Response:
    status = next(status for kind, status in _STATUS if isinstance(error, kind))
    return problem_response(status, str(error), LATER if isinstance(error, BusyError | CatalogueBusyError) else None)


def _http(request: Request, error: Exception) -> Response:
    error = cast(HTTPException, error)
    detail = str(error.detail)
    if error.status_code == 404 and detail == HTTPStatus.NOT_FOUND.phrase:
        detail = f"there is nothing at {request.url.path}; /docs lists what there is"
    if isinstance(error.__cause__, UnicodeDecodeError | RecursionError):
        detail = f"the body is no JSON; {_an_object(request)}"
    return problem_response(error.status_code, detail, error.headers)


def _invalid(request: Request, error: Exception) -> Response:
    return problem_response(422, _in_words(request, cast(RequestValidationError, error).errors()))


def _is_of_a_job(request: Request) -> bool:
    return request.url.path.endswith(("/jobs", "/rerun"))


def _an_object(request: Request) -> str:
    return _AN_OBJECT.format(example=' such as {"kind": "identify"}' if _is_of_a_job(request) else "")


def _in_words(request: Request, errors: Sequence[Mapping[str, Any]]) -> str:
    """What is wrong with a request, and what to send instead."""
    first = errors[0]
    where = ".".join(str(part)[:_LONGEST_NAME] for part in first["loc"][1:]) or str(first["loc"][0])
    if first["type"] == "json_invalid":
        return f"the body is no JSON ({first['ctx']['error']}, at character {where}); {_an_object(request)}"
    if first["type"] == "value_error":
        return str(first["ctx"]["error"])
    if first["loc"] == ("body",):
        # Without its content type, JSON counts as text.
        return f"the body is missing or no JSON object; {_an_object(request)}"
    unknown = [str(one["loc"][-1])[:_LONGEST_NAME] for one in errors if one["type"] == "extra_forbidden"]
    more = f" and {len(unknown) - _MOST_NAMED} more" if len(unknown) > _MOST_NAMED else ""
    named = ", ".join(unknown[:_MOST_NAMED]) + more
    if unknown and not _is_of_a_job(request):
        return f"{named}: no such key here; GET /docs lists those there are"
    if unknown:
        known = ["kind", *(field.alias or name for name, field in JobChanges.model_fields.items())]
        near = difflib.get_close_matches(unknown[0], known, 1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(known)}"
        return f"{named}: no such key in a job; {hint}"
    return f"{where} is missing" if first["type"] == "missing" else f"{where}: {first['msg']}"


def unexpected_problem() -> Response:
    """An error that nobody thought of."""
    return problem_response(500, "an error of the service itself; its log has the details")


def _unexpected(request: Request, error: Exception) -> Response:
    return unexpected_problem()


def install(app: FastAPI) -> None:
    """Make every error of `app` a problem."""
    for kind, _ in _STATUS:
        app.add_exception_handler(kind, _named)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(Exception, _unexpected)
