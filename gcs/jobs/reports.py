"""What the REST interface makes of a result, each in a process of its own: drawing would make reception wait."""

from __future__ import annotations

import hashlib
import json
import logging
import sys
import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from tempfile import TemporaryFile
from typing import Any

from gcs.errors import BusyError, ExportError, ReportError, ServiceError
from gcs.jobs.programs import begin
from gcs.jobs.runner import end_late
from gcs.text.jsontext import dumps

_LONGEST_S = 120.0
# So many wait for theirs at a time; each of them keeps a thread that others need.
_MOST_WAITING = 4
# The command that makes the same, where it is called otherwise.
_BY_HAND = {"tuning": "tune"}
# Sheets of some 20 to 200 kB that are asked for again: the tab opened anew, the file beside the table.
_MOST_KEPT = 16
_BUSY = "other reports are being made; ask again in a minute"
# Exit code of the worker where the result does not give it; the reason is its last line on standard error.
NOT_GIVEN = 3

_log = logging.getLogger(__name__)


class Reports:
    """Makes one page or sheet at a time, and keeps the last sheets. `worker` is the command that makes it."""

    def __init__(self, worker: Sequence[str] = (sys.executable, "-m", "gcs.jobs.reportworker")) -> None:
        self._worker = tuple(worker)
        self._free, self._places = threading.Lock(), threading.BoundedSemaphore(_MOST_WAITING)
        self._kept: OrderedDict[str, str] = OrderedDict()

    def page(self, result: dict[str, Any]) -> str:
        """The result as one HTML page.

        Raises ReportError where it cannot be shown, BusyError where others are still waiting for theirs.
        """
        return self._in_turn("report", dumps({"make": "report", "result": result, "settings": {}}))

    def sheet(self, kind: str, result: dict[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
        """What follows from the model of a result of gcs identify: the JSON of schema tuning/1, margins/1 or
        performance/1. kind: its name; settings: what is asked of it beside the result.

        Raises ExportError where the result does not give it, BusyError where others are still waiting for theirs.
        """
        asked = dumps({"make": kind, "result": result, "settings": settings})
        key = hashlib.sha256(asked.encode()).hexdigest()
        text = self._kept.get(key)
        if text is None:
            try:
                text = self._in_turn(kind, asked)
            except ReportError as error:
                raise ExportError(str(error)) from error
            self._kept[key] = text
            while len(self._kept) > _MOST_KEPT:
                self._kept.popitem(last=False)
        return dict(json.loads(text))

    def _in_turn(self, kind: str, asked: str) -> str:
        if not self._places.acquire(blocking=False):
            raise BusyError(_BUSY)
        try:
            if not self._free.acquire(timeout=_LONGEST_S):
                raise BusyError(_BUSY)
            try:
                return self._made(kind, asked)
            finally:
                self._free.release()
        finally:
            self._places.release()

    def _made(self, kind: str, asked: str) -> str:
        late = threading.Event()
        with (
            TemporaryFile("w+", encoding="utf-8") as errors,
            begin(self._worker, None, errors.fileno()) as process,
        ):
            assert process.stdin is not None
            assert process.stdout is not None
            watchdog = threading.Timer(_LONGEST_S, end_late, (process, late))
            watchdog.start()
            try:
                with suppress(BrokenPipeError):  # it died at its start; its last words say why
                    process.stdin.write(asked)
                    process.stdin.close()
                page = str(process.stdout.read())
                code = process.wait()
            finally:
                watchdog.cancel()
            errors.seek(0)
            lines = errors.read().strip().splitlines()
        if late.is_set():
            raise ServiceError(
                f"it was not made within {_LONGEST_S:g} s; make it by hand with gcs {_BY_HAND.get(kind, kind)}"
            )
        if code == NOT_GIVEN and lines:
            raise ReportError(lines[-1])
        if code != 0:
            _log.error("gcs %s failed (exit code %s): %s", _BY_HAND.get(kind, kind), code, " / ".join(lines[-20:]))
            raise ServiceError(
                f"it could not be made (exit code {code}), and the station's log says where that failed; make it by"
                f" hand with gcs {_BY_HAND.get(kind, kind)}"
            )
        return page
