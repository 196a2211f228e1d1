"""The truth beside the coefficients of a field flight: errors of its sensors, the wind, dimensional derivatives."""

from __future__ import annotations

import numpy as np
from field_flight import FieldFlight, plan_of
from field_sensors import noise_of
from jsbsim_flight import linear_aircraft, table_aircraft

from sim_vehicle.model.aerodynamic_terms import parse_term

Interval = tuple[float, float]
# What an axis' moment or force is divided by, and which length it has.
_OF_AXIS = {"CY": ("Y", "mass", ""), "Cl": ("L", "Ixx", "b"), "Cm": ("M", "Iyy", "c"), "Cn": ("N", "Izz", "b")}
_LENGTH = {"p": "b", "q": "c", "r": "b"}


def sensor_truth(family: str, seed: int, flight: FieldFlight) -> dict[str, float]:
    """Sensor error -> what it was on average, by the flight's draw and by what was recorded of the true motion."""
    plan, log = plan_of(family, seed), flight.log
    field, arm = plan.field, np.array(flight.vehicle.sensors.accelerometer.position)
    rates, turn = (np.stack([log[name] for name in names], axis=1) for names in ("pqr", ("pdot", "qdot", "rdot")))
    force = np.stack([log[f"f{x}"] for x in "xyz"], axis=1)
    force = force + np.cross(turn, arm) + np.cross(rates, np.cross(rates, arm))
    moved = {
        **{f"accel_bias_{axis}": (f"a{axis}", force[:, i]) for i, axis in enumerate("xyz")},
        **{f"gyro_bias_{axis}": (axis, rates[:, i]) for i, axis in enumerate("pqr")},
        **{f"{name}_bias": (name, log[name]) for name in ("phi", "theta")},
    }
    truth = {"airspeed_scale": field.airspeed_scale}
    truth |= dict(zip(("wind_north", "wind_east"), plan.air.wind, strict=True))
    for error, (name, true) in moved.items():
        read = flight.signals.signals.get(name)
        if read is not None:
            good = np.isfinite(read.values)
            truth[error] = float(np.mean(read.values[good] - np.interp(read.time_s[good], log.time_s, true)))
    suite = seed if field.suite is None else field.suite
    for name, share in (("alpha", 1.0), ("beta", 0.5)):
        truth[f"{name}_scale"] = share * field.vane_scale
        truth[f"{name}_bias"] = field.vane_bias * float(noise_of(suite, f"bias {name}").standard_normal())
    return truth


def dimensional_truth(seed: int, flight: FieldFlight) -> dict[str, Interval]:
    """Dimensional derivative -> range of it, about the true mean speed and density, of the aircraft that flew."""
    vehicle = (table_aircraft() if seed % 2 else linear_aircraft()).vehicle
    speed, density = float(np.mean(flight.log["V"])), float(np.mean(flight.log["air_density"]))
    found = {}
    for name in flight.excited:
        term = parse_term(name)
        if term.axis not in _OF_AXIS or len(term.factors) != 1:
            continue
        letter, mass, length = _OF_AXIS[term.axis]
        scale = 0.5 * density * speed**2 * vehicle.geometry.S / getattr(vehicle.mass, mass)
        scale *= getattr(vehicle.geometry, length) if length else 1.0
        (factor,) = term.factors
        scale *= getattr(vehicle.geometry, _LENGTH[factor]) / (2.0 * speed) if factor in _LENGTH else 1.0
        low, high = flight.truth[name]
        found[f"{letter}_{factor}"] = (scale * low, scale * high)
    return found
