"""Tokens with a name and a role, kept as hashes in a file beside the flights."""

from __future__ import annotations

import hashlib
import hmac
import json
import math
import os
import re
import secrets
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from gcs.access.roles import ROLES, Identity
from gcs.errors import SettingsError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@-]{0,63}")
_DAY_S = 86400.0


@dataclass(frozen=True)
class KnownToken:
    """One token. sha256: of its text, which has 256 bits of chance and needs no salt. created, expires: UTC, s."""

    name: str
    role: str
    sha256: str
    created: float
    expires: float | None = None

    def is_over(self, now: float) -> bool:
        """Whether it has expired."""
        return self.expires is not None and now >= self.expires


class TokenFile:
    """The tokens of a station; a file that changes while the service runs counts from its next request on.

    path: the file, which need not be there. clock: UTC, s.
    """

    def __init__(self, path: Path, clock: Callable[[], float] = time.time) -> None:
        self._path, self._clock = path, clock
        self._stamp: tuple[int, int, int] | None = None
        self._tokens: tuple[KnownToken, ...] = ()
        self._ever = False

    def ever(self) -> bool:
        """Whether there is the file, even one without a token left, or was since this began. SettingsError as `tokens`.

        Who takes the last one back closes the station; it never opens it to everybody.
        """
        self.tokens()
        self._ever = self._ever or self._stamp is not None
        return self._ever

    def tokens(self) -> tuple[KnownToken, ...]:
        """All tokens, in the order in which they were added. SettingsError for a file that is none."""
        try:
            status = self._path.stat()
        except FileNotFoundError:
            self._stamp, self._tokens = None, ()
            return ()
        stamp = (status.st_ino, status.st_mtime_ns, status.st_size)
        if stamp != self._stamp:
            self._tokens = self._read()
            self._stamp = stamp
        return self._tokens

    def identify(self, text: str) -> Identity | None:
        """Whose token a text is; None for nobody's, and for one that has expired."""
        given, found = _hash(text), None
        for one in self.tokens():
            # All are compared, so that the time taken says nothing.
            if hmac.compare_digest(one.sha256, given) and not one.is_over(self._clock()):
                found = Identity(one.name, ROLES[one.role])
        return found

    def add(self, name: str, role: str, days: float | None = None) -> str:
        """A new token, whose text is seen here only. SettingsError for a name that is taken or none, or no role."""
        if not _NAME.fullmatch(name):
            raise SettingsError(f"token name {name!r}: 1 to 64 letters, digits or _ . @ -, a letter or digit first")
        if role not in ROLES:
            raise SettingsError(f"role {role!r}: one of {', '.join(ROLES)}")
        if days is not None and not (math.isfinite(days) and days > 0.0):
            raise SettingsError(f"--days {days:g}: give how long the token holds, above 0")
        if any(one.name == name for one in self.tokens()):
            raise SettingsError(f"there is a token {name} already; revoke it first, or choose another name")
        text, now = secrets.token_urlsafe(32), self._clock()
        expires = None if days is None else now + days * _DAY_S
        self._write((*self.tokens(), KnownToken(name, role, _hash(text), now, expires)))
        return text

    def revoke(self, name: str) -> None:
        """Take a token back. SettingsError where there is none of that name."""
        left = tuple(one for one in self.tokens() if one.name != name)
        if len(left) == len(self.tokens()):
            raise SettingsError(f"there is no token {name}; gcs token list shows those that there are")
        self._write(left)

    def _read(self) -> tuple[KnownToken, ...]:
        try:
            data = json.loads(self._path.read_text(encoding="utf-8"))
            found = tuple(KnownToken(**entry) for entry in data["tokens"])
            if data["schema"] != "tokens/1" or any(one.role not in ROLES for one in found):
                raise ValueError
        except (OSError, ValueError, KeyError, TypeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "it is no file of gcs token"
            raise SettingsError(f"{self._path}: the tokens cannot be read: {reason}") from error
        return found

    def _write(self, tokens: tuple[KnownToken, ...]) -> None:
        body = json.dumps({"schema": "tokens/1", "tokens": [asdict(one) for one in tokens]}, indent=2) + "\n"
        beside = self._path.with_name(f"{self._path.name}.new")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
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
            raise SettingsError(f"{self._path}: the tokens cannot be written: {error.strerror}") from error


def without_hash(token: KnownToken) -> dict[str, object]:
    """What may be shown of a token."""
    return {key: value for key, value in asdict(replace(token, sha256="")).items() if key != "sha256"}


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
