"""Links that show one flight for some days to whoever has them: each is listed with its maker, and can be revoked."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from gcs.access.private_file import PrivateFile
from gcs.errors import SettingsError

PREFIX = "share."
_DAY_S = 86400.0
LONGEST_DAYS = 366.0
# Links of one maker that hold at a time.
_MOST_OF_ONE = 200


@dataclass(frozen=True)
class KnownShare:
    """One link. maker: the name of a token; since: when that was made, UTC s, 0 for one that is in no file.

    sha256: of its token. made, expires: UTC, s.
    """

    id: str
    maker: str
    since: float
    flight: str
    made: float
    expires: float
    sha256: str

    def shown(self) -> dict[str, object]:
        """What may be shown of it."""
        return {key: value for key, value in asdict(self).items() if key not in ("sha256", "since")}


class Shares:
    """The links of a station. path: their file, which need not be there. clock: UTC, s."""

    def __init__(self, path: Path, clock: Callable[[], float] = time.time) -> None:
        self._clock = clock
        self._file = PrivateFile(path, "shares", lambda entry: KnownShare(**entry))

    def known(self) -> tuple[KnownShare, ...]:
        """All that have not expired, in the order in which they were made. SettingsError for a file that is none."""
        return tuple(one for one in self._file.entries() if self._clock() < one.expires)

    def make(self, flight: str, days: float, maker: str, since: float = 0.0) -> tuple[str, KnownShare]:
        """Token of a new link to a flight, and its entry. SettingsError for one too long, or one too many."""
        if not 0.0 < days <= LONGEST_DAYS:
            raise SettingsError(f"days {days:g}: a link holds for more than 0 and up to {LONGEST_DAYS:g} days")
        token, now = f"{PREFIX}{secrets.token_urlsafe(32)}", self._clock()
        made = KnownShare(
            secrets.token_hex(4), maker, since, flight, now, float(int(now + days * _DAY_S)), _hash(token)
        )
        with self._file.alone():
            known = self.known()
            if sum((one.maker, one.since) == (maker, since) for one in known) >= _MOST_OF_ONE:
                raise SettingsError(f"{maker} has {_MOST_OF_ONE} links already; revoke some first")
            self._file.write([asdict(one) for one in (*known, made)])
        return token, made

    def revoke(self, share_id: str) -> None:
        """End a link. SettingsError where there is none of that id."""
        with self._file.alone():
            known = self.known()
            left = [asdict(one) for one in known if one.id != share_id]
            if len(left) == len(known):
                raise SettingsError(f"there is no link {share_id}; gcs token links shows those that there are")
            self._file.write(left)

    def find(self, text: str) -> KnownShare | None:
        """The link that a text is the token of, None for none and one that is over."""
        if not text.startswith(PREFIX):
            return None
        given, found = _hash(text), None
        for one in self.known():
            # All are compared, so that the time taken says nothing.
            if hmac.compare_digest(one.sha256, given):
                found = one
        return found


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
