"""What every effect of the catalogue promises: Rao's score test.

At the estimate of the model so far, each candidate adds columns of its own: how what is compared changes where the
effect is there. With c a candidate's parameters and b all others, I information and g gradient,

    gain = g' S^-1 g,   g = g_c - I_cb I_bb^-1 g_b,   S = I_cc - I_cb I_bb^-1 I_bc

is twice the log likelihood to be won, and S^-1 g the size to start from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Array
from sysid.discrepancy.candidates import Candidate
from sysid.numerics.normal_equations import inverse

# A start value is moved by what the score predicts, but not by more than these factors.
_LEAST, _MOST = 0.1, 3.0
# Of an effect's plausible range, beyond which the score's linear prediction is not followed.
_RANGE = 0.5
# Share of a direction that nothing else can imitate, below which it counts as an imitation.
_OWN = 1e-6


@dataclass(frozen=True)
class ScoredColumn:
    """One parameter of one candidate, from one start: where it stands and by how much it was moved."""

    candidate: int
    start: int
    name: str
    moved: float


def gains_of(
    choices: Sequence[Candidate],
    columns: Sequence[ScoredColumn],
    inner: Array,
    downhill: Array,
    rows: Array,
    gradient: Array,
    own_share: float = _OWN,
) -> list[tuple[float, dict[str, float]]]:
    """What each candidate promises by Rao's score test, as `filter_gains` gives it.

    Parameters
    ----------
    choices : Sequence[Candidate]
        The candidate effects.
    columns : Sequence[ScoredColumn], length C
        The columns that the candidates add: each one parameter of one candidate, from one of its starts.
    inner : Array, shape (P, P)
        Information of the model's own parameters, prior included; per product of the two parameters' units.
    downhill : Array, shape (P,)
        Their gradient, prior included; per unit of each parameter.
    rows : Array, shape (C, P + C)
        Information of the columns with the model's own parameters and with one another, in units as `inner`.
    gradient : Array, shape (C,)
        Gradient of the columns, in units as `downhill`.
    own_share : float
        Share of a direction that nothing else can imitate, below which it counts as an imitation; dimensionless.

    Returns
    -------
    list of (float, dict[str, float])
        For each candidate twice the log likelihood to be won, and the parameters to start from, each in its own unit.
    """
    own = downhill.size
    solve, cross, outer = inverse(inner), rows[:, :own], rows[:, own:]
    score = gradient - cross @ solve @ downhill
    schur = outer - cross @ solve @ cross.T
    return [_best(i, choice, columns, score, schur, own_share * np.diag(outer)) for i, choice in enumerate(choices)]


def _best(
    index: int, candidate: Candidate, columns: Sequence[ScoredColumn], score: Array, schur: Array, least: Array
) -> tuple[float, dict[str, float]]:
    """Gain of one candidate from its best start, and the values that the scores lead to."""
    best = (0.0, dict(candidate.starts[0]))
    for s, start in enumerate(candidate.starts):
        places = [
            j
            for j, column in enumerate(columns)
            if (column.candidate, column.start) == (index, s) and np.isfinite(least[j]) and schur[j, j] > least[j]
        ]
        if not places:
            continue
        shares = inverse(schur[np.ix_(places, places)]) @ score[places]
        gain = float(shares @ score[places])
        values = dict(start)
        for share, j in zip(shares, places, strict=True):
            values[columns[j].name], possible = _moved(candidate, start, columns[j], float(share))
            gain = gain if possible else 0.0
        if gain > best[0]:
            best = (gain, values)
    return best


def _moved(candidate: Candidate, start: dict[str, float], column: ScoredColumn, share: float) -> tuple[float, bool]:
    """A parameter moved as its score predicts, within reason, and whether an effect of that sign is possible."""
    parameter = next(p for p in candidate.effect.parameters if p.name == column.name)
    if start[column.name] == 0.0 or parameter.low < 0.0:
        reach = _RANGE * max(abs(parameter.low), abs(parameter.high))
        low = 0.0 if parameter.low >= 0.0 else -reach
        return float(np.clip(share * column.moved, low, reach)), True
    if not candidate.is_size(column.name):
        # A limit, not a size: an effect that is too large by its score has its limit too near.
        return start[column.name], share > 0.0
    return float(np.clip(share, _LEAST, _MOST)) * start[column.name], share > 0.0
