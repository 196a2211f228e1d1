"""What a reader of an equation-error result should know of its regressions: fit, tests, collinearity, other terms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sim_vehicle.terms import Term, parse_term
from sysid.coefficients import Body
from sysid.collinearity import collinearity, correlated_pairs
from sysid.equation_error import settled_equations
from sysid.equations import CONTROLS, CUTOFF_HZ, Equations, axes_of
from sysid.errors import EstimationError
from sysid.flight import FlightData
from sysid.frequency_regression import FrequencyResult, frequency_regression
from sysid.polynomials import candidate_terms
from sysid.prior import Gaussian
from sysid.regression import RegressionResult
from sysid.stepwise import TermTest, p_value, predicted_square_error, trial

# Chance, over all terms tried in a flight, that one which is zero is told to be there.
FALSE_TERM = 0.01
# Terms that explain less than this are below what errors of the vehicle file do.
LEAST_GAIN = 1e-3
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
    prior: as the regressions had it. Each axis: method, r2, pse, condition, terms, collinear, excluded.
    """
    names = [name for result in regressions.values() for name in result.names]
    moved = _moved(parts)
    wider = [term.name for axis in regressions for term in candidate_terms(axis, moved) if term.name not in names]
    equations = settled_equations(parts, body, names, CUTOFF_HZ, command_first, prior, wider)
    told = joint.entries()
    report: dict[str, Any] = {}
    warnings: list[str] = []
    for axis, chosen in axes_of([parse_term(name) for name in names]):
        entry, found = _axis(equations, axis, chosen, regressions[axis], told)
        tests = _excluded(equations, axis, chosen, [parse_term(name) for name in wider])
        entry["excluded"] = [_test_json(test) for test in tests]
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
    """Regressors that these parts can tell anything about."""
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
    told: Mapping[str, tuple[float, float]],
) -> tuple[dict[str, Any], list[str]]:
    y, X = equations.regressand(axis), equations.matrix(terms)
    constant = next((i for i, term in enumerate(terms) if not term.factors), None)
    close = collinearity(X, result.names, constant)
    free = y.size * equations.bandwidth - len(terms)
    frequency = _in_frequency(equations, axis, terms)
    entries: dict[str, Any] = {}
    warnings: list[str] = []
    for i, name in enumerate(result.names):
        value, std = told[name]
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
    entry = {
        "method": "time domain",
        "r2": result.r2,
        "pse": predicted_square_error(y, result.residual, len(terms), equations.bandwidth),
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


def _test_json(test: TermTest) -> dict[str, Any]:
    return {
        "name": test.name, "value": test.value, "std": test.std, "partial_f": test.partial_f,
        "p_value": test.p_value, "r2_gain": test.r2_gain, "reason": test.reason,
    }  # fmt: skip
