"""Dimensional derivatives: what a flight shows of an aircraft before its mass and moments of inertia are known.

Force or moment per mass or moment of inertia, as control engineers use them (Nelson, Flight Stability and Automatic
Control, 2nd ed., tables 3.5 and 3.6): M_alpha = Cm_alpha Q S c / Iyy, M_q = Cm_q Q S c^2 / (2 V Iyy). Each is of one
coefficient: no product of inertia is in them, and no drag in Z_alpha = -CL_alpha Q S / m.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.problem.vehicle_errors import under_error
from sysid.uncertainty.total import ErrorParts

# Axis of a coefficient -> letter of the derivative, what the vehicle's mass has for it, which length, sign.
_AXES = {
    "CL": ("Z", "mass", "", -1.0), "CY": ("Y", "mass", "", 1.0),
    "Cl": ("L", "Ixx", "b", 1.0), "Cm": ("M", "Iyy", "c", 1.0), "Cn": ("N", "Izz", "b", 1.0),
}  # fmt: skip
_RATES = {"p": "b", "q": "c", "r": "b", "alphadot": "c"}
_SHORT = {"throttle": "dt"}
# Of one standard deviation of what was taken as known.
_STEP = 1e-3


def dimensional_derivatives(
    vehicle: Vehicle, model: Model, airspeed: float, density: float, errors: ErrorParts | None
) -> dict[str, dict[str, float | str]]:
    """Derivatives about the flight's mean: name -> value, standard error and unit.

    What was taken as known moves coefficients and aircraft together, and hardly the derivatives.

    Parameters
    ----------
    vehicle : Vehicle
        Mass, moments of inertia and geometry of the estimates.
    model : Model
        Coefficients; those that are refused give no derivative.
    airspeed : float
        True airspeed, m/s.
    density : float
        Density of the air, kg/m^3.
    errors : ErrorParts, optional
        Errors of the coefficients; without them `std` is left out.

    Returns
    -------
    dict
        Forces per mass in m/s^2, moments per moment of inertia in 1/s^2, each per rad or per rad/s.
    """
    found: dict[str, dict[str, float | str]] = {}
    places = {} if errors is None else {name: i for i, name in enumerate(errors.known.names)}
    for name, entry in model.coefficients.items():
        term = parse_term(name)
        if term.axis not in _AXES or len(term.factors) != 1 or entry.value is None:
            continue
        per = partial(_per_coefficient, axis=term.axis, factor=term.factors[0], airspeed=airspeed)
        scale = per(vehicle, density)
        one: dict[str, float | str] = {"value": scale * entry.value}
        if errors is not None and name in places:
            place = places[name]
            parts = [scale * float(np.sqrt(errors.known.covariance[place, place]))]
            for source, shift in errors.shifts.items():
                other, denser = under_error(vehicle, density, source, _STEP)
                change = per(other, denser) * (entry.value + _STEP * float(shift[place])) - scale * entry.value
                parts.append(change / _STEP)
            one["std"] = math.hypot(*parts)
        factor = _SHORT.get(term.factors[0], term.factors[0])
        found[f"{_AXES[term.axis][0]}_{factor}"] = {**one, "unit": _unit(term.axis, term.factors[0])}
    return found


def _per_coefficient(vehicle: Vehicle, density: float, axis: str, factor: str, airspeed: float) -> float:
    """The derivative of a coefficient of one."""
    _, mass, length, sign = _AXES[axis]
    geometry = vehicle.geometry
    scale = sign * 0.5 * density * airspeed**2 * geometry.S / getattr(vehicle.mass, mass)
    scale *= getattr(geometry, length) if length else 1.0
    return float(scale * getattr(geometry, _RATES[factor]) / (2.0 * airspeed) if factor in _RATES else scale)


def _unit(axis: str, factor: str) -> str:
    force, rate = not _AXES[axis][2], factor in _RATES
    return ("m/s" if rate else "m/s^2") if force else ("1/s" if rate else "1/s^2")
