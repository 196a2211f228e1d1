"""What the station itself says, under one sender with one counter; signed only where the user says so."""

from __future__ import annotations

import threading
from typing import Any

from pymavlink.dialects.v20 import common

from gcs.mavlink.signing import SigningClock

SYSTEM = 255
COMPONENT = common.MAV_COMP_ID_MISSIONPLANNER


class StationVoice:
    """Makes the station's own frames. Thread-safe.

    key: signs every frame made here. Frames of others never pass through here, so none of them is ever signed.
    """

    def __init__(self, key: bytes | None = None, component: int = COMPONENT) -> None:
        self._key, self._component = key, component
        self._sender = common.MAVLink(None, srcSystem=SYSTEM, srcComponent=component)
        self._lock = threading.Lock()
        self._stamps = SigningClock()
        if key is not None:
            self._sender.signing.secret_key = key
            self._sender.signing.sign_outgoing = True

    def apart(self) -> StationVoice:
        """The same sender with a counter of its own, for what is heard apart from the rest."""
        return StationVoice(self._key, self._component)

    def frame(self, message: Any) -> bytes:
        """The frame of a pymavlink message, the counter one up."""
        with self._lock:
            if self._sender.signing.sign_outgoing:
                self._sender.signing.timestamp = self._stamps.next()
            frame = bytes(message.pack(self._sender))
            self._sender.seq = (self._sender.seq + 1) % 256
            return frame

    def heartbeat(self) -> bytes:
        """HEARTBEAT of a ground station, by which a vehicle knows that one is there."""
        return self.frame(
            common.MAVLink_heartbeat_message(
                common.MAV_TYPE_GCS, common.MAV_AUTOPILOT_INVALID, 0, 0, common.MAV_STATE_ACTIVE, 3
            )
        )
