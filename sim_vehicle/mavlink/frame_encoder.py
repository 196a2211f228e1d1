"""One component's MAVLink encoder: packs messages with a running sequence number, signed where there is a key."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("MAVLINK20", "1")

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.errors import SimVehicleError

SYSTEM, COMPONENT = 1, 1
KEY_BYTES = 32
_SIGNING_EPOCH_US = 1_420_070_400_000_000  # 2015-01-01 UTC: signatures count 10 us from there
_LARGEST_V1_ID = 255


class SigningKeyError(SimVehicleError):
    """The signing key's file cannot be read, or is no key."""


class _Collector:
    """The file-like object that pymavlink writes whole frames to."""

    def __init__(self) -> None:
        self.frames: list[bytes] = []

    def write(self, frame: bytes) -> None:
        self.frames.append(bytes(frame))


class Voice:
    """Packs messages of one system. `build` is pymavlink's encoder, whose `*_encode` make messages.

    version: 1 or 2; MAVLink 1 has no message ids above 255, and such messages are left out. key: 32 bytes.
    """

    def __init__(self, system: int = SYSTEM, *, version: int = 2, key: bytes | None = None) -> None:
        self._out = _Collector()
        self.build: Any = mavlink.MAVLink(self._out, srcSystem=system, srcComponent=COMPONENT)
        self.system = system
        self.version = version
        self._key = key
        if key is not None:
            self.build.signing.secret_key = key
            self.build.signing.sign_outgoing = True

    def can_say(self, message_id: int) -> bool:
        """Whether this version of MAVLink has messages of that id."""
        return self.version == 2 or message_id <= _LARGEST_V1_ID

    def say(self, message: Any) -> None:
        """Pack one message; `take` gives the frame."""
        if self.can_say(message.get_msgId()):
            self.build.send(message, force_mavlink1=self.version == 1)

    def take(self) -> list[bytes]:
        """Frames packed since the last call, in order."""
        frames, self._out.frames = self._out.frames, []
        return frames

    def signed_from(self, utc_us: int) -> None:
        """Stamp the next signatures with `utc_us`, us since 1970, or later: a signature's stamp only rises."""
        signing = self.build.signing
        signing.timestamp = max(signing.timestamp, _signing_time(utc_us))

    def restart(self) -> None:
        """Number messages from 0 again, as after a boot."""
        self.build.seq = 0

    def parser(self) -> Any:
        """A parser for what is sent to this component; with a key it takes nothing that is not rightly signed."""
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        parser.signing.secret_key = self._key
        parser.signing.timestamp = _signing_time(time.time_ns() // 1000)
        return parser


def _signing_time(utc_us: int) -> int:
    return max(utc_us - _SIGNING_EPOCH_US, 0) // 10


def read_key(path: str | Path) -> bytes:
    """A signing key: a file of 32 bytes, or of 64 hexadecimal digits. Raises SigningKeyError, one line."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise SigningKeyError(f"{path}: cannot read the signing key: {error.strerror}") from None
    if len(data) == KEY_BYTES:
        return data
    try:
        key = bytes.fromhex(data.decode("ascii").strip())
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES:
        raise SigningKeyError(f"{path}: not a signing key; give a file of 32 bytes or of 64 hexadecimal digits")
    return key
