"""One process at a time uses a data folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gcs import portable
from gcs.errors import ServiceError


@contextmanager
def sole_user(data: Path) -> Iterator[None]:
    """Hold the data folder; two services on one would take each other's jobs and flights for crashed ones.

    ServiceError if another process has it, or if it cannot be used.
    """
    try:
        data.mkdir(parents=True, exist_ok=True)
        lock = (data / "lock").open("a")
    except OSError as error:
        raise ServiceError(f"{data}: the data folder cannot be used ({error.strerror}); choose another") from error
    with lock:
        try:
            portable.lock(lock)
        except OSError as error:
            raise ServiceError(f"{data}: another service uses this data folder; stop it or choose another") from error
        yield
