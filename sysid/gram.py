"""Information matrix and gradient of a record's sensitivities (part of it compiled)."""

from __future__ import annotations

import numpy as np

from sim_vehicle.jit import jit
from sysid.flight import Array, IntArray

# A part of the weighted rows that stays in the processor's cache: a quarter of a megabyte of doubles.
_CACHED_NUMBERS = 1 << 15


@jit
def _weigh(
    s: Array, residual: Array, columns: IntArray, sigma: Array, first: int, last: int, rows: Array, target: Array
) -> int:
    """Put sensitivities and residuals of samples first ... last - 1 over their noise one below the other, missing
    samples left out; how many rows there are."""
    count = 0
    for k in range(first, last):
        for c in range(columns.size):
            j = columns[c]
            if np.isfinite(residual[k, j]):
                weight = 1.0 / sigma[j]
                for i in range(s.shape[2]):
                    rows[count, i] = weight * s[k, j, i]
                target[count] = weight * residual[k, j]
                count += 1
    return count


@jit
def add_squares(residual: Array, sums: Array, counts: IntArray) -> None:
    """Add the squares of residuals (N, outputs) to `sums` (outputs,), and how many are no NaN to `counts`."""
    for k in range(residual.shape[0]):
        for j in range(residual.shape[1]):
            value = residual[k, j]
            if np.isfinite(value):
                sums[j] += value * value
                counts[j] += 1


def gram(s: Array, residual: Array, columns: IntArray, sigma: Array) -> tuple[Array, Array]:
    """Information matrix S' R^-1 S and gradient S' R^-1 nu of one record; missing samples count for nothing.

    s: (N, outputs, unknowns), residual: (N, outputs), of which `columns` count. Parts of the record are weighted and
    multiplied one after the other, so that a part never leaves the processor's cache.
    """
    unknowns = s.shape[2]
    M, g = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    size = max(1, _CACHED_NUMBERS // max(columns.size * unknowns, 1))
    rows, target = np.empty((size * columns.size, unknowns)), np.empty(size * columns.size)
    for begin in range(0, s.shape[0], size):
        count = _weigh(s, residual, columns, sigma, begin, min(begin + size, s.shape[0]), rows, target)
        part = rows[:count]
        # Slopes that diverge are no numbers, and named where a step is asked for.
        with np.errstate(over="ignore", invalid="ignore"):
            M += part.T @ part
            g += target[:count] @ part
    return M, g


def crossed(s: Array, more: Array, residual: Array, columns: IntArray, sigma: Array) -> Array:
    """What further unknowns share with those of `gram`: S' R^-1 N, (unknowns, further unknowns).

    more: N, (samples, outputs, further unknowns), in memory in this order; the rest as `gram` has it.
    """
    n, count = s.shape[2], more.shape[2]
    across = np.zeros((n, count))
    size = max(1, _CACHED_NUMBERS // max(columns.size * (n + count), 1))
    rows, others = np.empty((size * columns.size, n)), np.empty((size * columns.size, count))
    target = np.empty(size * columns.size)
    for begin in range(0, s.shape[0], size):
        end = min(begin + size, s.shape[0])
        _weigh(s, residual, columns, sigma, begin, end, rows, target)
        used = _weigh(more, residual, columns, sigma, begin, end, others, target)
        with np.errstate(over="ignore", invalid="ignore"):
            across += rows[:used].T @ others[:used]
    return across


@jit
def single_pulls(s: Array, residual: Array, columns: IntArray, sigma: Array, alone: Array, across: Array) -> None:
    """Add to `across` (outputs, kinds, unknowns) what S' R^-1 d is for further unknowns that act on one output each.

    alone: (samples, outputs, kinds) slopes d of the output by each of its further unknowns.
    """
    for k in range(s.shape[0]):
        for c in range(columns.size):
            j = columns[c]
            if not np.isfinite(residual[k, j]):
                continue
            weight = 1.0 / (sigma[j] * sigma[j])
            for kind in range(alone.shape[2]):
                weighted = weight * alone[k, j, kind]
                if weighted != 0.0:
                    for i in range(s.shape[2]):
                        across[j, kind, i] += weighted * s[k, j, i]


@jit
def single_gram(residual: Array, columns: IntArray, sigma: Array, alone: Array, own: Array, pulled: Array) -> None:
    """Add to `own` and `pulled` (outputs, kinds) what d' R^-1 d and d' R^-1 nu are of `single_pulls`."""
    for k in range(residual.shape[0]):
        for c in range(columns.size):
            j = columns[c]
            if np.isfinite(residual[k, j]):
                for kind in range(alone.shape[2]):
                    weighted = alone[k, j, kind] / (sigma[j] * sigma[j])
                    own[j, kind] += weighted * alone[k, j, kind]
                    pulled[j, kind] += weighted * residual[k, j]
