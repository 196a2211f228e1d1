"""What `gcs tune` proposes as a file that a ground station loads."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gcs.errors import ExportError
from gcs.text.files import write_whole
from gcs.text.one_line import one_line
from gcs.version import VERSION

# First of the line by which such a file is known again.
HEAD = "# Parameters proposed by gcs"
AUTOPILOTS = {"ardupilot": "ArduPilot", "px4": "PX4"}
# MAV_PARAM_TYPE of a float, which all that is proposed to PX4 is but the pulses.
_FLOAT, _INT32 = 9, 6


def number_text(value: float | None) -> str:
    """A parameter's value, - where it is not known."""
    return "-" if value is None else f"{value:.5g}"


def write_parameters(found: Mapping[str, Any], path: Path) -> None:
    """Write the file. Raises ExportError where nothing is proposed."""
    write_whole(path, parameter_file(found))


def parameter_file(found: Mapping[str, Any]) -> str:
    """The file: for ArduPilot NAME,VALUE, as Mission Planner and MAVProxy load it; for PX4 that of QGroundControl.

    Raises ExportError where nothing is proposed.
    """
    if not found["parameters"]:
        raise ExportError(
            "the flight says nothing of any parameter, and there is no file: why stands beside each that is refused"
        )
    flights = ", ".join(map(str, found["flights"]))
    lines = [
        one_line(f"{HEAD} {VERSION} for {AUTOPILOTS[found['for']]}, {found['vehicle']}, from {flights}"),
        "# Compare each with what it is now before it is loaded. Intervals are 95 %.",
    ]
    if found["for"] == "px4":
        lines.append("# Vehicle-Id\tComponent-Id\tName\tValue\tType")
    for one in found["parameters"]:
        ends = one["interval"]
        between = "" if ends is None else f", interval {ends[0]:.4g} to {ends[1]:.4g}"
        lines.append(one_line(f"# {one['name']}: now {number_text(one['now'])}{between}: {one['reason']}"))
        if found["for"] == "px4":
            whole = one["unit"] == "us"
            lines.append(f"1\t1\t{one['name']}\t{one['value']:g}\t{_INT32 if whole else _FLOAT}")
        else:
            lines.append(f"{one['name']},{one['value']:g}")
    lines += [one_line(f"# {one['name']}: not proposed: {one['refused']}") for one in found["refused"]]
    return "\n".join([*lines, ""])
