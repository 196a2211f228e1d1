"""Equation error: coefficients from flight data, regressed on the terms of the model.

Sources: Klein & Morelli, "Aircraft System Identification", chapter 5. Pairing and weights:
sysid.equation_error.equations.
"""

from __future__ import annotations

from collections.abc import Sequence

from sim_vehicle.model.aerodynamic_terms import Term, parse_term
from sysid.equation_error.coefficients import Body
from sysid.equation_error.equations import CUTOFF_HZ, MOMENTS, Equations, axes_of
from sysid.equation_error.least_squares import RegressionResult, mixed_values, regress
from sysid.numerics.gaussian import Gaussian
from sysid.signals.flight import FlightData

JUMP_ROUNDS = 2  # in which samples beside a jump are left out


def equation_error(
    parts: FlightData | Sequence[FlightData],
    body: Body,
    names: Sequence[str],
    cutoff_hz: float = CUTOFF_HZ,
    command_first: bool = False,
    prior: Gaussian | None = None,
) -> dict[str, RegressionResult]:
    """Estimate model coefficients by equation error in the time domain.

    parts, body, cutoff_hz, command_first: see sysid.equation_error.equations.Equations. names: coefficients, as
    "CL_alpha", "CD_k". prior: what is known of coefficients before the flight; its correlations between axes are not
    used. Returns axis -> regression, its names being the coefficients; regressand and residual are weighted by dynamic
    pressure over its mean.
    Raises SignalError for a missing signal, EstimationError for terms that cannot be distinguished.
    """
    equations = settled_equations(parts, body, names, cutoff_hz, command_first, prior)
    terms = [parse_term(name) for name in names]
    results = {}
    for axis, chosen in axes_of(terms):
        own, known = _own(chosen, prior)
        X = equations.matrix(chosen)
        results[axis] = regress(equations.regressand(axis), X, own, equations.lengths, equations.bandwidth, known)
    return results


def settled_equations(
    parts: FlightData | Sequence[FlightData],
    body: Body,
    names: Sequence[str],
    cutoff_hz: float = CUTOFF_HZ,
    command_first: bool = False,
    prior: Gaussian | None = None,
    others: Sequence[str] = (),
) -> Equations:
    """The equations with the lift and the bent rates that the estimates of `equation_error` make.

    others: terms that columns will be asked for beside `names`.
    """
    terms = [parse_term(name) for name in names]
    equations = Equations(parts, body, [*terms, *map(parse_term, others)], cutoff_hz, command_first)
    _settle(equations, terms, prior)
    return equations


def equation_values(
    parts: FlightData | Sequence[FlightData],
    body: Body,
    names: Sequence[str],
    command_first: bool = False,
    prior: Gaussian | None = None,
) -> dict[str, float]:
    """The estimates of `equation_error` without their errors, for repetition with something changed."""
    terms = [parse_term(name) for name in names]
    return _settle(Equations(parts, body, terms, CUTOFF_HZ, command_first), terms, prior)


def _settle(equations: Equations, terms: Sequence[Term], prior: Gaussian | None) -> dict[str, float]:
    """Values of all terms, having given the equations the lift and the bent rates that follow from them."""
    values: dict[str, float] = {}

    def solve(axis: str, chosen: Sequence[Term]) -> None:
        own, known = _own(chosen, prior)
        found = mixed_values(equations.regressand(axis), equations.matrix(chosen), own, equations.bandwidth, known)
        values.update(zip(own, map(float, found), strict=True))
        if axis == "CL":
            equations.take_lift(chosen, found)

    grouped = axes_of(terms)
    for axis, chosen in grouped:
        solve(axis, chosen)
    moments = [(axis, chosen) for axis, chosen in grouped if axis in MOMENTS]
    # How far commands bend the rates depends on the control derivatives; an error of 5 % there is one of 0.1 % after.
    for _ in range(JUMP_ROUNDS):
        equations.take_jumps(values, [term for _, chosen in moments for term in chosen])
        for axis, chosen in moments:
            solve(axis, chosen)
    return values


def _own(terms: Sequence[Term], prior: Gaussian | None) -> tuple[list[str], Gaussian | None]:
    names = [term.name for term in terms]
    return names, None if prior is None else prior.of(names)
