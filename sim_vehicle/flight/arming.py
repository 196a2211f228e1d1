"""When the vehicle arms: by the flight's own plan, or when a ground station says so."""

from __future__ import annotations

STANDING_S = 2.0  # s that the vehicle stands disarmed before it arms by itself
_HALF_TICK_S = 0.01


class Arming:
    """The arming of one flight. wait: stand until a ground station arms, instead of STANDING_S."""

    def __init__(self, *, wait: bool = False) -> None:
        self._wait = wait
        self._asked = False
        self._begun = False

    def begins(self, standing_s: float) -> bool:
        """Asked in each tick in which the vehicle stands disarmed before its flight: whether it is to arm now."""
        by_itself = not self._wait and standing_s > STANDING_S - _HALF_TICK_S
        self._begun = self._asked or by_itself
        return self._begun

    def command(self, wanted: bool, *, armed: bool) -> bool:
        """A ground station wants the vehicle armed or disarmed; False where it refuses.

        It can be armed until its flight has begun, and not be disarmed in the middle of it.
        """
        if wanted and not armed:
            self._asked = not self._begun
            return self._asked
        if not wanted and not armed:
            self._asked = False
        return wanted or not armed
