"""Which sample's command a sensor shows, by the likelihood of the whole motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid.numerics.normal_equations import damped_step
from sysid.output_error.estimator import UnlikelyError
from sysid.output_error.fit import build, fit, warmed
from sysid.output_error.linearisation import Linearised

# Log likelihood that the other timing must gain.
_MARGIN = 5.0
# Times of what the slopes at the first timing promise, by which the other one must miss it to be out at once.
_FAR = 12.0


def likelier_timing(here: Linearised) -> Linearised:
    """The estimate with the other timing of the commands (see sysid.equation_error.command_order), if that is clearly
    likelier.
    """
    problem, result = here.problem, here.result
    other = warmed(replace(problem, command_first=not problem.command_first), result)
    if _is_out(here, replace(here, problem=other)):
        return here
    values = {p.name: float(v) for p, v in zip(result.parameters, result.theta, strict=False)}
    try:
        found = fit(other, here.model, here.coefficients, here.effects, values, give_up_above=result.cost)
    except UnlikelyError:
        return here
    return replace(here, problem=other, result=found) if found.cost < result.cost - _MARGIN else here


def _is_out(here: Linearised, there: Linearised) -> bool:
    """Whether the other timing is so unlikely at the same values that no step makes up for it.

    The slopes are those of the first timing, half a sample of the commands off, which saves the other's own. A
    simulation that diverges is out.
    """
    estimation, theta = build(there.problem, there.model, there.coefficients, there.effects), here.result.theta
    cost = estimation.cost(theta, there.residuals)
    if not np.isfinite(cost):
        return True
    information, downhill = estimation.normal_equations(
        theta, there.residuals, here.S, estimation.sigma(there.residuals)
    )
    step = damped_step(information, downhill, 0.0, here.problem.records[0].flight)
    return cost - _FAR * 0.5 * float(downhill @ step) > here.result.cost
