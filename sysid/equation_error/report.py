"""What a reader of an equation-error result should know of its regressions: fit, tests, collinearity, other terms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sim_vehicle.model.aerodynamic_terms import Term, parse_term
from sysid.arrays import Array
from sysid.equation_error.coefficient_tables import tables
from sysid.equation_error.coefficients import Body
from sysid.equation_error.collinearity import collinearity, correlated_pairs
from sysid.equation_error.equations import CONTROLS, CUTOFF_HZ, Equations, axes_of
from sysid.equation_error.frequency_domain import FrequencyResult, frequency_regression
from sysid.equation_error.least_squares import RegressionResult
from sysid.equation_error.orthogonal_functions import orthogonal_model
from sysid.equation_error.stepwise import TermTest, candidate_terms, p_value, predicted_square_error, stepwise, trial
from sysid.equation_error.time_domain import settled_equations
from sysid.errors import EstimationError
from sysid.numerics.gaussian import Gaussian
from sysid.signals.flight import FlightData

# Chance, over all terms tried in a flight, that one which is zero is reported as significant.
FALSE_TERM = 0.01
# Terms that explain less than this are below what errors of the vehicle file do.
LEAST_GAIN = 1e-3
# Variance inflation from which the motion's own noise no longer stays within the bars (measured: doublets, 18).
BIASING_VIF = 15.0
# Travel of the angle of attack, rad, over which a table shows more than a line.
WIDE_ALPHA = 0.1
# Standard errors by which time and frequency domain may differ.
_AGREEMENT = 4.0


def regression_report(
    parts: Sequence[FlightData],
    body: Body,
    regressions: Mapping[str, RegressionResult],
    joint: Gaussian,
    command_first: bool,
    prior: Gaussian,
) -> tuple[dict[str, Any], list[str]]:
    """The block "regression" of the result, and warnings.

    parts, body, command_first: what the regressions rest on. joint: estimates with the errors of the whole chain.
    prior: as the regressions had it. Each axis: method, r2, pse, condition, terms, collinear, excluded (tests of terms
    that the model does not have), structure (terms that stepwise regression and orthogonal functions would choose),
    over_alpha (the part that the angle of attack makes, as a table).
    """
    names = [name for result in regressions.values() for name in result.names]
    moved = _moved(parts)
    wider = [term.name for axis in regressions for term in candidate_terms(axis, moved) if term.name not in names]
    equations = settled_equations(parts, body, names, CUTOFF_HZ, command_first, prior, wider)
    estimates = joint.entries()
    report: dict[str, Any] = {}
    warnings: list[str] = []
    for axis, chosen in axes_of([parse_term(name) for name in names]):
        entry, found = _axis(equations, axis, chosen, regressions[axis], estimates)
        tests = _excluded(equations, axis, chosen, [parse_term(name) for name in wider])
        entry["excluded"] = [_test_json(test) for test in tests]
        entry["structure"] = _structures(equations, axis, chosen, [parse_term(name) for name in wider])
        entry["over_alpha"] = _over_alpha(equations, axis, chosen, regressions[axis], joint)
        report[axis] = entry
        warnings += found
        limit = FALSE_TERM / max(len(wider), 1)
        supported = [test.name for test in tests if test.p_value < limit and test.r2_gain > LEAST_GAIN]
        if supported:
            warnings.append(
                f"{axis}: the flight supports {', '.join(supported)} beside the model's terms; "
                "give a --structure with it"
            )
    return report, warnings


def _moved(parts: Sequence[FlightData]) -> set[str]:
    """Regressors on which these parts hold information."""
    surfaces = {
        name for name in CONTROLS if all(name in p for p in parts) and any(np.ptp(p[name]) > 0.0 for p in parts)
    }
    rest = {"alpha", "alphadot", "p", "q", "r"}
    return surfaces | rest | ({"beta"} if any(np.ptp(part["beta"]) > 0.0 for part in parts) else set())


def _axis(
    equations: Equations,
    axis: str,
    terms: Sequence[Term],
    result: RegressionResult,
    estimates: Mapping[str, tuple[float, float]],
) -> tuple[dict[str, Any], list[str]]:
    y, X = equations.regressand(axis), equations.matrix(terms)
    constant = next((i for i, term in enumerate(terms) if not term.factors), None)
    close = collinearity(X, result.names, constant)
    free = y.size * equations.bandwidth - len(terms)
    frequency = _in_frequency(equations, axis, terms)
    entries: dict[str, Any] = {}
    warnings: list[str] = []
    for i, name in enumerate(result.names):
        value, std = estimates[name]
        partial_f = float((result.values[i] / result.std[i]) ** 2)
        entries[name] = {
            "value": value, "std": std, "std_regression": float(result.std[i]), "partial_f": partial_f,
            "p_value": p_value(partial_f, free), "vif": float(close.vif[i]),
        }  # fmt: skip
        if isinstance(frequency, FrequencyResult) and name in frequency.names:
            j = frequency.names.index(name)
            other, other_std = float(frequency.values[j]), float(frequency.std[j])
            entries[name]["frequency_domain"] = {"value": other, "std": other_std}
            if abs(other - float(result.values[i])) > _AGREEMENT * np.hypot(other_std, std):
                warnings.append(
                    f"{name}: {value:.4g} in the time domain, {other:.4g} ± {other_std:.2g} in the frequency domain: "
                    "the model lacks something that depends on frequency"
                )
    if close.vif.max() > BIASING_VIF:
        warnings.append(
            f"{axis}: {'; '.join(close.words())}; noise of the reconstructed motion then biases equation error by more "
            "than its bars say: prefer --method oe"
        )
    entry = {
        "method": "time domain",
        "r2": result.r2,
        "pse": predicted_square_error(result.residual, len(terms), float(np.var(y)), equations.bandwidth),
        "condition": close.condition,
        "terms": entries,
        "collinear": close.words(),
        "correlated": [list(pair) for pair in correlated_pairs(result.names, result.correlation)],
        "frequency_domain": _frequency_json(frequency),
    }
    return entry, warnings


def _in_frequency(equations: Equations, axis: str, terms: Sequence[Term]) -> FrequencyResult | str:
    try:
        return frequency_regression(equations, axis, terms)
    except EstimationError as error:
        return str(error)


def _frequency_json(found: FrequencyResult | str) -> dict[str, Any]:
    if isinstance(found, str):
        return {"refused": found}
    return {
        "band_hz": [round(edge, 3) for edge in found.band_hz],
        "lines": int(found.frequencies_hz.size),
        "r2": found.r2,
        "coherence": float(np.median(found.coherence)),
    }


def _excluded(equations: Equations, axis: str, terms: Sequence[Term], wider: Sequence[Term]) -> list[TermTest]:
    """Tests of the terms that the model does not have, each beside those it has."""
    y, X = equations.regressand(axis), equations.matrix(terms)
    names = [term.name for term in terms]
    tests = []
    for term in wider:
        if term.axis == axis:
            column = equations.matrix([term])[:, 0]
            tests.append(trial(y, X, names, column, term.name, equations.lengths, equations.bandwidth))
    return tests


def _structures(equations: Equations, axis: str, terms: Sequence[Term], wider: Sequence[Term]) -> dict[str, Any]:
    """Terms that two ways of selection would choose among the model's and the candidates."""
    every = sorted([*terms, *(term for term in wider if term.axis == axis)], key=lambda term: len(term.factors))
    y, X = equations.regressand(axis), equations.matrix(every)
    names = [term.name for term in every]
    forced = [name for name in names if name.endswith("_0")]
    chosen: dict[str, Any] = {}
    try:
        chosen["stepwise"] = list(stepwise(y, X, names, forced, equations.lengths, equations.bandwidth).names)
        found = orthogonal_model(y, X, names, equations.lengths, equations.bandwidth)
        chosen["orthogonal"] = list(found.names)
    except EstimationError as error:
        chosen["refused"] = str(error)
    return chosen


