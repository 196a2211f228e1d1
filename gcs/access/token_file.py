"""Tokens with a name and a role, kept as hashes in a file beside the flights."""

from __future__ import annotations

import hashlib
import hmac
import math
import re
import secrets
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from gcs.access.private_file import PrivateFile
from gcs.access.roles import ROLES, Identity
from gcs.errors import SettingsError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@-]{0,63}")
_DAY_S = 86400.0
#: Name of the token that the service was started with, which is in no file.
STATION = "GCS_TOKEN"


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
        self._clock = clock
        self._file = PrivateFile(path, "tokens", _token)
        self._ever = False

    def ever(self) -> bool:
        """Whether there is the file, even one without a token left, or was since this began. SettingsError as `tokens`.

        Who takes the last one back closes the station; it never opens it to everybody.
        """
        self.tokens()
        self._ever = self._ever or self._file.there
        return self._ever

    def tokens(self) -> tuple[KnownToken, ...]:
        """All tokens, in the order in which they were added. SettingsError for a file that is none."""
        return self._file.entries()

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
        if not _NAME.fullmatch(name) or name == STATION:
            raise SettingsError(
                f"token name {name!r}: 1 to 64 letters, digits or _ . @ -, a letter or digit first, and not {STATION}"
            )
        if role not in ROLES:
            raise SettingsError(f"role {role!r}: one of {', '.join(ROLES)}")
        if days is not None and not (math.isfinite(days) and days > 0.0):
            raise SettingsError(f"--days {days:g}: give how long the token holds, above 0")
        text, now = secrets.token_urlsafe(32), self._clock()
        expires = None if days is None else now + days * _DAY_S
        with self._file.alone():
            if any(one.name == name for one in self.tokens()):
                raise SettingsError(f"there is a token {name} already; revoke it first, or choose another name")
            self._write((*self.tokens(), KnownToken(name, role, _hash(text), now, expires)))
        return text

    def revoke(self, name: str) -> None:
        """Take a token back. SettingsError where there is none of that name."""
        with self._file.alone():
            left = tuple(one for one in self.tokens() if one.name != name)
            if len(left) == len(self.tokens()):
                raise SettingsError(f"there is no token {name}; gcs token list shows those that there are")
            self._write(left)

    def good(self, name: str) -> KnownToken | None:
        """The token of a name, None where there is none, or it has expired."""
        return next((one for one in self.tokens() if one.name == name and not one.is_over(self._clock())), None)

    def _write(self, tokens: tuple[KnownToken, ...]) -> None:
        self._file.write([asdict(one) for one in tokens])


def _token(entry: Mapping[str, Any]) -> KnownToken:
    found = KnownToken(**entry)
    if found.role not in ROLES:
        raise ValueError
    return found


def without_hash(token: KnownToken) -> dict[str, object]:
    """What may be shown of a token."""
    return {key: value for key, value in asdict(replace(token, sha256="")).items() if key != "sha256"}


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
