"""Equation error: coefficients from flight data, regressed on the terms of the model.

Regressand and regressors pass the same zero-phase filter, so that it cancels. A held command acts between its sample
and the next, while a smoothed derivative at a sample sees half an interval on either side: it is paired with the mean
of the two commands. Without that half sample Cm_alpha and Cm_de come out several percent wrong.
Sources: Klein & Morelli, "Aircraft System Identification", chapter 5.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim_vehicle.terms import Term, parse_term
from sysid.coefficients import AXES, Body, coefficients
from sysid.errors import EstimationError, SignalError
from sysid.flight import Array, FlightData
from sysid.regression import RegressionResult, regress
from sysid.smoothing import fourier_smooth

CUTOFF_HZ = 5.0
MOMENTS = ("Cl", "Cm", "Cn")
CONTROLS = ("de", "da", "dr", "throttle")
_EDGE_S = 0.1  # the sine series is weakest where its end-point line is pinned


def equation_error(
    parts: FlightData | Sequence[FlightData],
    body: Body,
    names: Sequence[str],
    cutoff_hz: float = CUTOFF_HZ,
    command_first: bool = False,
) -> dict[str, RegressionResult]:
    """Estimate model coefficients by equation error.

    parts: corrected parts (sysid.compatibility.correct) without NaN: ax ay az p q r alpha V thrust, beta where a
        term has it, and the commands de da dr throttle that terms have, held from each sample to the next.
    body: mass, inertia, geometry. names: coefficients, as "CL_alpha", "Cm_de", "CD_k".
    cutoff_hz: of the filter that all signals pass.
    command_first: whether a sensor at a sample already sees the command of that sample, or that of the one before.
    Returns axis -> regression, its names being the coefficients.
    Raises SignalError for a missing signal, EstimationError for terms that cannot be told apart.
    """
    sequence = [parts] if isinstance(parts, FlightData) else list(parts)
    if not sequence:
        raise EstimationError("equation error needs at least one part of a flight")
    terms = [parse_term(name) for name in names]
    sides = [_Side(part, body, terms, cutoff_hz, command_first) for part in sequence]
    lengths = [side.length for side in sides]
    bandwidth = min(2.0 * cutoff_hz * sequence[0].interval_s, 1.0)
    results: dict[str, RegressionResult] = {}
    lift: Array | None = None
    # CL before CD, whose polar takes the model's lift rather than the noisy measured one.
    for axis in AXES:
        chosen = [term for term in terms if term.axis == axis]
        if not chosen:
            continue
        y = np.concatenate([side.regressand[axis] for side in sides])
        regressors = {
            factor: np.concatenate([side.regressor(factor, axis) for side in sides])
            for factor in {f for term in chosen for f in term.factors} - {"CL"}
        }
        measured = np.concatenate([side.regressand["CL"] for side in sides])
        regressors["CL"] = measured if lift is None else lift
        X = np.column_stack([_product(term, regressors, y.size) for term in chosen])
        results[axis] = regress(y, X, [term.name for term in chosen], lengths, bandwidth)
        if axis == "CL":
            lift = X @ results[axis].values
    return results


def _product(term: Term, regressors: dict[str, Array], size: int) -> Array:
    product = np.ones(size)
    for factor in term.factors:
        product = product * regressors[factor]
    return product


class _Side:
    """Filtered regressands and regressors of one part."""

    def __init__(
        self, data: FlightData, body: Body, terms: Sequence[Term], cutoff_hz: float, command_first: bool
    ) -> None:
        self._data, self._cutoff, self._command_first = data, cutoff_hz, command_first
        edge = round(_EDGE_S / data.interval_s)
        self._kept = slice(edge, data.time_s.size - edge)
        self.length = data.time_s.size - 2 * edge
        if self.length < 16:
            raise SignalError(f"{data.name}: a part of {data.time_s.size} samples is too short for equation error")
        smooth: dict[str, Array] = {}
        slopes = []
        needed = {f for term in terms for f in term.factors}
        columns = ["alpha", "V", "p", "q", "r"] + (["beta"] if "beta" in needed else [])
        for name in columns:
            smoothed = fourier_smooth(self._column(name), data.interval_s, cutoff_hz)
            smooth[name] = smoothed.values
            if name in ("p", "q", "r"):
                slopes.append(smoothed.derivative)
            if name == "alpha":
                smooth["alphadot"] = smoothed.derivative
        per_length = 1.0 / (2.0 * smooth["V"])
        quiet = {name: smooth[name] for name in ("alpha", "V", "p", "q", "r")}
        columns_now = data.columns | quiet
        if "air_density" in data:
            columns_now["air_density"] = self._column("air_density")
        filtered = FlightData(data.name, data.interval_s, data.time_s, columns_now, (), data.notes)
        made = coefficients(filtered, body, np.column_stack(slopes))
        # Moments come from filtered rates already; forces from specific force as measured.
        self.regressand = {
            axis: values[self._kept] if axis in MOMENTS else self._filter(values)[self._kept]
            for axis, values in made.items()
        }
        lengths = {"p": body.b, "q": body.c, "r": body.b, "alphadot": body.c}
        self._smooth = {
            name: values * (lengths[name] * per_length if name in lengths else 1.0) for name, values in smooth.items()
        }

    def regressor(self, factor: str, axis: str) -> Array:
        """One factor, filtered; a command as the axis' kind of measurement sees it."""
        if factor not in CONTROLS:
            return np.asarray(self._smooth[factor][self._kept], dtype=np.float64)
        held = self._column(factor)
        before = np.concatenate([held[:1], held[:-1]])
        at_sample = held if self._command_first else before
        return self._filter(0.5 * (held + before) if axis in MOMENTS else at_sample)[self._kept]

    def _filter(self, values: Array) -> Array:
        return fourier_smooth(values, self._data.interval_s, self._cutoff).values

    def _column(self, name: str) -> Array:
        if name not in self._data:
            raise SignalError(f"{self._data.name}: the model has a term in {name}, which the flight lacks")
        values = self._data[name]
        if not np.isfinite(values).all():
            raise SignalError(f"{self._data.name}: {name} has gaps in this part; give a part without (find_segments)")
        return values
