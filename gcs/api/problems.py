"""Errors as application/problem+json (RFC 9457), each with a sentence."""

from __future__ import annotations

from collections.abc import Mapping
from http import HTTPStatus
from typing import cast

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException

from gcs.errors import (
    CatalogueError,
    CatalogueFileError,
    GcsError,
    ImportFileError,
    JobError,
    RecordingDeletedError,
    RecordingError,
    ServiceError,
    SignalMapError,
)
from sim_vehicle.errors import SimVehicleError
from sysid.errors import SysidError

_STATUS: tuple[tuple[type[Exception], int], ...] = (
    (CatalogueError, 404),
    (CatalogueFileError, 503),
    (ServiceError, 503),
    (RecordingDeletedError, 410),
    (SignalMapError, 404),
    (JobError, 409),
    (ImportFileError, 422),
    (RecordingError, 422),
    (GcsError, 400),
    (SysidError, 422),
    (SimVehicleError, 422),
)


def problem_response(status: int, detail: str, headers: Mapping[str, str] | None = None) -> Response:
    """An error as JSON with the sentence `detail`."""
    body = {"type": "about:blank", "title": HTTPStatus(status).phrase, "status": status, "detail": detail}
    return JSONResponse(body, status, headers, media_type="application/problem+json")


def _named(request: Request, error: Exception) -> Response:
    status = next(status for kind, status in _STATUS if isinstance(error, kind))
    return problem_response(status, str(error))


def _http(request: Request, error: Exception) -> Response:
    error = cast(HTTPException, error)
    detail = str(error.detail)
    if error.status_code == 404 and detail == HTTPStatus.NOT_FOUND.phrase:
        detail = f"there is nothing at {request.url.path}; /docs lists what there is"
    return problem_response(error.status_code, detail, error.headers)


def _invalid(request: Request, error: Exception) -> Response:
    first = cast(RequestValidationError, error).errors()[0]
    where = ".".join(str(part) for part in first["loc"][1:]) or str(first["loc"][0])
    return problem_response(422, f"{where}: {first['msg']}")


def _unexpected(request: Request, error: Exception) -> Response:
    return problem_response(500, "an error of the service itself; its log has the details")


def install(app: FastAPI) -> None:
    """Make every error of `app` a problem."""
    for kind, _ in _STATUS:
        app.add_exception_handler(kind, _named)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(Exception, _unexpected)
