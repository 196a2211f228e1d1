"""Start values: equation error on the smoothed signals of the parts (Klein & Morelli, ch. 5)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.posterior.flight_part import FlightPart
from sysid.posterior.inputs import servo
from sysid.problem.model_structure import usual_size

# Delays of the commands that are tried, s.
_DELAYS_S = (0.0, 0.02, 0.04, 0.06, 0.08, 0.11)
_USUAL_DELAYS_S = (0.0, 0.035, 0.05)  # of servos that follow at once, as simulators' do, and of others
# Signs of a stable aircraft's derivatives, surfaces as the vehicle file has them: trailing edge down, and to the left.
_SIGNS = {
    "CL_alpha": 1.0, "CL_q": 1.0, "CL_de": 1.0, "Cm_alpha": -1.0, "Cm_q": -1.0, "Cm_de": -1.0,
    "CY_beta": -1.0, "CY_dr": 1.0, "Cl_beta": -1.0, "Cl_p": -1.0, "Cl_r": 1.0, "Cl_da": -1.0,
    "Cn_beta": 1.0, "Cn_r": -1.0, "Cn_dr": -1.0,
}  # fmt: skip
# Ends of a part that are left out, s, where smoothing and derivatives are poor.
_ENDS_S = 0.3


def equation_error_starts(
    parts: Sequence[FlightPart], vehicle: Vehicle, names: Sequence[str]
) -> list[tuple[dict[str, float], float]]:
    """Values of the coefficients that the parts' smoothed motion gives by least squares, for each delay [s] of the
    commands that is tried.

    A wrong delay turns the signs of damping and stability, from where no search comes back; and a vane that lags makes
    the wrong one fit best. So all are given, and the likelihood of a simulation chooses.
    """
    delays = (0.0,) if all(part.position for part in parts) else _DELAYS_S
    return [(_fit(parts, vehicle, names, delay), delay) for delay in delays]


def usual_starts(
    parts: Sequence[FlightPart], vehicle: Vehicle, names: Sequence[str]
) -> list[tuple[dict[str, float], float]]:
    """Values of the coefficients that a stable aircraft of the class has, level as measured, with delays [s] to try.

    Where an autopilot flies, its commands go with the motion and equation error's values are far off, and from far off
    no search comes back.
    """
    usual = {
        name: _SIGNS.get(name, 0.0) * usual_size(name)
        for name in names
        if parse_term(name).factors and not name.startswith("CD")
    }
    measured = _fit(parts, vehicle, [name for name in names if name.startswith("CD")], 0.0)
    starts = []
    for delay in (0.0,) if all(part.position for part in parts) else _USUAL_DELAYS_S:
        columns = [_columns(part, vehicle, delay) for part in parts]
        levels = {}
        for name in (one for one in names if not parse_term(one).factors and not one.startswith("CD")):
            axis = parse_term(name).axis
            known = [one for one in usual if parse_term(one).axis == axis]
            left = [each[axis] - sum(usual[one] * _regressor(one, each) for one in known) for each in columns]
            levels[name] = float(np.mean(np.concatenate(left)))
        starts.append(({**usual, **measured, **levels}, delay))
    return starts


def _fit(parts: Sequence[FlightPart], vehicle: Vehicle, names: Sequence[str], delay: float) -> dict[str, float]:
    columns = [_columns(part, vehicle, delay) for part in parts]
    found: dict[str, float] = {}
    for axis in dict.fromkeys(parse_term(name).axis for name in names):
        own = [name for name in names if parse_term(name).axis == axis]
        y = np.concatenate([one[axis] for one in columns])
        X = np.concatenate([np.stack([_regressor(name, one) for name in own], axis=1) for one in columns])
        size = np.sqrt(np.mean(X * X, axis=0))
        scale = np.where(size > 0.0, size, 1.0)
        values = np.linalg.lstsq(X / scale, y, rcond=1e-10)[0] / scale
        found |= {name: float(value) for name, value in zip(own, values, strict=True)}
    return found


def _regressor(name: str, columns: dict[str, Array]) -> Array:
    factors = ("CL2",) if name == "CD_k" else parse_term(name).factors
    return np.asarray(np.prod([columns[f] for f in factors] or [np.ones_like(columns["alpha"])], axis=0))


def _columns(part: FlightPart, vehicle: Vehicle, delay: float) -> dict[str, Array]:
    """Coefficients and their regressors along a part."""
    dt = float(part.grid[1] - part.grid[0])
    mass, geometry, motion, V = vehicle.mass, vehicle.geometry, part.motion, part.airspeed.values
    p, q, r, alpha = (motion[name] for name in ("p", "q", "r", "alpha"))
    beta = motion.get("start_beta", motion["beta"])
    pd, qd, rd, ad = (np.gradient(one, dt) for one in (p, q, r, alpha))
    x, y, z = vehicle.sensors.accelerometer.position
    ax = motion["ax"] - (qd * z - rd * y - (q * q + r * r) * x + p * q * y + p * r * z)
    ay = motion["ay"] - (rd * x - pd * z + p * q * x - (p * p + r * r) * y + q * r * z)
    az = motion["az"] - (pd * y - qd * x + p * r * x + q * r * y - (p * p + q * q) * z)
    qS = 0.5 * part.rho * V * V * geometry.S
    throttle = part.inputs["throttle"].at(part.grid) if "throttle" in part.inputs else np.zeros_like(V)
    thrust = np.where(np.isfinite(part.thrust), part.thrust, throttle * _full_thrust(vehicle))
    ahead = mass.mass * ax - thrust
    found = {
        "CL": (ahead * np.sin(alpha) - mass.mass * az * np.cos(alpha)) / qS,
        "CD": (-ahead * np.cos(alpha) - mass.mass * az * np.sin(alpha)) / qS,
        "CY": mass.mass * ay / qS,
        "Cl": (mass.Ixx * pd - mass.Ixz * (rd + p * q) + (mass.Izz - mass.Iyy) * q * r) / (qS * geometry.b),
        "Cm": (mass.Iyy * qd + (mass.Ixx - mass.Izz) * p * r + mass.Ixz * (p * p - r * r)) / (qS * geometry.c),
        "Cn": (mass.Izz * rd - mass.Ixz * (pd - q * r) + (mass.Iyy - mass.Ixx) * p * q) / (qS * geometry.b),
        "alpha": alpha, "beta": beta, "p": p * geometry.b / (2.0 * V), "q": q * geometry.c / (2.0 * V),
        "r": r * geometry.b / (2.0 * V), "alphadot": ad * geometry.c / (2.0 * V), "throttle": throttle,
    }  # fmt: skip
    found["CL2"] = found["CL"] ** 2
    for name in ("de", "da", "dr", *vehicle.named_controls):
        if name in part.inputs:
            found[name] = servo(part.inputs[name], part.grid, delay, 0.0, 0.0)
        else:
            found[name] = np.zeros_like(V)
    ends = round(_ENDS_S / dt)
    counted = np.interp(part.grid, part.common.points, part.common.counted.astype(float)) > 0.5
    counted[:ends] = counted[-ends:] = False
    return {name: values[counted] for name, values in found.items()}


def _full_thrust(vehicle: Vehicle) -> float:
    """N at full throttle, at rest; 0 where the vehicle file says nothing."""
    return float(getattr(vehicle.propulsion, "max_thrust", None) or 0.0)
