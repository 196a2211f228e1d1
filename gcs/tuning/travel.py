"""How far a full demand of an autopilot moves a surface: by its servos' ranges and the vehicle file's deflections."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sim_vehicle.vehicle.controls import OUTPUTS, PORTS, output_name
from sim_vehicle.vehicle.vehicle_file import Vehicle

# ArduPilot's servo functions of two surfaces in one, whose share of each demand is MIXING_GAIN.
_MIXED, _MIXING_GAIN = (77, 78, 79, 80), 0.5


def range_of(servo: int, autopilot: str, now: Mapping[str, float]) -> tuple[float, float] | None:
    """Smallest and largest pulse that the autopilot sends, us; None where the log does not say."""
    port, place = divmod(servo - 1, OUTPUTS)
    names = [f"SERVO{servo}_{end}" for end in ("MIN", "MAX")]
    if autopilot == "px4":
        names = [f"PWM_{PORTS[port]}_{end}{place + 1}" for end in ("MIN", "MAX")]
    ends = [now.get(name) for name in names]
    if ends[0] is None or ends[1] is None or not 0.0 < ends[0] < ends[1]:
        return None
    return ends[0], ends[1]


def full_travel(vehicle: Vehicle, name: str, autopilot: str, now: Mapping[str, float]) -> float | str:
    """Deflection at a full demand, rad: half of what its servos' ranges come to, of which ArduPilot gives a servo of
    two surfaces a share; why that is not known, else. now: the autopilot's parameters.

    A servo whose range the log does not hold counts with the vehicle file's whole table.
    """
    control = vehicle.controls.get(name)
    if control is None or not control.servos:
        return f"no servo of the {name} is known"
    if control.signal == "position":
        return f"the log holds positions of the {name}, whose numbers are no pulses of its servo"
    total = 0.0
    for servo, weight, xs, ys in zip(control.servos, control.mix, control.pwm, control.deflection, strict=True):
        low, high = range_of(servo, autopilot, now) or (xs[0], xs[-1])
        ends = np.interp([low, high], xs, ys)
        total += abs(weight * float(ends[1] - ends[0])) / 2.0 * _share(servo, vehicle, autopilot, now)
    return total or f"the servo of the {name} does not move within its range"


def _share(servo: int, vehicle: Vehicle, autopilot: str, now: Mapping[str, float]) -> float:
    """Of a full demand that reaches a servo."""
    function = int(now.get(f"SERVO{servo}_FUNCTION", 0))
    surfaces = sum(servo in one.servos for one in vehicle.controls.values())
    mixed = function in _MIXED or (function == 0 and surfaces > 1)
    return now.get("MIXING_GAIN", _MIXING_GAIN) if autopilot == "ardupilot" and mixed else 1.0


def range_warnings(vehicle: Vehicle, autopilot: str, now: Mapping[str, float]) -> list[str]:
    """Which servos count with the vehicle file's table because the log does not hold their range, or a wider one."""
    beyond = [
        output_name(servo)
        for key, one in vehicle.controls.items()
        for servo, xs in zip(one.servos, one.pwm, strict=True)
        if key != "throttle" and (ends := range_of(servo, autopilot, now)) and (ends[0] < xs[0] or ends[1] > xs[-1])
    ]
    lines = []
    if beyond:
        lines.append(
            f"the ranges of servo {', '.join(dict.fromkeys(beyond))} in the log go beyond the vehicle file's table, at"
            " whose ends the surface counts as at its stop"
        )
    servos = {servo for key, one in vehicle.controls.items() if key != "throttle" for servo in one.servos}
    unknown = [output_name(servo) for servo in sorted(servos) if range_of(servo, autopilot, now) is None]
    if unknown:
        words = ", ".join(unknown)
        lines.append(f"the ranges of servo {words} (MIN, MAX) are not in the log: the vehicle file's table counts")
    return lines
