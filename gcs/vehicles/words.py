"""A vehicle file in words."""

from __future__ import annotations

import math

from gcs.vehicles.figures import figures
from sim_vehicle.vehicle.controls import CONTROL_NAMES, output_name
from sim_vehicle.vehicle.vehicle_file import Vehicle


def vehicle_lines(vehicle: Vehicle) -> list[str]:
    """What a vehicle file says and what follows from it, a line each; what is unusual is marked."""
    mass, geometry = vehicle.mass, vehicle.geometry
    lines = [
        f"{vehicle.name}: {mass.mass:g} kg, span {geometry.b:g} m, area {geometry.S:g} m^2, chord {geometry.c:g} m",
        f"  Ixx {mass.Ixx:.3g}, Iyy {mass.Iyy:.3g}, Izz {mass.Izz:.3g}, Ixz {mass.Ixz:.3g} kg m^2"
        + (" (usual for span and mass: nothing was given)" if mass.estimated else ""),
    ]
    for name, control in vehicle.controls.items():
        low, high = control.limits
        unit, factor = ("%", 100.0) if name == "throttle" else ("deg", math.degrees(1.0))
        if name not in CONTROL_NAMES:
            unit, factor = "(rad or a share, as the file has it)", 1.0
        servos = ", ".join(map(output_name, control.servos))
        pulses = " and ".join(f"{min(us):g} to {max(us):g}" for us in control.pwm)
        places = 1 if name in CONTROL_NAMES else 3
        travel = f"{factor * low:.{places}f} to {factor * high:.{places}f} {unit}"
        lines.append(f"  {name}: servo {servos}, {pulses} us, {travel} ({control.signal})")
    if not vehicle.controls:
        lines.append("  no controls: they are taken from the autopilot's parameters where a log holds them")
    for one in figures(vehicle):
        low, high = one.usual
        mark = "" if one.is_usual else f"  <- unusual: {low:g} to {high:g} of small aircraft; is a unit wrong?"
        lines.append(f"  {one.name}: {one.value:.3g}{f' {one.unit}' if one.unit else ''}{mark}")
    return lines
