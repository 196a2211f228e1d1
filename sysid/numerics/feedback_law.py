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
LAW_OF: Mapping[str, Sequence[str]] = {"de": ("theta", "q"), "da": ("phi", "p"), "dr": ("r", "phi")}
# Fewer samples are no evidence; a command of less variance, rad^2, rests.
_FEWEST, _AT_REST = 50, 1e-12
# Windows in each of which a law is looked for, s, and the fewest samples of one.
_WINDOW_S, _FEWEST_IN_WINDOW = 3.0, 25
# Share of a surface's motion that a law explains.
_LAW_SHARE = 0.97
# Delays of a law that are tried, s; and by how much a motion may follow its command.
_LAW_DELAYS_S, _AHEAD_S = (0.0, 0.02, 0.04, 0.07, 0.10), (0.04, 0.07, 0.10)
# A law leaves of a command at most so many times what the motion that follows it leaves: an aircraft that rolls at once
# by its ailerons has a rate in proportion to them.
_AS_LITTLE = 1.1


def law_share(command: Callable[[Array], Array], time_s: Array, motion: Sequence[Array]) -> float:
    """Share of the time that a command moves in which it is nothing but gains times some measured motion.

    An autopilot lets go of a surface for a test input and takes it back: as a whole such a command is no law.

    Parameters
    ----------
    command : callable
        Values of the command, rad, at any times, s.
    time_s : Array, shape (N,)
        Times of the motion, s.
    motion : Sequence[Array], each of shape (N,)
        What it may be made of, rad and rad/s.

    Returns
    -------
    float
        0 for a command that rests.
    """
    size = round(_WINDOW_S / float(np.median(np.diff(time_s))))
    found = []
    for begin in range(0, time_s.size - size + 1, max(size, 1)):
        here = slice(begin, begin + size)
        if np.var(command(time_s[here])) > _AT_REST:
            found.append(is_feedback_law(command, time_s[here], [one[here] for one in motion], _FEWEST_IN_WINDOW))
    return float(np.mean(found)) if found else 0.0


def is_feedback_law(
    command: Callable[[Array], Array], time_s: Array, motion: Sequence[Array], fewest: int = _FEWEST
) -> bool:
    """Whether a command is nothing but gains times some measured motion, a little later, and not its cause.

    Parameters
    ----------
    command : callable
        Values of the command, rad, at any times, s.
    time_s : Array, shape (N,)
        Times of the motion, s.
    motion : Sequence[Array], each of shape (N,)
        What it may be made of, rad and rad/s; values that are not finite are left out.
    fewest : int, optional
        Samples below which there is no evidence.

    Returns
    -------
    bool
        False for a command that rests.
    """
    A = np.stack([*motion, np.ones(time_s.size)], axis=1)
    good = np.isfinite(A).all(axis=1)
    if np.count_nonzero(good) < fewest:
        return False

    def left(delay: float) -> float:
        """Share of the command, so much later, that no law explains."""
        u = command(time_s + delay)[good]
        off = float(np.var(u))
        rest = u - A[good] @ np.linalg.lstsq(A[good], u, rcond=None)[0]
        return float(np.var(rest)) / off if off > _AT_REST else np.inf

    least = min(left(delay) for delay in _LAW_DELAYS_S)
    return least < 1.0 - _LAW_SHARE and least <= _AS_LITTLE * min(left(-ahead) for ahead in _AHEAD_S)
