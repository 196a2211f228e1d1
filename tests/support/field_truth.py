"""The truth of a flight as intervals: one number for linear aerodynamics, a range for tables.

For tables a linear model has no one right value: the interval is the range of the local slopes over the middle 80 % of
the angles of attack flown, united with what comes nearest to JSBSim's own coefficients along the flight.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from field_plant import Log
from jsbsim_flight import _DEGREES, _ELEVATOR, _TABLES, Aircraft
from jsbsim_twin import AXES, Array
from scipy.interpolate import CubicSpline, RectBivariateSpline

from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.vehicle.mass_properties import Geometry
from sysid.problem.model_structure import default_structure

STRUCTURE = default_structure(("de", "da", "dr"))
Interval = tuple[float, float]


def regressors_of(log: Log, geometry: Geometry) -> dict[str, Array]:
    """(N,) of every regressor of coefficient names along the true motion; rates against the air's own."""
    V = log["V"]
    return {
        "alpha": log["alpha"],
        "beta": log["beta"],
        "p": (log["p"] - log.columns.get("p_gust", np.zeros(V.size))) * geometry.b / (2.0 * V),
        "q": log["q"] * geometry.c / (2.0 * V),
        "r": log["r"] * geometry.b / (2.0 * V),
        "CL": log["CL"],
        **{name: log[name] for name in ("de", "da", "dr")},
    }


def projection(log: Log, geometry: Geometry, part: slice | Array = slice(None)) -> dict[str, float]:
    """The default structure's coefficients that come nearest to JSBSim's along (a part of) the flight."""
    return _nearest(log, geometry, part)[0]


def left_by_axis(log: Log, geometry: Geometry) -> dict[str, float]:
    """Share of the variation of each of JSBSim's six coefficients that the default structure cannot hold."""
    return _nearest(log, geometry, slice(None))[1]


def _nearest(log: Log, geometry: Geometry, part: slice | Array) -> tuple[dict[str, float], dict[str, float]]:
    along = regressors_of(log, geometry)
    found: dict[str, float] = {}
    left: dict[str, float] = {}
    for axis in AXES:
        names = [name for name in STRUCTURE if parse_term(name).axis == axis]
        ones = np.ones(log.time_s.size)
        X = np.stack([np.prod([along[f] for f in parse_term(n).factors] or [ones], axis=0) for n in names], axis=1)
        values = np.linalg.lstsq(X[part], log[axis][part], rcond=None)[0]
        found |= dict(zip(names, values.tolist(), strict=True))
        left[axis] = float(np.std((log[axis] - X @ values)[part]) / np.std(log[axis][part]))
    return found, left


def truth_of(log: Log, aircraft: Aircraft) -> dict[str, Interval]:
    """Interval of each coefficient of the default structure, for one of our own aircraft."""
    if aircraft.name == "linear":
        return {name: (value, value) for name, value in aircraft.model.values().items() if name in STRUCTURE}
    nearest = projection(log, aircraft.vehicle.geometry)
    local = table_slopes(log["alpha"], log["de"])
    values = {name: (nearest[name], *local.get(name, ())) for name in STRUCTURE}
    # Where the aerodynamics of the tables' aircraft are linear they are known, whatever the flight excites.
    exact = {name: (value, value) for name, value in aircraft.model.values().items() if name in STRUCTURE}
    return {name: exact.get(name, (min(value), max(value))) for name, value in values.items()}


def table_slopes(alpha: Array, elevator: Array) -> Mapping[str, tuple[float, ...]]:
    """Local values of what the tables hold, at angles of attack from the 10th to the 90th percentile."""
    at = np.linspace(*np.percentile(alpha, [10.0, 90.0]), 9)
    tables = {key: CubicSpline(np.radians(_DEGREES), values) for key, values in _TABLES.items()}
    found: dict[str, Array] = {}
    deflections = np.radians([de for de, _ in _ELEVATOR])
    angles = np.radians([-6.0, 2.0, 10.0, 18.0])
    surface = RectBivariateSpline(angles, deflections, np.array([values for _, values in _ELEVATOR]).T)
    de = np.percentile(elevator, [10.0, 50.0, 90.0])
    found["Cm_de"] = np.ravel(surface(at, de, dy=1))
    for axis in ("CL", "Cm"):
        slope = tables[axis, "0"](at, 1)
        # A table of the elevator turns with angle of attack too.
        turned = slope[:, None] + (surface(at, de, dx=1) if axis == "Cm" else np.zeros((at.size, 1)))
        found[f"{axis}_alpha"] = np.ravel(turned)
        found[f"{axis}_0"] = tables[axis, "0"](at) - slope * at
    for axis, factor in (("Cl", "beta"), ("Cl", "p"), ("Cn", "beta")):
        found[f"{axis}_{factor}"] = tables[axis, factor](at)
    lift, drag = tables["CL", "0"], tables["CD", "0"]
    found["CD_k"] = drag(at, 1) / (2.0 * lift(at) * lift(at, 1))
    found["CD_0"] = drag(at) - found["CD_k"] * lift(at) ** 2
    return {name: tuple(values.tolist()) for name, values in found.items()}
