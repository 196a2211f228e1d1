"""What a vehicle file says of the unknowns: its standard deviations, delays, lags and offsets of stamps, as priors."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

import numpy as np

from sim_vehicle.effects.thrust_line_offset import THRUST_LINE_OFFSET
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.controls import signal_of
from sim_vehicle.vehicle.strict_toml import NOT_SAID, Known
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.posterior.nuisance_priors import (
    FLOW_OF,
    MOVING_MASS,
    PRIORS,
    PRODUCT_INERTIA,
    SURFACES_OF,
    THRUST_ARM,
    ZERO_STD,
    Nuisance,
)

# Mean and standard deviation of a prior, None where the table's stands.
Stated = tuple[float | None, float | None]

AIRSPEED_LAG_S = (0.05, 0.05)  # hobby tubing of 0.2 to 0.5 m (Tavoularis)
_NOMINAL = {one.name: one for one in PRIORS}
_OUTPUTS = {
    "accelerometer": ("ax", "ay", "az"),
    "gyro": ("p", "q", "r"),
    "alpha_vane": ("alpha",),
    "beta_vane": ("beta",),
}


def declared(vehicle: Vehicle, group: str, messages: Mapping[str, str]) -> dict[str, Stated]:
    """Priors of a group's nuisances by name. messages: signal -> the message that carried it."""
    sensors, found = vehicle.sensors, {}
    controls = [one for name, one in vehicle.controls.items() if signal_of(name) in SURFACES_OF[group]]
    for key in ("delay", "lag", "backlash"):
        found[f"servo_{key}"] = _one(getattr(control, key) for control in controls)
    found["servo_delay"] = _later(
        found["servo_delay"], _NOMINAL["servo_delay"], lateness(vehicle, messages, SURFACES_OF[group]), -1.0
    )
    name = FLOW_OF[group]
    vane = sensors[f"{name}_vane"]
    found["vane_clock"] = _later(
        (vane.delay.value, vane.delay.std), _NOMINAL["vane_clock"], lateness(vehicle, messages, (name,)), 1.0
    )
    found |= _swinging(vane.lag)
    found[f"{name}_scale"] = (None, vane.scale_std)
    if "alpha" in messages:  # a vane's zero is none of kinematics
        found["alpha_offset"] = (None, sensors.alpha_vane.bias_std)
    found["theta_offset"] = found["phi_offset"] = (None, sensors.attitude.bias_std)
    found["airspeed_error"] = (None, _airspeed_std(vehicle))
    late = airspeed_lag(vehicle, messages)
    found["airspeed_lag"] = late if late[1] == 0.0 else (None, None)
    found["airspeed_alpha"] = (None, sensors.airspeed.position_error_std)
    found["thrust_error"] = (None, sensors.thrust.scale_std)
    return {name: stated for name, stated in found.items() if stated != (None, None)}


# Standard deviation of the thrust line's height over the centre of gravity, mean chords, where it is not given: 0.18 of
# an Ultra Stick 25e, none of aircraft whose motor sits on the wing's chord line.
_THRUST_ARM_CHORDS = 0.15
# And where the line is given: the wash of the propeller over a tail that is set turns with the thrust too, Cm_de times
# that angle times one to three by chord.
_WASH_CHORDS = 0.07
# Standard deviation of what hangs on a thrust sensor, of the aircraft's mass, where it is not given: motors with their
# propellers are 4 to 10 % of small electric aircraft.
_MOVING_SHARE = 0.07


def of_aircraft(vehicle: Vehicle, thrust: Collection[str], structure: Model, felt: bool = True) -> tuple[Nuisance, ...]:
    """Unknowns of the aircraft itself that its vehicle file does not give: they change the motion's own equations.

    thrust: the signals that give it, "" for none. structure: the model, which may have the line itself. felt: whether
    accelerometers feel the lift; without them the wash is not distinguished from the angle of attack.
    """
    mass, chord = vehicle.mass, vehicle.geometry.c
    found = []
    if mass.Ixz_std:
        most = 0.9 * math.sqrt(mass.Ixx * mass.Izz)
        found.append(Nuisance(
            PRODUCT_INERTIA, 0.0, mass.Ixz_std, 0.0, -most - mass.Ixz, most - mass.Ixz, 0.02 * mass.Ixz_std, "kg m^2",
            "lateral", "the vehicle file, or what is usual for mass and span",
        ))  # fmt: skip
    std, line = _THRUST_ARM_CHORDS * chord, vehicle.propulsion
    if line is not None and is_line_given(vehicle):
        known_to = float(felt) * _WASH_CHORDS * chord if line.line_std is None else line.line_std
        # A moment of inertia that is taken too small makes the thrust's moment look too small as well.
        std = math.hypot(known_to, abs(line.line[2]) * (mass.Iyy_std or 0.0) / mass.Iyy)
    if any(thrust) and std > 0.0 and structure.effect(THRUST_LINE_OFFSET.name) is None:
        found.append(Nuisance(
            THRUST_ARM, 0.0, std, 0.0, -2.0 * chord, 2.0 * chord, 0.02 * std, "m", "longitudinal",
            "thrust lines of small aircraft",
        ))  # fmt: skip
    if "thrust" in thrust and not moving_mass_known(vehicle):
        std = _MOVING_SHARE * mass.mass
        found.append(Nuisance(
            MOVING_MASS, 0.0, std, 0.0, 0.0, 0.4 * mass.mass, 0.02 * std, "kg", "longitudinal",
            "motors and propellers of small electric aircraft",
        ))  # fmt: skip
    return tuple(found)


