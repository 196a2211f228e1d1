"""Files on their way to and from a station, piece by piece: none is held in memory."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeAlias
from uuid import uuid4

_PIECE_BYTES = 1 << 18

# Called with a fraction (0..1) and a line of text, as gcs.text.progress.Progress is.
OnProgress: TypeAlias = Callable[[float, str], None]


@dataclass(frozen=True)
class Upload:
    """A file to send; of one that grows meanwhile, as much as there was."""

    path: Path
    size: int
    on_progress: OnProgress | None = None

    @classmethod
    def of(cls, path: Path, on_progress: OnProgress | None = None) -> Upload:
        """The file at a path. Raises OSError where it cannot be read."""
        with path.open("rb") as file:
            return cls(path, os.fstat(file.fileno()).st_size, on_progress)

    def pieces(self) -> Iterator[bytes]:
        """The file's content."""
        left = self.size
        with self.path.open("rb") as file:
            while left and (piece := file.read(min(left, _PIECE_BYTES))):
                left -= len(piece)
                yield piece

    def progress(self, sent: int) -> None:
        """Say how much has been sent."""
        if self.on_progress is not None:
            self.on_progress(sent / max(self.size, 1), "sending" if sent < self.size else "sent; the station reads it")


class Received:
    """The body of an answer: kept, or written to a file."""

    def __init__(self, file: IO[bytes] | None = None) -> None:
        self._file = file
        self._kept = bytearray()

    def take(self, piece: bytes) -> None:
        """The next bytes."""
        if self._file is None:
            self._kept += piece
        else:
            self._file.write(piece)

    @property
    def content(self) -> bytes:
        """What was kept."""
        return bytes(self._kept)


@contextmanager
def received(target: Path | None) -> Iterator[Received]:
    """Takes an answer; a file appears at `target`, in place of what was there, once the whole of it has come.

    Raises OSError where the file cannot be written.
    """
    if target is None:
        yield Received()
        return
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(target))
    beside = target.with_name(f".{target.name}.{uuid4().hex[:8]}")
    try:
        with beside.open("wb") as file:
            yield Received(file)
        os.replace(beside, target)
    finally:
        with suppress(FileNotFoundError):
            beside.unlink()
