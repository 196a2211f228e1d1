"""Whether a flight is one of the textbooks: sensors with white noise in time, surfaces that do as told, calm air.

Then the maximum likelihood of the books holds, and its bars are narrower than those of an estimator that must expect
lags and coloured noise of every flight. What decides is what that estimator found.
"""

from __future__ import annotations

import numpy as np

from sysid.posterior.analysis import PosteriorEstimate
from sysid.posterior.noise_spectrum import NoiseSpectrum
from sysid.signals.record import SURFACES

# A servo's lag, a vane's clock and an airspeed's lag, s, and half a servo's backlash, rad, that no estimate of a few
# standard errors needs.
_LATE_S = {"servo_lag": 0.005, "vane_clock": 0.005, "airspeed_lag": 0.03}
_BACKLASH = 7e-4
# A command acts from its stamp or from the next sample on: half an interval about the middle, and so much more, s.
_DELAY_S = 0.003
_SEEN = 3.0  # standard errors
# Outputs that a gust, a vibration and a filter colour first, and the logarithm of the largest over the smallest density
# (95 and 5 % of the frequencies) that white noise stays below: 0.2 to 0.55 on simulated sensors, 0.8 and more in gusts.
_TELLING = ("ax", "ay", "alpha", "beta")
_WHITE = 0.7


def is_textbook(found: PosteriorEstimate) -> bool:
    """Whether servos neither lag nor have play, nothing comes late, and what is left of forces and vanes is white."""
    late = {**_LATE_S, "servo_delay": 0.5 * _command_interval(found) + _DELAY_S}
    for one in found.nuisances:
        if abs(one.value) > max(late.get(one.name, np.inf), _SEEN * one.std):
            return False
        if one.name == "servo_backlash" and one.value > _BACKLASH:
            return False
    telling = [one for one in found.noise if one.output in _TELLING]
    return bool(telling) and all(_spread(one) < _WHITE for one in telling)


def _command_interval(found: PosteriorEstimate) -> float:
    """Longest median interval between commands, s."""
    inputs = [part.inputs for model in found.models.values() for part in model.parts]
    stamps = [each[name].time_s for each in inputs for name in SURFACES if name in each]
    return max((float(np.median(np.diff(one))) for one in stamps), default=0.0)


def _spread(one: NoiseSpectrum) -> float:
    low, high = np.percentile(one.density, (5.0, 95.0))
    return float(np.log(high / max(low, 1e-300)))
