"""Smooth terms that a model lacks, by which whatever is missing shows."""

from __future__ import annotations

from sim_vehicle.effects import CoefficientEffect, Parameter, Stage
from sim_vehicle.model.model_file import Model
from sysid.discrepancy.candidates import Candidate
from sysid.equation_error.coefficients import AXES
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
