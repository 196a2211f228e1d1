"""Whether a flight is one of the textbooks: sensors with white noise, surfaces that do as told, calm air.

Then the maximum likelihood of the books holds, and its bars are narrower than those of an estimator that must expect
lags and coloured noise of every flight. What decides is what that estimator found.
"""

from __future__ import annotations

import numpy as np

from sysid.posterior.analysis import PosteriorEstimate
from sysid.posterior.noise_spectrum import NoiseSpectrum

# A servo's lag, s, and half its backlash, rad, that no estimate of a few standard errors needs.
_LAG_S, _BACKLASH = 0.005, 7e-4
_SEEN = 3.0  # standard errors
# Outputs that a gust, a vibration and a filter colour first, and the logarithm of the largest over the smallest density
# (95 and 5 % of the frequencies) that white noise stays below: 0.2 to 0.55 on simulated sensors, 0.8 and more in gusts.
_TELLING = ("ax", "ay", "alpha", "beta")
_WHITE = 0.7


def is_textbook(found: PosteriorEstimate) -> bool:
    """Whether the servos neither lag nor have play, and what is left of the forces and vanes is white."""
    for one in found.nuisances:
        seen = one.value > _SEEN * one.std
        if (one.name == "servo_lag" and one.value > _LAG_S and seen) or (
            one.name == "servo_backlash" and one.value > _BACKLASH
        ):
            return False
    telling = [one for one in found.noise if one.output in _TELLING]
    return bool(telling) and all(_spread(one) < _WHITE for one in telling)


def _spread(one: NoiseSpectrum) -> float:
    low, high = np.percentile(one.density, (5.0, 95.0))
    return float(np.log(high / max(low, 1e-300)))
