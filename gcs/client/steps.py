"""What an operation consists of: requests and pauses, one after the other, whoever sends them and however.

An operation is a generator. It yields a step, is handed the body of the answer (or a StationError), and returns its
result; so it is written once for all clients.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from pydantic import TypeAdapter, ValidationError

from gcs.client.transfer import Upload
from gcs.errors import StationError

T = TypeVar("T")


@dataclass(frozen=True)
class Request:
    """One request. query: what is None or empty is left out. body: sent as JSON. target: file for the answer."""

    method: str
    path: str
    query: Mapping[str, Any] = field(default_factory=dict)
    body: Mapping[str, Any] | None = None
    upload: Upload | None = None
    target: Path | None = None


@dataclass(frozen=True)
class Pause:
    """Some time in which nothing is asked."""

    seconds: float


Steps: TypeAlias = Generator[Request | Pause, bytes, T]


def answer(kind: type[T], request: Request) -> Steps[T]:
    """Ask, and read the answer as JSON of that kind. Raises StationError where it is none."""
    content = yield request
    try:
        return TypeAdapter(kind).validate_json(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise StationError(
            f"the answer to {request.method} {request.path} is not a ground station's of this version"
            f" ({f'{where}: ' if where else ''}{first['msg']}); look at the address, and at both versions"
        ) from None


def done(request: Request) -> Steps[None]:
    """Ask for what has no answer but that it is done."""
    yield request