def is_line_given(vehicle: Vehicle) -> bool:
    """Whether the vehicle file says where the thrust acts, or how well it knows."""
    line = vehicle.propulsion
    return line is not None and (line.line_known or line.line_std is not None)


def moving_mass_known(vehicle: Vehicle) -> bool:
    """Whether the vehicle file says what hangs on the thrust sensor and pulls at it when the aircraft accelerates."""
    return vehicle.propulsion is not None and vehicle.propulsion.moving_mass_known


def as_estimated(vehicle: Vehicle, values: Mapping[str, float]) -> Vehicle:
    """The vehicle with what was estimated of it. values: of `of_aircraft`'s unknowns, by name; the thrust line's is an
    effect of the model.
    """
    product = values.get(PRODUCT_INERTIA, 0.0)
    return replace(vehicle, mass=replace(vehicle.mass, Ixz=vehicle.mass.Ixz + product)) if product != 0.0 else vehicle


def zero_stds(vehicle: Vehicle) -> dict[str, float]:
    """Standard deviation of each output's zero, SI: the vehicle file's `bias_std`, else the table's."""
    found = dict(ZERO_STD)
    for sensor, outputs in _OUTPUTS.items():
        if (std := vehicle.sensors[sensor].bias_std) is not None:
            found |= dict.fromkeys(outputs, std)
    return found


def airspeed_lag(vehicle: Vehicle, messages: Mapping[str, str]) -> tuple[float, float]:
    """Mean and standard deviation, s, of the delay of the airspeed: lag, delay and stamps together."""
    sensor, (offset, offset_std) = vehicle.sensors.airspeed, lateness(vehicle, messages, ("airspeed",))
    mean, std = AIRSPEED_LAG_S
    mean = mean if sensor.lag.value is None else sensor.lag.value
    std = std if sensor.lag.std is None else sensor.lag.std
    return mean + (sensor.delay.value or 0.0) + offset, math.hypot(std, sensor.delay.std or 0.0, offset_std)


def lateness(vehicle: Vehicle, messages: Mapping[str, str], signals: Iterable[str]) -> tuple[float, float]:
    """By how much the stamps of signals are later than those of the gyro, s, and its standard deviation."""
    reference = messages.get("q")
    own = {messages[name] for name in signals if name in messages} - {reference}
    stated = [vehicle.timing[name] for name in own if name in vehicle.timing]
    if not own or not (stated or reference in vehicle.timing):
        return 0.0, 0.0
    gyro = vehicle.timing.get(reference or "", NOT_SAID)
    offset = float(np.mean([one.value or 0.0 for one in stated])) if stated else 0.0
    std = max([one.std or 0.0 for one in stated], default=0.0)
    return offset - (gyro.value or 0.0), math.hypot(std, gyro.std or 0.0)


def unused_timing(vehicle: Vehicle, messages: Mapping[str, str]) -> list[str]:
    """A line for each message of [timing] that brings this flight no signal."""
    there = sorted(set(messages.values()))
    return [
        f"timing.{name}: no signal of this flight comes in that message, and the entry does nothing; those that bring"
        f" some: {', '.join(there)}"
        for name in vehicle.timing
        if name not in there
    ]


def _one(each: Iterable[Known]) -> Stated:
    """What is stated of several servos that one unknown stands for; what they differ by widens it."""
    stated = list(each)
    values = [one.value for one in stated if one.value is not None]
    stds = [one.std for one in stated if one.std is not None]
    mean = float(np.mean(values)) if values else None
    return mean, math.hypot(max(stds), float(np.std(values)) if values else 0.0) if stds else None


def _later(stated: Stated, nominal: object, stamps: tuple[float, float], sign: float) -> Stated:
    """A delay with what the stamps of its message add."""
    offset, std = stamps
    if (offset, std) == (0.0, 0.0):
        return stated
    mean, own = (
        getattr(nominal, key) if one is None else one for key, one in zip(("mean", "std"), stated, strict=True)
    )
    return mean + sign * offset, math.hypot(own, std)


def _swinging(lag: Known) -> dict[str, Stated]:
    """Period of a vane of usual damping that lags so: 2 damping over omega. A lag of 0 is no swinging."""
    if lag == NOT_SAID:
        return {}
    if lag.value == 0.0:
        return {"vane_period": (0.0, 0.0), "vane_log_damping": (None, 0.0)}
    per_lag = math.pi / math.exp(_NOMINAL["vane_log_damping"].mean)
    mean, std = (None if one is None else one * per_lag for one in (lag.value, lag.std))
    return {"vane_period": (mean, std)}


def _airspeed_std(vehicle: Vehicle) -> float | None:
    """Share by which the airspeed may be wrong throughout: its gain and, at the speed flown, its zero."""
    sensor = vehicle.sensors.airspeed
    if sensor.scale_std is None and sensor.bias_std is None:
        return None
    zero = (sensor.bias_std or 0.0) / vehicle.flight.airspeed
    return math.hypot(sensor.scale_std or 0.0, zero)
