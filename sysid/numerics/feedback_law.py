"""Surfaces that nothing moves but a law of the motion: a damper, or an attitude hold without set points.

What such a surface does cannot be distinguished from damping and stability; where no other one moves, gusts alone have
excited the motion, and what is estimated of it is the inverse of what flies the aircraft (Soderstrom, Gustavsson &
Ljung, "Identifiability conditions for linear multivariable systems operating under feedback", Int. J. Control 21,
1975).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from sysid.arrays import Array

# Signals of which a hold or a damper makes the command of each surface.
LAW_OF: Mapping[str, Sequence[str]] = {"de": ("theta", "q"), "da": ("phi", "p"), "dr": ("r",)}
# Share of a surface's motion that a law explains.
_LAW_SHARE = 0.97
# Delays of a law that are tried, s.
_LAW_DELAYS_S = (0.0, 0.02, 0.04, 0.07, 0.10)


def is_feedback_law(command: Callable[[Array], Array], time_s: Array, motion: Sequence[Array]) -> bool:
    """Whether a command is nothing but gains times some measured motion, a little later.

    Parameters
    ----------
    command : callable
        Values of the command, rad, at any times, s.
    time_s : Array, shape (N,)
        Times of the motion, s.
    motion : Sequence[Array], each of shape (N,)
        What it may be made of, rad and rad/s; values that are not finite are left out.

    Returns
    -------
    bool
        False for a command that rests.
    """
    A = np.stack([*motion, np.ones(time_s.size)], axis=1)
    good = np.isfinite(A).all(axis=1)
    for delay in _LAW_DELAYS_S:
        u = command(time_s + delay)[good]
        off = float(np.var(u)) if u.size else 0.0
        left = u - A[good] @ np.linalg.lstsq(A[good], u, rcond=None)[0]
        if off > 0.0 and float(np.var(left)) < (1.0 - _LAW_SHARE) * off:
            return True
    return False
