"""Equation error: coefficients from flight data, regressed on the terms of the model.

Sources: Klein & Morelli, "Aircraft System Identification", chapter 5. Pairing and weights: sysid.equations.
"""

from __future__ import annotations

from collections.abc import Sequence

from sim_vehicle.terms import Term, parse_term
from sysid.coefficients import Body
from sysid.equations import CUTOFF_HZ, FORCES, MOMENTS, Equations, axes_of
from sysid.flight import FlightData
from sysid.regression import RegressionResult, regress

_JUMP_ROUNDS = 2


def equation_error(
    parts: FlightData | Sequence[FlightData],
    body: Body,
    names: Sequence[str],
    cutoff_hz: float = CUTOFF_HZ,
    command_first: bool = False,
) -> dict[str, RegressionResult]:
    """Estimate model coefficients by equation error in the time domain.

    parts, body, cutoff_hz, command_first: see sysid.equations.Equations. names: coefficients, as "CL_alpha", "CD_k".
    Returns axis -> regression, its names being the coefficients; regressand and residual are weighted by dynamic
    pressure over its mean.
    Raises SignalError for a missing signal, EstimationError for terms that cannot be told apart.
    """
    terms = [parse_term(name) for name in names]
    equations = Equations(parts, body, terms, cutoff_hz, command_first)
    results = {axis: _regressed(equations, axis, chosen) for axis, chosen in axes_of(terms) if axis in FORCES}
    moments = [(axis, chosen) for axis, chosen in axes_of(terms) if axis in MOMENTS]
    found = {axis: _regressed(equations, axis, chosen) for axis, chosen in moments}
    # How far commands bend the rates depends on the control derivatives; an error of 5 % there is one of 0.1 % after.
    for _ in range(_JUMP_ROUNDS if moments else 0):
        values = {name: float(v) for one in found.values() for name, v in zip(one.names, one.values, strict=True)}
        equations.take_jumps(values, [term for _, chosen in moments for term in chosen])
        found = {axis: _regressed(equations, axis, chosen) for axis, chosen in moments}
    return results | found


def _regressed(equations: Equations, axis: str, terms: Sequence[Term]) -> RegressionResult:
    names = [term.name for term in terms]
    X = equations.matrix(terms)
    result = regress(equations.regressand(axis), X, names, equations.lengths, equations.bandwidth)
    if axis == "CL":
        equations.take_lift(terms, result.values)
    return result
