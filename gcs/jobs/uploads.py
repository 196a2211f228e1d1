"""Uploads on their way into the catalogue: read in a process of their own, then given an id that nobody else has."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gcs.catalogue.flight_table import Flight
from gcs.catalogue.intake import flight_stamp, numbered_ids
from gcs.catalogue.store import Catalogue
from gcs.errors import ImportFileError, ServiceError
from gcs.jobs.limits import memory_limit
from gcs.jobs.runner import last_words, python_path
from gcs.settings import Settings
from gcs.text.jsontext import dumps

_MAX_NAME = 200
# The largest upload takes minutes; what takes longer never ends.
_LONGEST_S = 1800.0
# What file systems say that have one name for each file (FAT, some network shares).
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.ENOSYS)


class Uploads:
    """Turns uploaded files into flights, one at a time. `worker` is the command that reads one.

    longest_s, memory_bytes: what reading one may take; memory as `memory_limit` has it unless said otherwise.
    """

    def __init__(
        self,
        settings: Settings,
        catalogue: Catalogue,
        worker: Sequence[str] = (sys.executable, "-m", "gcs.jobs.intakeworker"),
        longest_s: float = _LONGEST_S,
        memory_bytes: int | None = None,
    ) -> None:
        self._settings = settings
        self._catalogue = catalogue
        self._worker = tuple(worker)
        self._longest_s = longest_s
        self._memory_bytes = memory_bytes or memory_limit()
        self._turn = threading.Lock()
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._closed = False

    def take_in(self, upload: Path, original_name: str) -> Flight:
        """Make an uploaded file a flight of the catalogue. The original name is shown, never used as a path.

        Further files are made beside `upload`. Raises ImportFileError when it is no recording, ServiceError when the
        service is being stopped, CatalogueFileError; no flight is left behind then.
        """
        shown = original_name.replace("\\", "/").rpartition("/")[2][:_MAX_NAME] or "upload.mcap"
        converted = upload.with_name("converted.mcap")
        with self._turn:
            entry = Flight(**self._read(upload, converted, shown))
        if entry.messages == 0:
            raise ImportFileError(f"{shown} holds no MAVLink message; nothing to take in")
        return self._list(entry, converted)

    def close(self) -> None:
        """End what is being read; nothing more is taken in."""
        with self._lock:
            self._closed = True
            if self._process is not None:
                self._process.kill()

    def _read(self, upload: Path, converted: Path, shown: str) -> dict[str, Any]:
        """Write the recording to `converted`; its entry in the catalogue, as JSON."""
        answer, errors = upload.with_name("answer"), upload.with_name("errors")
        order = {
            "source": upload,
            "target": converted,
            "ending": Path(shown).suffix,
            "name": shown,
            "memory_bytes": self._memory_bytes,
        }
        with answer.open("w") as stdout, errors.open("w") as stderr:
            code = self._run(dumps(order) + "\n", stdout.fileno(), stderr.fileno())
        answered: dict[str, Any] = {}
        for line in answer.read_text(encoding="utf-8", errors="replace").splitlines():
            try:
                said = json.loads(line)
            except json.JSONDecodeError:  # a library that prints
                continue
            answered |= said if isinstance(said, dict) else {}
        if "error" in answered:
            raise ImportFileError(str(answered["error"]).replace(str(upload), shown))
        if code != 0 or "flight" not in answered:
            raise ImportFileError(f"{shown} cannot be read: {last_words(code, errors)}")
        return dict(answered["flight"])

    def _run(self, order: str, stdout: int, stderr: int) -> int:
        """Run the worker; its exit code."""
        with self._lock:
            if self._closed:
                raise ServiceError("the service is being stopped; send the file again when it is back")
            process = subprocess.Popen(
                self._worker,
                stdin=subprocess.PIPE,
                stdout=stdout,
                stderr=stderr,
                text=True,
                env={**os.environ, "PYTHONPATH": python_path()},
            )
            self._process = process
        assert process.stdin is not None
        try:
            process.stdin.write(order)
            process.stdin.flush()
            code = process.wait(self._longest_s)
        except subprocess.TimeoutExpired:
            raise ImportFileError(f"the file was not read within {self._longest_s:g} s; import it by hand") from None
        except BrokenPipeError:  # it died at its start; exit code and last words say why
            code = process.wait()
        finally:
            process.kill()
            process.communicate()
            with self._lock:
                self._process = None
        if self._closed:
            raise ServiceError("the service is being stopped; send the file again when it is back")
        return code

    def _list(self, entry: Flight, converted: Path) -> Flight:
        """Give the flight an id, which is taken in the catalogue first, and the recording its place."""
        folder = self._settings.flights
        for flight_id in numbered_ids(f"{flight_stamp(entry.start_ns)}-{entry.system or 0}"):
            path = folder / f"{flight_id}.mcap"
            reserved = replace(entry, id=flight_id, file=path.name)
            if path.exists() or not self._catalogue.add_flight(reserved):
                continue
            try:
                _place(converted, path)
                break
            except FileExistsError:
                self._catalogue.remove_flight(flight_id)
            except OSError as error:
                self._catalogue.remove_flight(flight_id)
                raise ImportFileError(f"{entry.name} cannot be kept: {error.strerror}; is the disk full?") from error
        flight = replace(reserved, state="complete")
        self._catalogue.put_flight(flight)
        return flight


def _place(source: Path, target: Path) -> None:
    """Move a file to a name that nothing has: not over a recording that was begun meanwhile. FileExistsError else."""
    try:
        os.link(source, target)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        target.open("xb").close()
        try:
            os.replace(source, target)
        except OSError:
            target.unlink(missing_ok=True)
            raise
    else:
        source.unlink()
