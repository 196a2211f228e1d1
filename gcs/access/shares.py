"""Links that show one flight for some days to whoever has them: signed, nothing is kept of them."""

from __future__ import annotations

import base64
import hashlib
import hmac
import os
import secrets
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from gcs.access.roles import Identity, Role
from gcs.errors import SettingsError

PREFIX = "share."
_DAY_S = 86400.0
LONGEST_DAYS = 366.0
_KEY_BYTES = 32


class Shares:
    """Makes and reads the tokens of such links.

    key: file with the key of the signatures, made when the first link is; to delete it ends all of them. clock: UTC, s.
    """

    def __init__(self, key: Path, clock: Callable[[], float] = time.time) -> None:
        self._file, self._clock = key, clock

    def make(self, flight: str, days: float) -> tuple[str, float]:
        """Token of a link to a flight, and until when it holds, UTC s. SettingsError where that is too long."""
        if not 0.0 < days <= LONGEST_DAYS:
            raise SettingsError(f"days {days:g}: a link holds for more than 0 and up to {LONGEST_DAYS:g} days")
        expires = int(self._clock() + days * _DAY_S)
        claim = f"{_coded(flight.encode())}.{expires}"
        return f"{PREFIX}{claim}.{_coded(self._signed(claim, self._key(make=True)))}", float(expires)

    def identify(self, text: str) -> Identity | None:
        """Who comes with a link; None where it is forged, has expired or is none."""
        claim, _, signature = text.removeprefix(PREFIX).rpartition(".")
        key = self._key(make=False) if text.startswith(PREFIX) else b""
        if not key or not hmac.compare_digest(
            _coded(self._signed(claim, key)).encode(), signature.encode(errors="replace")
        ):
            return None
        flight, _, expires = claim.partition(".")
        if self._clock() >= int(expires):
            return None
        name = base64.urlsafe_b64decode(flight + "=" * (-len(flight) % 4)).decode()
        return Identity(f"link to {name}", Role.VIEWER, name)

    def _signed(self, claim: str, key: bytes) -> bytes:
        return hmac.new(key, claim.encode(), hashlib.sha256).digest()

    def _key(self, *, make: bool) -> bytes:
        try:
            key = self._file.read_bytes()
        except FileNotFoundError:
            if not make:
                return b""
            key = self._made()
        except OSError as error:
            raise SettingsError(f"{self._file}: the key of shared links cannot be read: {error.strerror}") from error
        if len(key) != _KEY_BYTES:
            raise SettingsError(f"{self._file}: is no key of shared links; delete it, which ends those that there are")
        return key

    def _made(self) -> bytes:
        """A new key, or that of another process which was first; it is there as a whole or not at all."""
        beside = self._file.with_name(f"{self._file.name}.{secrets.token_hex(4)}")
        try:
            with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
                file.write(secrets.token_bytes(_KEY_BYTES))
            with suppress(FileExistsError):
                os.link(beside, self._file)
            return self._file.read_bytes()
        except OSError as error:
            raise SettingsError(f"{self._file}: no key for shared links can be made: {error.strerror}") from error
        finally:
            beside.unlink(missing_ok=True)


def _coded(data: bytes) -> str:
    return base64.urlsafe_b64encode(data).decode().rstrip("=")
