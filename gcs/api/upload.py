"""Reception of an uploaded file: streamed to disk, its size limited before and while it comes."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import HTTPException, Request
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from gcs.api.service import Service
from gcs.errors import ServiceError
from gcs.jobs.places import Places
from gcs.jobs.programs import STOPPED
from gcs.recording.container import LOG_ENDINGS
from gcs.settings import Settings
from gcs.text.sizes import size_text

_WRITE_BYTES = 1 << 20
# What comes slower holds a place for ever: bytes a second, over so many seconds.
_LEAST_RATE, _WATCHED_S = 10_000, 60.0
_ENDINGS = (".mcap", *LOG_ENDINGS)


@asynccontextmanager
async def receive_upload(request: Request, service: Service, name: str) -> AsyncIterator[tuple[Path, str]]:
    """A temporary file with the upload, and the name that its sender gives it; the file is gone afterwards.

    The name is only ever shown and asked for its ending, one of those that are known, by which some readers go; no
    other part of it reaches the file system.
    """
    settings = service.settings
    settings.flights.mkdir(parents=True, exist_ok=True)
    declared = request.headers.get("content-length", "")
    if declared.isdecimal() and int(declared) > settings.max_upload_bytes:
        raise _too_large(settings)
    _leave_reserve(settings, int(declared) if declared.isdecimal() else 0)
    # Where a stop ends the wait for whoever still reads there, the rest is removed at the next start.
    with tempfile.TemporaryDirectory(prefix="upload-", dir=settings.data, ignore_cleanup_errors=True) as folder:
        path = Path(folder) / "upload"
        with path.open("wb") as file:
            target = _Target(request, name)
            received = 0
            pending = bytearray()
            async for chunk in _chunks(request, service.stopping, service.uploads.places):
                received += len(chunk)
                if received > settings.max_upload_bytes:
                    raise _too_large(settings)
                pending += target.content(chunk)
                if len(pending) >= _WRITE_BYTES:
                    _leave_reserve(settings, len(pending))
                    await run_in_threadpool(file.write, bytes(pending))
                    pending.clear()
            await run_in_threadpool(file.write, bytes(pending))
        target.check_complete()
        if path.stat().st_size == 0:
            raise HTTPException(422, target.nothing())
        # It is kept as a recording of about its own size.
        _leave_reserve(settings, path.stat().st_size)
        ending = Path(target.name).suffix.lower()
        yield path.rename(path.with_suffix(ending)) if ending in _ENDINGS else path, target.name


async def _chunks(request: Request, stopping: asyncio.Event, places: Places) -> AsyncIterator[bytes]:
    """The body as it comes. HTTP 400 where it breaks off, 408 where it hardly comes while others wait for a place.

    ServiceError once the service is to end: it waits no more.
    """
    stop = asyncio.ensure_future(stopping.wait())
    body = request.stream()
    began, received = time.monotonic(), 0
    coming: asyncio.Future[bytes] | None = None
    try:
        while True:
            coming = asyncio.ensure_future(anext(body, b""))
            await asyncio.wait((coming, stop), return_when=asyncio.FIRST_COMPLETED)
            chunk = coming.result() if coming.done() else b""
            if stop.done():
                raise ServiceError(STOPPED)
            if not chunk:  # its end
                return
            received += len(chunk)
            if time.monotonic() - began > _WATCHED_S:
                if received < _LEAST_RATE * _WATCHED_S and places.full:
                    slow = f"the file comes by less than {_LEAST_RATE // 1000} kB a second, and its place is needed"
                    raise HTTPException(408, f"{slow}; send it by a faster connection", {"Connection": "close"})
                began, received = time.monotonic(), 0
            yield chunk
    except ClientDisconnect:
        raise HTTPException(400, "the connection ended before the file did; send it again") from None
    finally:
        stop.cancel()
        if coming is not None:
            coming.cancel()


def _too_large(settings: Settings) -> HTTPException:
    return HTTPException(413, f"the file is larger than {settings.max_upload_bytes} bytes, the most that is taken")


def _leave_reserve(settings: Settings, size: int) -> None:
    """HTTP 507 where `size` more bytes would take of the disk what recordings keep in reserve."""
    free, reserve = shutil.disk_usage(settings.data).free, settings.storage.reserve_bytes
    if free < reserve + size:
        raise HTTPException(
            507,
            f"the disk has {size_text(free)} left, and {size_text(reserve)} are kept in reserve for what is recorded;"
            " free some space",
        )


class _Target:
    """Takes the file out of the request's body: the body itself, or the first file part of a form."""

    def __init__(self, request: Request, name: str) -> None:
        kind, options = parse_options_header(request.headers.get("content-type"))
        self.name = name
        self._parser: MultipartParser | None = None
        self._bytes = bytearray()
        self._headers: dict[bytes, bytes] = {}
        self._field = self._value = b""
        self._in_file = self._seen_file = self._ended = False
        if kind == b"multipart/form-data":
            if not options.get(b"boundary"):
                raise HTTPException(422, "the form has no boundary in its content type")
            self._parser = MultipartParser(
                options[b"boundary"],
                {
                    "on_part_begin": self._begin_part,
                    "on_part_data": self._data,
                    "on_part_end": self._end_part,
                    "on_header_field": self._header_field,
                    "on_header_value": self._header_value,
                    "on_header_end": self._header_end,
                    "on_headers_finished": self._headers_finished,
                    "on_end": self._end,
                },
            )

    def content(self, chunk: bytes) -> bytes:
        """The bytes of the file in the next chunk of the body."""
        if self._parser is None:
            return chunk
        try:
            self._parser.write(chunk)
        except FormParserError as error:
            raise HTTPException(422, f"the form is not well made ({error}); send the file as the body") from None
        taken = bytes(self._bytes)
        self._bytes.clear()
        return taken

    def check_complete(self) -> None:
        """HTTP 422 for a form that was cut off."""
        if self._parser is not None and not self._ended:
            raise HTTPException(422, "the form ends early; send it again")

    def nothing(self) -> str:
        """Why there is nothing to take in, and what to send."""
        if self._seen_file or self.name:
            return f"{self.name or 'the file'} is empty; send a recording that holds something"
        return "the upload holds no file; send it as the form's part 'file', or as the body"

    def _begin_part(self) -> None:
        self._headers = {}

    def _header_field(self, data: bytes, start: int, end: int) -> None:
        self._field += data[start:end]

    def _header_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _header_end(self) -> None:
        self._headers[self._field.lower()] = self._value
        self._field = self._value = b""

    def _headers_finished(self) -> None:
        _, options = parse_options_header(self._headers.get(b"content-disposition", b""))
        filename = options.get(b"filename")
        self._in_file = filename is not None and not self._seen_file
        if self._in_file and filename is not None:
            self._seen_file = True
            self.name = self.name or filename.decode("utf-8", "replace")

    def _data(self, data: bytes, start: int, end: int) -> None:
        if self._in_file:
            self._bytes += data[start:end]

    def _end_part(self) -> None:
        self._in_file = False

    def _end(self) -> None:
        self._ended = True
