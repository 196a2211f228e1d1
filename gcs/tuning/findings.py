"""What a result says of the quantities that an autopilot's parameters stand for, with what the model's errors leave.

Every quantity is a value and one of each model drawn from the joint error of the estimates, each with the mass that
goes with it. Trim is that of the model as it flies. Sources: Etkin & Reid, Dynamics of Flight, ch. 2 and 7.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gcs.errors import ExportError
from gcs.exports.exported import Exported
from gcs.exports.samples import drawn
from sim_vehicle.constants import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.trim import solve_trim
from sim_vehicle.physics.propeller import throttle_thrust
from sim_vehicle.vehicle.packed_model import flatten_vehicle
from sim_vehicle.vehicle.propulsion import Propulsion
from sysid.arrays import Array
from sysid.uncertainty.bench_errors import is_of_travel

SAMPLES = 200
# Share of the models drawn that must have a quantity, else its interval would be that of those that do.
_MOST_DRAWN = 0.95
# Thrust that no sensor measured, as the vehicle file has it, is known to this share.
_THRUST_STD = 0.05
# Drag over lift where the flight does not show drag: of usual small aircraft.
_USUAL_DRAG = 0.1
# Times the weight, of a thrust that holds any level flight.
_ENOUGH = 100.0
_SURFACES = {"de": "elevator", "da": "aileron", "dr": "rudder"}


@dataclass(frozen=True)
class Quantity:
    """A value, and (N,) those of the models drawn, NaN of those that do not have it; none where no error is known.

    unit: as "m/s", "1" for none.
    """

    value: float
    drawn: Array
    unit: str

    @property
    def interval(self) -> tuple[float, float] | None:
        """95 %, of the models drawn."""
        if not self.drawn.size:
            return None
        low, high = np.nanpercentile(self.drawn, (2.5, 97.5))
        return float(low), float(high)

    def map(self, function: Callable[[float], float], unit: str) -> Quantity:
        """A function of it."""
        values = np.array([function(float(one)) for one in self.drawn])
        return Quantity(function(self.value), values, unit)


@dataclass(frozen=True)
class Findings:
    """What a flight says. quantities: by name. refused: name -> why there is none. airspeed: m/s, the mean one flown,
    true; density: of its air, kg/m^3. most: the largest throttle that the autopilot gives, 0 to 1.
    """

    quantities: Mapping[str, Quantity]
    refused: Mapping[str, str]
    airspeed: float
    density: float
    most: float

    @property
    def equivalent_airspeed(self) -> float:
        """Of the mean airspeed, m/s."""
        return self.airspeed * math.sqrt(self.density / SEA_LEVEL_DENSITY)

    @property
    def eas2tas(self) -> float:
        """True over equivalent airspeed."""
        return math.sqrt(SEA_LEVEL_DENSITY / self.density)


def findings(result: Mapping[str, Any], model: Exported, no_pitot: str, most: float = 1.0) -> Findings:
    """What the result of an identification says. model: its model. no_pitot: why its airspeed is no reading of the
    autopilot's own sensor, "" where it is. most: the largest throttle that it gives, 0 to 1.
    """
    space = result.get("state_space") or {}
    speed = float(space.get("airspeed") or model.vehicle.flight.airspeed)
    rho = float(space.get("air_density") or SEA_LEVEL_DENSITY)
    every: dict[str, Quantity] = {}
    refused: dict[str, str] = {}
    _sensors(result, speed, no_pitot, every, refused)
    air = replace(model.vehicle.environment, air_density=rho)
    model = replace(model, vehicle=replace(model.vehicle, environment=air))
    try:
        others = drawn(model, SAMPLES, without=is_of_travel)
    except ExportError as error:
        others, refused["intervals"] = [], str(error)
    stronger = 1.0 + _THRUST_STD * np.random.default_rng(1).standard_normal(SAMPLES)
    best = _of_flight(model, speed, rho, 1.0, most)
    spread = [_of_flight(one, speed, rho, float(k), most) for one, k in zip(others, stronger, strict=False)]
    for name, (value, unit) in best.items():
        if isinstance(value, str):
            refused[name] = value
            continue
        values = np.array([np.nan if isinstance(one[name][0], str) else one[name][0] for one in spread])
        if np.count_nonzero(np.isfinite(values)) < _MOST_DRAWN * values.size:
            refused[name] = "models drawn from the errors of the estimates do not have it"
        else:
            every[name] = Quantity(value, values, unit)
    there = model.model.values()
    for name in best.keys() & _RESTS_ON.keys():
        if missing := [one for one in _RESTS_ON[name] if one not in there]:
            refused[name] = f"nothing is known of {', '.join(missing)}"
    for name in ("roll_deflection", "pitch_deflection"):
        if name in every and name not in refused and not every[name].value > 0.0:
            refused[name] = (
                "a steady rate needs no deflection its own way: beyond the manoeuvre point, or without damping"
            )
    return Findings({n: one for n, one in every.items() if n not in refused}, refused, speed, rho, most)


# What each quantity of the model rests on.
_RESTS_ON = {
    "roll_deflection": ("Cl_p", "Cl_da"),
    "pitch_deflection": ("Cm_q", "Cm_de", "Cm_alpha", "CL_alpha"),
    "de": ("Cm_0", "Cm_de"),
    "da": ("Cl_0", "Cl_da"),
    "dr": ("Cn_0", "Cn_dr"),
    "throttle": ("CD_0",),
    "climb": ("CD_0",),
    "sink": ("CD_0",),
    "alpha": ("CL_0", "CL_alpha"),
}


def _sensors(
    result: Mapping[str, Any],
    speed: float,
    no_pitot: str,
    every: dict[str, Quantity],
    refused: dict[str, str],
) -> None:
    """Errors of the autopilot's own readings: what airspeed reads over what it is, and of roll and pitch, rad."""
    errors = result.get("sensor_errors") or {}
    random = np.random.default_rng(2)

    def draws(name: str) -> tuple[float, Array] | None:
        entry = errors.get(name) or {}
        value, std = entry.get("value"), entry.get("std")
        if value is None or std is None:
            return None
        return float(value), float(value) + float(std) * random.standard_normal(SAMPLES)

    scale, bias = draws("airspeed_scale"), draws("airspeed_bias") or (0.0, np.zeros(SAMPLES))
    if no_pitot:
        refused["airspeed_reading"] = no_pitot
    elif scale is None:
        refused["airspeed_reading"] = "the flight does not show what the airspeed is wrong by: fly a wind square"
    else:
        reads = 1.0 + scale[0] + bias[0] / speed
        every["airspeed_reading"] = Quantity(reads, 1.0 + scale[1] + bias[1] / speed, "1")
    for axis, name in (("roll", "phi_bias"), ("pitch", "theta_bias")):
        found = draws(name)
        if found is None:
            refused[f"{axis}_reading"] = f"the flight does not show what {axis} is wrong by"
        else:
            every[f"{axis}_reading"] = Quantity(*found, "rad")


