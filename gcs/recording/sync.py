"""When a recording being written is forced from the system's memory onto the disk."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.errors import SettingsError

DEFAULT_SYNC = "5"
SYNC_HELP = (
    "when the disk must have what was written: never, close (at the end of a file), chunk (each chunk), "
    f"or every so many seconds and at the end ({DEFAULT_SYNC})"
)


@dataclass(frozen=True)
class SyncPolicy:
    """every_s: longest time between two fdatasync calls, s; 0 for every chunk, None for none before the end.

    at_close: whether a finished file is forced to disk. A process that dies loses nothing of what was handed to
    the system either way; this is about a power cut.
    """

    every_s: float | None = None
    at_close: bool = False

    @classmethod
    def parse(cls, text: str) -> SyncPolicy:
        """never, close, chunk, or a number of seconds above 0; SettingsError otherwise."""
        if text == "never":
            return cls()
        if text == "close":
            return cls(at_close=True)
        if text == "chunk":
            return cls(0.0, at_close=True)
        try:
            seconds = float(text)
        except ValueError:
            seconds = 0.0
        if not 0.0 < seconds <= 3600.0:
            raise SettingsError(f"--fsync {text}: write never, close, chunk, or a number of seconds up to 3600")
        return cls(seconds, at_close=True)
