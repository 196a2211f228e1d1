"""Whether a flight may be one of the textbooks: sensors with white noise, surfaces that do as told, calm air.

Then a sensor that is misread or comes late stands out, and a search for it is worth its while; behind servos that lag,
in gusts and vibration it finds what is not there. What decides is what the estimator for real flights found.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sysid.posterior.analysis import NuisanceEstimate, PosteriorEstimate
from sysid.posterior.noise_spectrum import NoiseSpectrum

# A servo's lag, s, and half a servo's backlash, rad, that no estimate of a few standard errors needs.
_LAG_S, _BACKLASH = 0.005, 7e-4
_SEEN = 3.0  # standard errors
# A delay, s, that is more than half a sample of commands that are held.
_LATE_S = 0.012
# Half a play that is told beside an effect that is missing: small servos in small linkages have twice of it, rad.
_LEAST_PLAY = 2e-4
# Outputs of each group that a gust, a vibration and a filter colour first, and the logarithm of the largest over the
# smallest density (95 and 5 % of the frequencies) that white noise stays below: 0.2 to 0.55 on simulated sensors, 0.8
# and more in gusts.
_TELLING = {"longitudinal": ("ax", "alpha"), "lateral": ("ay", "beta")}
_WHITE = 0.7
# Forces alone, beside an effect that is missing: up to 0.6 in textbook gusts, 0.7 and more of an autopilot's sensors.
_FORCES, _WHITE_FORCE = ("ax", "ay"), 0.65


def is_textbook(found: PosteriorEstimate) -> bool:
    """Whether in a group of axes servos neither lag nor have play, and what is left of a force or a vane is white."""
    held_up = _held_up(found, lambda play: play.value > _BACKLASH)
    telling = [name for group, names in _TELLING.items() if group not in held_up for name in names]
    return any(one.output in telling and _spread(one) < _WHITE for one in found.noise)


def is_of_the_field(found: PosteriorEstimate) -> bool:
    """Whether in a group of axes servos come late, lag or have play, and no force leaves white noise in either.

    One thing alone may be what a model lacks; a flight with both is none of the textbooks, whatever the model lacks. In
    the group that lacks something nothing can be said of servos.
    """
    white = any(one.output in _FORCES and _spread(one) < _WHITE_FORCE for one in found.noise)
    late = any(o.name == "servo_delay" and o.value > max(_LATE_S, _SEEN * o.std) for o in found.nuisances)
    loose = _held_up(found, lambda play: play.value > max(_LEAST_PLAY, _SEEN * play.std))
    return not white and (late or bool(loose))


def _held_up(found: PosteriorEstimate, is_play: Callable[[NuisanceEstimate], bool]) -> set[str]:
    """Groups of axes whose servos lag or have play."""
    return {
        one.group
        for one in found.nuisances
        if (one.name == "servo_lag" and one.value > max(_LAG_S, _SEEN * one.std))
        or (one.name == "servo_backlash" and is_play(one))
    }


def _spread(one: NoiseSpectrum) -> float:
    low, high = np.percentile(one.density, (5.0, 95.0))
    return float(np.log(high / max(low, 1e-300)))
