"""What the travel of surfaces that nobody measured makes of the errors of coefficients."""

from __future__ import annotations

import math
from collections.abc import Mapping

# End of the name, in `systematic`, of the error of a linkage's gain, whose size the vehicle file states.
_GAIN = "_gain_std"


def travel_shares(systematic: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """By coefficient the standard error that the gains of linkages give it, as well as the vehicle file knows them."""
    return {
        name: math.hypot(*(shift for doubt, shift in shifts.items() if doubt.endswith(_GAIN)))
        for name, shifts in systematic.items()
    }