_Found = dict[str, tuple[float | str, str]]


def _of_flight(model: Exported, speed: float, rho: float, stronger: float, most: float) -> _Found:
    """What one model says of flight at a speed: name -> value, or why there is none, and unit."""
    found: _Found = {}
    values = model.model.values()
    vehicle, shape = model.vehicle, model.vehicle.geometry
    pressure = 0.5 * rho * speed**2 * shape.S

    def of(*names: str) -> list[float]:
        return [values.get(name, 0.0) for name in names]

    roll, aileron = of("Cl_p", "Cl_da")
    found["roll_deflection"] = (-roll / abs(aileron) * shape.b / 2.0 if aileron else math.nan, "m")
    # A pull-up at constant speed: lift, and thrust as large as the drag, turn the path, and moments are in balance.
    lift, lift_q, lift_de = of("CL_alpha", "CL_q", "CL_de")
    weight = vehicle.mass.mass * STANDARD_GRAVITY
    level = weight / pressure
    drag_0, induced = of("CD_0", "CD_k")
    turning = lift + (drag_0 + induced * level**2 if drag_0 else _USUAL_DRAG * level)
    still, damping, elevator = of("Cm_alpha", "Cm_q", "Cm_de")
    rate = shape.c / (2.0 * speed)
    if lift and elevator:
        turned = vehicle.mass.mass * speed / pressure - lift_q * rate
        # alpha = (turned q - lift_de de) / turning, and Cm_alpha alpha + Cm_q rate q + Cm_de de = 0.
        per_rate = -(still * turned / turning + damping * rate) / (elevator - still * lift_de / turning)
        found["pitch_deflection"] = (math.copysign(per_rate, per_rate * elevator) * speed, "m")
    else:
        found["pitch_deflection"] = (math.nan, "m")
    names = {"de": "rad", "da": "rad", "dr": "rad", "throttle": "1", "alpha": "rad", "sink": "m/s", "climb": "m/s"}
    motor = vehicle.propulsion
    enough = Propulsion(max_thrust=_ENOUGH * weight)
    if motor is not None:
        enough = replace(motor, max_thrust=_ENOUGH * weight, CT=(), CQ=())
    try:
        plant = Plant(replace(vehicle, propulsion=enough), model.model)
        trim = solve_trim(plant, speed, 0.0)
    except SimVehicleError as error:
        return found | {name: (str(error), unit) for name, unit in names.items()}
    alpha = float(plant.outputs(trim.state)[1])
    needed = float(trim.command[3]) * _ENOUGH * weight
    inclined = alpha + (motor.inclination if motor is not None else 0.0)
    lifting, drag = weight - needed * math.sin(inclined), needed * math.cos(inclined)
    found |= {name: (float(trim.command[i]), "rad") for i, name in enumerate(_SURFACES)}
    found["alpha"] = (alpha, "rad")
    found["sink"] = (speed * drag / math.hypot(lifting, drag), "m/s")
    if motor is None or not motor.by_throttle:
        why = "thrust at full throttle is not known: give [propulsion] max_thrust, or CT and max_rpm"
        return found | {"throttle": (why, "1"), "climb": (why, "m/s")}
    constants = flatten_vehicle(vehicle)
    throttles = np.linspace(0.0, 1.0, 201)
    thrust = stronger * np.array([throttle_thrust(float(one), speed, rho, constants) for one in throttles])
    found["climb"] = (speed * float(np.interp(most, throttles, thrust) - drag) / weight, "m/s")
    found["throttle"] = (
        float(np.interp(needed, thrust, throttles))
        if thrust[-1] > needed
        else "full throttle does not hold level flight at this speed",
        "1",
    )
    return found
