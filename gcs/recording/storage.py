"""How recordings are kept on disk: when it must have them, their size, and the space that is left free."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.errors import SettingsError

DEFAULT_SYNC = "5"
DEFAULT_RESERVE_BYTES = 64 * 2**20
SMALLEST_SPLIT_BYTES = 10**6


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


@dataclass(frozen=True)
class StorageOptions:
    """How recordings are kept on disk.

    sync: when the disk must have them. split_bytes: size at which another part is begun, None for one file.
    reserve_bytes: free space that is left on the disk.
    """

    sync: SyncPolicy = field(default_factory=lambda: SyncPolicy.parse(DEFAULT_SYNC))
    split_bytes: int | None = None
    reserve_bytes: int = DEFAULT_RESERVE_BYTES
