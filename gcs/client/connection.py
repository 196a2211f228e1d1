"""Where a station is and how it is asked: its address, the token, and what goes wrong on the way as one line."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import httpx
from pydantic import ValidationError

from gcs.api.schemas.problem import Problem
from gcs.client.steps import Request
from gcs.errors import SettingsError, StationError
from gcs.settings import usable_token
from gcs.text.jsontext import dumps
from gcs.text.one_line import one_line
from gcs.version import VERSION

# Whoever reads an uploaded log may take half an hour, and answers behind it.
_UPLOAD_READ_S = 1860.0
_LONGEST_LINE = 600


class Connection:
    """One station's address and token. timeout: how long it may be silent, s. The token is in no text of it."""

    def __init__(self, url: str, token: str, timeout: float) -> None:
        if not timeout > 0:
            raise SettingsError(f"timeout {timeout}: give a time above 0 s")
        self.url = _address(url)
        self._token = usable_token(token) if token else ""
        self._timeout = timeout

    def settings(self) -> dict[str, Any]:
        """What a client of httpx is made with."""
        headers = {"User-Agent": f"gcs/{VERSION}", "Accept": "application/json, application/octet-stream"}
        if self._token:
            headers["Authorization"] = f"Bearer {self._token}"
        return {"base_url": self.url, "headers": headers, "timeout": self._timeout}

    def arguments(self, request: Request) -> dict[str, Any]:
        """What httpx is called with; the body of an upload is the caller's."""
        query = {key: _in_query(value) for key, value in request.query.items() if value is not None and value != ""}
        found: dict[str, Any] = {"method": request.method, "url": request.path, "params": query}
        if request.body is not None:
            found |= {"content": dumps(request.body).encode(), "headers": {"Content-Type": "application/json"}}
        if request.upload is not None:
            found["headers"] = {
                "Content-Length": str(request.upload.size),
                "Content-Type": "application/octet-stream",
            }
            found["timeout"] = httpx.Timeout(self._timeout, read=max(self._timeout, _UPLOAD_READ_S))
        return found

    @contextmanager
    def failures(self) -> Iterator[None]:
        """Raises StationError for what goes wrong on the way in the block."""
        try:
            yield
        except httpx.ConnectTimeout as error:
            raise self._error(f"nobody answers at {self.url} within {self._timeout:g} s") from error
        except httpx.TimeoutException as error:
            raise self._error(f"{self.url} took the connection, but was silent for {self._timeout:g} s") from error
        except httpx.ConnectError as error:
            why = f"{self.url} cannot be reached ({error}); look at the address, and whether the service runs there"
            raise self._error(why) from error
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            reason = str(error) or type(error).__name__
            raise self._error(f"the connection with {self.url} failed ({reason}); try again") from error

    def refusal(self, status: int, content: bytes) -> StationError:
        """The error that an answer without success is. content: its body."""
        if status == 401:
            why = "and it is not the one given" if self._token else "and none was given (token=, --token-file)"
            return self._error(f"{self.url} demands its token, {why}", status)
        if 300 <= status < 400:
            return self._error(f"{self.url} sends elsewhere (HTTP {status}); give the address it sends to", status)
        try:
            detail = Problem.model_validate_json(content).detail
        except ValidationError:
            why = f"{self.url} answers with HTTP {status} and no reason; is it a ground station's address?"
            return self._error(why, status)
        return self._error(detail, status)

    def _error(self, text: str, status: int | None = None) -> StationError:
        """An error as one line, without the token even where the other side repeats it."""
        line = one_line(text)
        line = line.replace(self._token, "TOKEN") if self._token else line
        return StationError(line if len(line) <= _LONGEST_LINE else f"{line[:_LONGEST_LINE]}…", status)


def _in_query(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _address(url: str) -> str:
    """The address with its scheme. Raises SettingsError for what is none."""
    whole = url.strip() if "://" in url else f"http://{url.strip()}"
    wanted = f"{one_line(url)!r} is no address of a station; write it as http://HOST:8000"
    try:
        parts = urlsplit(whole)
        right = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0 and not re.search(r"\s", whole)
        httpx.URL(whole)
    except (ValueError, httpx.InvalidURL):
        raise SettingsError(wanted) from None
    if parts.username is not None or parts.password is not None:  # which may be a secret, so it is not repeated
        raise SettingsError("the address of a station holds no name or password; its token is given beside it")
    if not right or parts.query or parts.fragment:
        raise SettingsError(wanted)
    return whole.rstrip("/")
