"""Whether a flight is one as the field gives them: servos that come late or lag, and no force with white noise."""

from __future__ import annotations

import numpy as np

from sysid.posterior.estimates import NuisanceEstimate, PosteriorEstimate
from sysid.posterior.noise_spectrum import NoiseSpectrum

# A servo's lag and delay, s, and half its play, rad, from which on they are none of a textbook: a delay of more than
# half a sample of commands that are held; small servos in small linkages have twice of such a play.
_LEAST = {"servo_lag": 0.005, "servo_delay": 0.012, "servo_backlash": 2e-4}
_SEEN = 3.0  # standard errors
# Outputs that a gust, a vibration and a filter colour first, and the logarithm of the largest over the smallest density
# (95 and 5 % of the frequencies) that white noise stays below: up to 0.6 in textbook gusts, 0.7 and more of an
# autopilot's sensors.
_FORCES, _WHITE = ("ax", "ay"), 0.65


def is_of_the_field(found: PosteriorEstimate) -> bool:
    """Whether in a group of axes servos come late, lag or have play, and no force leaves white noise in either.

    One thing alone may be what a model lacks; a flight with both is none of the textbooks, whatever the model lacks. In
    the group that lacks something nothing can be said of servos.
    """
    white = any(one.output in _FORCES and _spread(one) < _WHITE for one in found.noise)
    return not white and any(_is_loose(one) for one in found.nuisances)


def _is_loose(one: NuisanceEstimate) -> bool:
    return one.name in _LEAST and one.value > max(_LEAST[one.name], _SEEN * one.std)


def _spread(one: NoiseSpectrum) -> float:
    low, high = np.percentile(one.density, (5.0, 95.0))
    return float(np.log(high / max(low, 1e-300)))
