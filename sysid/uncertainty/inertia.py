"""What moments of inertia that nobody measured make of the errors of coefficients."""

from __future__ import annotations

import math
from collections.abc import Mapping

# Doubts of `sysid.posterior.considered_errors` whose size the vehicle file states.
_DOUBTS = frozenset(("Ixx_std", "Iyy_std", "Izz_std", "Ixz_std"))


def inertia_shares(systematic: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """By coefficient the standard error that moments of inertia give it, whose own errors the vehicle file states."""
    return {
        name: math.hypot(*(shift for doubt, shift in shifts.items() if doubt in _DOUBTS))
        for name, shifts in systematic.items()
    }
