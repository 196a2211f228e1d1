"""Progress on standard error: a bar where a person watches, plain lines elsewhere."""

from __future__ import annotations

import os
import sys
import time
from types import TracebackType
from typing import TextIO

_WIDTH = 24


class Progress:
    """Called with a fraction (0..1) and a line of text; a context manager that leaves the terminal clean.

    watched: whether the stream is a terminal that takes control codes. after_s: work that is done sooner shows nothing.
    silent: whether nothing is shown at all, in the whole process.
    """

    silent = False

    def __init__(self, stream: TextIO | None = None, after_s: float = 0.0) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._starts = time.monotonic() + after_s
        self.watched = self._stream.isatty() and os.environ.get("TERM") != "dumb" and not self.silent
        self._shown = ""

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.watched and self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()

    def __call__(self, fraction: float, text: str) -> None:
        if self.silent or time.monotonic() < self._starts:
            return
        fraction = min(max(fraction, 0.0), 1.0)
        if self.watched:
            done = round(_WIDTH * fraction)
            self._shown = f"[{'#' * done}{' ' * (_WIDTH - done)}] {100 * fraction:3.0f} % {text}"
            self._stream.write(f"\r{self._shown}\x1b[K")
        elif text and text != self._shown:
            self._shown = text
            self._stream.write(f"{100 * fraction:3.0f} % {text}\n")
        self._stream.flush()
