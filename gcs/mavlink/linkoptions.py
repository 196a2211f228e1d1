"""How the frames of the links are understood and made."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.mavlink.dialect import DEFAULT_DIALECT


@dataclass(frozen=True)
class LinkOptions:
    """How frames are understood and made.

    dialect: name of one that pymavlink ships, or path of an XML. key: what signatures are checked with, None to count
    signed frames only; it is in no output and no recording. sign: whether the station signs what it says itself.
    require_signed: whether frames without a good signature are recorded only: they name no vehicle, move no clock, cut
    no flight, and are not passed on.
    """

    dialect: str = DEFAULT_DIALECT
    key: bytes | None = field(default=None, repr=False)
    sign: bool = False
    require_signed: bool = False

    @property
    def own_key(self) -> bytes | None:
        """What the station's own frames are signed with, None if they are not."""
        return self.key if self.sign else None
