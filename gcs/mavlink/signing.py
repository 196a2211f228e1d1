"""MAVLink 2 signatures: the key, checking what was received, and signing what the station itself says.

As in the MAVLink guide, "Message Signing": 13 bytes stand behind the checksum: a link id, a time stamp (48 bits,
10 us units since 2015-01-01 UTC) and the first 6 bytes of SHA-256 over key, frame, link id and stamp. The stamps of
a stream (link id, system, component) must increase, whatever way the frames come; those of a new stream may lie a
minute back at most. Where the same stream comes over several links of the station, a stamp that one link had before
is no replay when another brings it soon after.
"""

from __future__ import annotations

import hashlib
import hmac
import threading
import time
from collections.abc import Mapping
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.errors import SettingsError
from gcs.mavlink.framing import SIGNED, Frames

KEY_BYTES = 32
_EPOCH_NS = 1_420_070_400 * 1_000_000_000
_UNIT_NS = 10_000
_NEW_STREAM_UNITS = 60 * 100_000
_SIGNATURE_BYTES = 6
# How far one link of the station may be behind another.
_LATE_COPY_UNITS = 5 * 100_000


def load_key(path: Path) -> bytes:
    """The key in a file: 32 bytes, or 64 hexadecimal digits. SettingsError if it holds anything else."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise SettingsError(f"{path}: the signing key cannot be read: {error.strerror}") from error
    if len(content) == KEY_BYTES:
        return content
    digits = content.strip()
    try:
        key = bytes.fromhex(digits.decode("ascii")) if len(digits) == 2 * KEY_BYTES else b""
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES:
        raise SettingsError(f"{path}: a signing key has {KEY_BYTES} bytes, or {2 * KEY_BYTES} hexadecimal digits")
    return key


def signing_time(ns: int) -> int:
    """UTC ns as the stamp of a signature."""
    return max(ns - _EPOCH_NS, 0) // _UNIT_NS


@dataclass
class SignatureCounts:
    """Frames by their signatures.

    bad: wrong signature, or a right one whose stamp does not increase (those are in `replayed` too).
    repeated: signature right, and the stamp new on this link, but another link of the station was ahead.
    unverified: signed, but there is no key to check with.
    """

    good: int = 0
    bad: int = 0
    replayed: int = 0
    repeated: int = 0
    unverified: int = 0
    unsigned: int = 0

    def __add__(self, other: SignatureCounts) -> SignatureCounts:
        return SignatureCounts(*(mine + theirs for mine, theirs in zip(astuple(self), astuple(other), strict=True)))

    def text(self) -> str:
        """The counts in words."""
        replayed = f" ({self.replayed} of them replayed)" if self.replayed else ""
        unverified = f", {self.unverified} not checked for want of a key" if self.unverified else ""
        repeated = f", {self.repeated} that another link had brought" if self.repeated else ""
        counts = f"{self.good} good, {self.bad} bad{replayed}{repeated}"
        return f"signatures: {counts}, {self.unsigned} frames unsigned{unverified}"

    @classmethod
    def of(cls, values: Mapping[str, int]) -> SignatureCounts:
        """The counts among the entries of a JSON object, as `to_json` names them."""
        return cls(*(values[name] for name in cls().to_json()))

    def to_json(self) -> dict[str, int]:
        """The counts by the names that REST and `gcs info` use."""
        return {
            "signed_good": self.good,
            "signed_bad": self.bad,
            "signed_replayed": self.replayed,
            "signed_repeated": self.repeated,
            "signed_unverified": self.unverified,
            "unsigned": self.unsigned,
        }


class SignatureMemory:
    """The newest stamps of every stream, over all sources that are checked with one key. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._newest = 0
        self._streams: dict[bytes, int] = {}

    def take(self, stream: bytes, stamp: int, now: int) -> int | None:
        """None if the stamp is new, which it is not any more then; else the newest of its stream, 0 if it has none.

        now: the stamp of this moment.
        """
        with self._lock:
            last = self._streams.get(stream)
            if stamp <= last if last is not None else stamp + _NEW_STREAM_UNITS < max(self._newest, now):
                return last or 0
            self._streams[stream] = stamp
            self._newest = max(self._newest, stamp)
            return None


class SignatureChecker:
    """Judges the frames of one source, in their order. Nothing is kept back: what fails is counted.

    memory: shared by all sources of a station, so that none takes what another has had.
    """

    def __init__(self, key: bytes | None, memory: SignatureMemory | None = None) -> None:
        self._key = key
        self._memory = memory or SignatureMemory()
        self._streams: dict[bytes, int] = {}
        self.counts = SignatureCounts()

    def add(self, frames: Frames, received_ns: NDArray[np.int64], signed: int) -> NDArray[np.bool_]:
        """Count frames, of which `signed` have a signature; (len(frames),) which of them have a good one.

        received_ns: (len(frames),) UTC time of each, which new streams are judged by.
        """
        good = np.zeros(len(frames), np.bool_)
        self.counts.unsigned += len(frames) - signed
        if signed == 0:
            return good
        for i in np.flatnonzero(frames.incompat == SIGNED).tolist():
            good[i] = self.judge(frames.frame(i), int(received_ns[i]))
        return good

    def judge(self, frame: bytes, now_ns: int) -> bool:
        """Count one signed frame that came at `now_ns` UTC; whether its signature is good."""
        if self._key is None:
            self.counts.unverified += 1
            return False
        digest = hashlib.sha256(self._key + frame[:-_SIGNATURE_BYTES]).digest()
        if not hmac.compare_digest(digest[:_SIGNATURE_BYTES], frame[-_SIGNATURE_BYTES:]):
            self.counts.bad += 1
            return False
        stamp = int.from_bytes(frame[-12:-6], "little")
        stream = frame[-13:-12] + frame[5:7]
        ahead = self._memory.take(stream, stamp, signing_time(now_ns))
        here = self._streams.get(stream, -1)
        self._streams[stream] = max(here, stamp)
        if ahead is None:
            self.counts.good += 1
        elif here < stamp and ahead <= stamp + _LATE_COPY_UNITS and ahead > 0:
            self.counts.repeated += 1
        else:
            self.counts.bad += 1
            self.counts.replayed += 1
            return False
        return True


class SigningClock:
    """Stamps for frames that the station signs: of the time of day, and each above the one before."""

    def __init__(self) -> None:
        self._last = 0

    def next(self) -> int:
        """The stamp of the next frame."""
        self._last = max(self._last + 1, signing_time(time.time_ns()))
        return self._last
