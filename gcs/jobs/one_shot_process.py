"""A program that is asked one thing and answers it: started for it, in memory and time bounded, gone afterwards.

It reads one JSON line on its standard input and answers JSON lines on its standard output; closing its input ends it,
so none outlives the service.
"""

from __future__ import annotations

import json
import subprocess
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from gcs.errors import GcsError, ServiceError
from gcs.jobs.programs import STOPPED, Program, begin
from gcs.jobs.runner import last_words
from gcs.text.jsontext import dumps

# What a file says of itself comes in the answer; the service keeps that in memory.
_LONGEST_ANSWER = 4_000_000


class AskedOnce:
    """Asks a program, one question at a time.

    command: the program. longest_s: what an answer may take.
    """

    def __init__(self, command: Sequence[str], longest_s: float) -> None:
        self._command, self._longest_s = tuple(command), longest_s
        self._turn, self._lock = threading.Lock(), threading.Lock()
        self._process: Program | subprocess.Popen[str] | None = None
        self._closed = False

    def ask(self, order: Mapping[str, Any], folder: Path, what: str, failed: type[GcsError]) -> dict[str, Any]:
        """All that the program answers, its lines put together.

        folder: where its output may be kept meanwhile. what: what it reads, for its errors. Raises `failed` with what
        the program names as its `error`, or with what became of it; ServiceError when the service is being stopped.
        """
        answer, errors = folder / "answer", folder / "errors"
        with self._turn, answer.open("w") as stdout, errors.open("w") as stderr:
            code = self._run(dumps(order) + "\n", stdout.fileno(), stderr.fileno(), what, failed)
        if answer.stat().st_size > _LONGEST_ANSWER:
            raise failed(f"{what} says more of itself than anybody can read; it is not what it seems")
        answered: dict[str, Any] = {}
        for line in answer.read_text(encoding="utf-8", errors="replace").splitlines():
            try:
                said = json.loads(line)
            except json.JSONDecodeError:  # a library that prints
                continue
            answered |= said if isinstance(said, dict) else {}
        if "error" in answered:
            raise failed(str(answered["error"]))
        if code != 0 or not answered:
            raise failed(f"{what} cannot be read: {last_words(code, errors)}")
        return answered

    def close(self) -> None:
        """End what is being answered; nothing more is asked."""
        with self._lock:
            self._closed = True
            if self._process is not None:
                self._process.kill()

    def _run(self, order: str, stdout: int, stderr: int, what: str, failed: type[GcsError]) -> int:
        """Run the program; its exit code."""
        process = begin(self._command, stdout, stderr)
        with self._lock:
            self._process = process
            if self._closed:
                process.kill()
        assert process.stdin is not None
        try:
            process.stdin.write(order)
            process.stdin.flush()
            code = process.wait(self._longest_s)
        except subprocess.TimeoutExpired:
            raise failed(f"{what} was not read within {self._longest_s:g} s; work on it by hand") from None
        except BrokenPipeError:  # it died at its start; exit code and last words say why
            code = process.wait()
        finally:
            process.kill()
            process.wait()
            with suppress(BrokenPipeError):  # closing writes what the dead program did not take
                process.stdin.close()
            with self._lock:
                self._process = None
        if self._closed:
            raise ServiceError(STOPPED)
        return code