def _over_alpha(
    equations: Equations, axis: str, terms: Sequence[Term], result: RegressionResult, joint: Gaussian
) -> dict[str, list[float]] | None:
    """What the angle of attack alone makes of an axis, as a table with errors; None where it hardly moved."""
    alpha = equations.values("alpha")
    constant = [term for term in terms if not term.factors]
    if axis not in ("CL", "Cm") or not constant or np.ptp(np.percentile(alpha, [1.0, 99.0])) < WIDE_ALPHA:
        return None
    kept = [term for term in terms if set(term.factors) != {"alpha"}]
    names = [term.name for term in kept]
    inflation = float(np.median((result.std / result.std_white) ** 2)) / equations.bandwidth
    try:
        y, X = equations.regressand(axis), equations.matrix(kept)
        table = tables(y, X, names, alpha, [constant[0].name], inflation=max(inflation, 1.0))[constant[0].name]
    except EstimationError:
        return None
    std = np.sqrt(table.std**2 + _of_sensors(axis, table.knots, result, joint))
    return {"alpha": table.knots.tolist(), "value": table.values.tolist(), "std": std.tolist()}


def _of_sensors(axis: str, alpha: Array, result: RegressionResult, joint: Gaussian) -> Array:
    """Variance that sensor errors add to a line over alpha (K,), from what they add to the model's own line."""
    names = [name for name in (f"{axis}_0", f"{axis}_alpha") if name in result.names and name in joint.names]
    line = np.stack([alpha if name.endswith("alpha") else np.ones(alpha.size) for name in names])
    whole = [joint.names.index(name) for name in names]
    alone = [result.names.index(name) for name in names]
    added = joint.covariance[np.ix_(whole, whole)] - result.covariance[np.ix_(alone, alone)]
    return np.asarray(np.maximum(np.sum(line * (added @ line), axis=0), 0.0), dtype=np.float64)


def _test_json(test: TermTest) -> dict[str, Any]:
    return {
        "name": test.name, "value": test.value, "std": test.std, "partial_f": test.partial_f,
        "p_value": test.p_value, "r2_gain": test.r2_gain, "reason": test.reason,
    }  # fmt: skip
