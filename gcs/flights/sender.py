"""Who sent a recording: the type of the vehicle and its autopilot, as its HEARTBEAT says."""

from __future__ import annotations

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega

GENERIC, FIXED_WING, GCS = 0, 1, 6
AUTOPILOT_GENERIC, AUTOPILOT_INVALID = 0, 8
# MAV_TYPE of what flies on a wing: VTOLs too, while they do.
_WINGED = frozenset((GENERIC, FIXED_WING, *range(19, 26)))
_SPELT = {"ardupilotmega": "ArduPilot", "px4": "PX4"}


@dataclass(frozen=True)
class Sender:
    """system: MAVLink system number. kind: MAV_TYPE. autopilot: MAV_AUTOPILOT."""

    system: int
    kind: int
    autopilot: int

    @property
    def has_wings(self) -> bool:
        """Whether it may be an aircraft that identification is for; one that does not say counts."""
        return self.kind in _WINGED

    @property
    def type_name(self) -> str:
        """The type in words."""
        return "unknown type" if self.kind == GENERIC else _word("MAV_TYPE", self.kind)

    @property
    def autopilot_name(self) -> str:
        """The autopilot in words."""
        if self.autopilot in (AUTOPILOT_GENERIC, AUTOPILOT_INVALID):
            return "no autopilot named"
        name = _word("MAV_AUTOPILOT", self.autopilot)
        return _SPELT.get(name, name)

    def __str__(self) -> str:
        return f"{self.type_name}, {self.autopilot_name}"

    def to_json(self) -> dict[str, object]:
        """As results and `gcs info` hold it."""
        return {"system": self.system, "type": self.type_name, "mav_type": self.kind, "autopilot": self.autopilot_name}


def _word(enumeration: str, value: int) -> str:
    entry = ardupilotmega.enums[enumeration].get(value)
    if entry is None:
        return f"{enumeration} {value}"
    return str(entry.name).removeprefix(f"{enumeration}_").lower().replace("_", " ")
