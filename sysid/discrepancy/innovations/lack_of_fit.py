"""Whether a model explains a flight: what its residuals hold beyond the sensors' noise and gusts."""

from __future__ import annotations

import numpy as np
from scipy import special

from sysid.discrepancy.innovations.candidate_fits import FittedModel
from sysid.discrepancy.innovations.filter_scores import filter_gains
from sysid.discrepancy.naming_rule import KNOWN_TO, LeftOver
from sysid.discrepancy.smooth_terms import explained_by_axis, smooth_terms
from sysid.discrepancy.wording import chance_text
from sysid.filter_error.estimation import build_filter
from sysid.numerics.autocorrelation import pooled_autocorrelation
from sysid.problem.estimation_problem import Problem
from sysid.signals.record import OUTPUTS

# Noise of an output over what its highest frequencies show, and how many samples of its innovations are
# alike (1 where they are white), beyond which something is called unexplained.
_NOISIER, COLOURED = 1.3, 1.5
# Chance of smooth terms of an axis gaining so much where nothing is missing, over all axes.
_CHANCE = 1e-4


def beyond_sensors(problem: Problem, setting: FittedModel) -> dict[str, tuple[float, float]]:
    """Output -> its noise over what its highest frequencies show, and how many samples of its innovations are alike."""
    result, found = setting.result, {}
    noise = build_filter(problem, setting.model, setting.coefficients, setting.effects)
    for j, variance in zip(noise.columns, noise.noise, strict=True):
        read = [one[:, j] for one in result.residuals if np.isfinite(one[:, j]).any()]
        colour = float(np.sum(pooled_autocorrelation([one / float(np.nanstd(one)) for one in read])))
        found[OUTPUTS[j]] = (float(result.sigma[j] / np.sqrt(variance)), colour)
    return found


def lack_of_fit(problem: Problem, setting: FittedModel, least: float = 0.0) -> dict[str, LeftOver]:
    """What filter error leaves: outputs that are noisier than their highest frequencies say and whose innovations are
    coloured, and axes in which smooth terms would still gain more than chance allows; each with how much.

    least: gain of an axis (twice its log likelihood) that is no matter.
    """
    result = setting.result
    found = {
        output: LeftOver(f"noise {ratio:.2f} times the sensor's, {colour:.1f} samples alike")
        for output, (ratio, colour) in beyond_sensors(problem, setting).items()
        if ratio > _NOISIER and colour > COLOURED
    }
    names = [parameter.name for parameter in result.parameters]
    explained = explained_by_axis(names, result.theta, result.covariance)
    choices = smooth_terms(problem, setting.model)
    gains = filter_gains(problem, setting.model, setting.coefficients, setting.effects, result, choices)
    for choice, (gain, _) in zip(choices, gains, strict=True):
        chance = float(special.chdtrc(len(choice.free), max(gain, 0.0)))
        floor = max(least, KNOWN_TO * explained.get(choice.effect.name, 0.0))
        if chance * len(choices) < _CHANCE and gain > floor:
            found[choice.effect.name] = LeftOver(f"smooth terms gain {gain:.0f}, {chance_text(chance)}", gain)
    return found
