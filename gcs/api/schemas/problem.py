"""The error that every answer may be."""

from __future__ import annotations

from pydantic import BaseModel, Field


class Problem(BaseModel):
    """An error (RFC 9457): `detail` is a sentence that says what to do."""

    type: str = "about:blank"
    title: str
    status: int
    detail: str
    request_id: str = Field("", description="The id of the request, as in X-Request-ID and the log")
