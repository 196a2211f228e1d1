"""Smooth terms that a model lacks, by which whatever is missing shows, and what its own terms explain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim_vehicle.effects import CoefficientEffect, Parameter, Stage
from sim_vehicle.model.model_file import Model
from sysid.arrays import Array
from sysid.discrepancy.candidates import Candidate
from sysid.equation_error.coefficients import AXES
from sysid.numerics.normal_equations import inverse
from sysid.problem.estimation_problem import Problem

# Smooth terms that no single effect of the catalogue is, by which whatever is missing shows.
_LONGITUDINAL = ("alpha2", "alpha3", "q", "alpha_q", "de2", "alpha_de", "beta2", "alphadot")
_LATERAL = ("beta3", "alpha_beta", "alpha_p", "alpha_r", "alpha_da", "alpha_dr", "beta2", "alpha", "q", "de")


def smooth_terms(problem: Problem, model: Model) -> list[Candidate]:
    """Per axis, smooth terms that the model lacks: whatever acts on an axis looks somewhat like them."""
    found = []
    for axis in AXES:
        terms = _LONGITUDINAL if axis in ("CL", "CD", "Cm") else _LATERAL
        names = [f"{axis}_{term}" for term in terms]
        free = tuple(n for n in names if n not in model.coefficients and problem.motion.takes(n))
        if free:
            parameters = tuple(Parameter(name, "1", -1.0, 1.0, (0.0,)) for name in free)
            effect = CoefficientEffect(axis, f"smooth terms of {axis}", Stage.AERODYNAMICS, parameters, "")
            found.append(Candidate(effect, free, (dict.fromkeys(free, 0.0),)))
    return found


def explained_by_axis(names: Sequence[str], values: Array, covariance: Array) -> dict[str, float]:
    """Wald's statistic of the coefficients of each axis together: twice the log likelihood that they explain.

    Parameters
    ----------
    names : Sequence[str]
        P parameters, coefficients among them.
    values, covariance : Array, shapes (P,) and (P, P)
        Their estimates, each in its own unit.

    Returns
    -------
    dict[str, float]
        Axis -> statistic [1]; axes without a coefficient are left out.
    """
    found = {}
    for axis in AXES:
        places = [i for i, name in enumerate(names) if name.startswith(f"{axis}_")]
        if places:
            own = values[places]
            found[axis] = float(own @ inverse(covariance[np.ix_(places, places)]) @ own)
    return found
