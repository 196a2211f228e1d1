"""Lists of secrets' hashes: JSON that its owner alone may read, there as a whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, TypeVar

from gcs import portable
from gcs.errors import SettingsError

Entry = TypeVar("Entry")


class PrivateFile(Generic[Entry]):
    """The entries of a file, which need not be there; one that changes meanwhile is read again when it is asked.

    name: the key of its list, and what it holds, in words. read: makes an entry of an object, ValueError or TypeError
    where it is none.
    """

    def __init__(self, path: Path, name: str, read: Callable[[Mapping[str, Any]], Entry]) -> None:
        self._path, self._name, self._read_one = path, name, read
        self._stamp: tuple[int, int, int] | None = None
        self._entries: tuple[Entry, ...] = ()

    @property
    def there(self) -> bool:
        """Whether there was the file when it was read last."""
        return self._stamp is not None

    def entries(self) -> tuple[Entry, ...]:
        """All entries, in the order in which they were added. SettingsError for a file that is none."""
        try:
            status = self._path.stat()
        except FileNotFoundError:
            self._stamp, self._entries = None, ()
            return ()
        stamp = (status.st_ino, status.st_mtime_ns, status.st_size)
        if stamp != self._stamp:
            self._entries = self._read()
            self._stamp = stamp
        return self._entries

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Hold off other processes, and threads, that change a file of the same folder: none takes a change back."""
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with portable.held(self._path.parent):
                yield
        except OSError as error:
            raise SettingsError(f"{self._path}: the {self._name} cannot be written: {error.strerror}") from error

    def write(self, entries: Sequence[Mapping[str, Any]]) -> None:
        """Put other entries in the place of all. SettingsError where that fails."""
        body = json.dumps({"schema": f"{self._name}/1", self._name: list(entries)}, indent=2) + "\n"
        beside = self._path.with_name(f"{self._path.name}.new")
        try:
            with os.fdopen(
                os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="utf-8"
            ) as file:
                file.write(body)
                if hasattr(os, "fchown") and os.geteuid() == 0:
                    # Made by root for a service that runs as somebody else: whoever has the folder reads it.
                    folder = self._path.parent.stat()
                    os.fchown(file.fileno(), folder.st_uid, folder.st_gid)
                file.flush()
                os.fsync(file.fileno())
            beside.replace(self._path)
        except OSError as error:
            beside.unlink(missing_ok=True)
            raise SettingsError(f"{self._path}: the {self._name} cannot be written: {error.strerror}") from error

    def _read(self) -> tuple[Entry, ...]:
        try:
            data = json.loads(self._path.read_text(encoding="utf-8"))
            found = tuple(self._read_one(entry) for entry in data[self._name])
            if data["schema"] != f"{self._name}/1":
                raise ValueError
        except (OSError, ValueError, KeyError, TypeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "it is no file of gcs token"
            raise SettingsError(f"{self._path}: the {self._name} cannot be read: {reason}") from error
        return found
