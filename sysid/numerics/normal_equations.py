"""Gauss-Newton steps and covariances from normal equations, in scaled unknowns.

Information matrix and gradient of a record's sensitivities (part of it compiled).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit
from sysid.arrays import Array, IntArray
from sysid.errors import EstimationError

Mask = NDArray[np.bool_]

# A part of the weighted rows that stays in the processor's cache: a quarter of a megabyte of doubles.
_CACHED_NUMBERS = 1 << 15


def damped_step(information: Array, downhill: Array, damping: float, flight: str) -> Array:
    """Levenberg-Marquardt step from an information matrix and a gradient.

    Parameters
    ----------
    information : Array, shape (P, P)
        Information matrix, in one over the units of both unknowns.
    downhill : Array, shape (P,)
        Gradient, pointing to a lower cost, in one over the unknown's unit.
    damping : float
        Damping added to the diagonal in scaled unknowns, dimensionless; 0 gives the Gauss-Newton step.
    flight : str
        Name of the flight, for the message of an error.

    Returns
    -------
    Array, shape (P,)
        Step, in the unknowns' units.

    Raises
    ------
    EstimationError
        Where the information matrix or the gradient is no number, which it is where the simulation diverges next to the
        values tried: with such slopes there is no direction to go in. Also where the equations cannot be solved.
    """
    require_numbers(flight, information, downhill)
    scale = _scale(information)
    scaled = information * np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] += damping
    try:
        step: Array = np.linalg.lstsq(scaled, downhill * scale, rcond=1e-13)[0] * scale
    except np.linalg.LinAlgError:
        raise EstimationError(_no_step(flight)) from None
    return step


def hold(information: Array, downhill: Array, places: Mask, std: Array) -> None:
    """Take unknowns that go in steps out of normal equations, in place: they stay, known to `std`.

    Parameters
    ----------
    information : Array, shape (P, P)
        Information matrix, in one over the units of both unknowns; written over.
    downhill : Array, shape (P,)
        Gradient, in one over the unknown's unit; written over.
    places : Mask, shape (P,)
        True for the unknowns that are taken out.
    std : Array, shape (P,)
        Standard deviation to which each unknown is known, in its unit; used at `places` alone.
    """
    information[places, :] = information[:, places] = 0.0
    information[places, places] = 1.0 / std[places] ** 2
    downhill[places] = 0.0


def require_numbers(flight: str, *values: Array) -> None:
    """Raise EstimationError where anything in the normal equations of a flight is not finite.

    Parameters
    ----------
    flight : str
        Name of the flight, for the message of the error.
    *values : Array
        Information matrices, gradients or sensitivities, of any shape and unit.

    Raises
    ------
    EstimationError
        Where a value is not finite.
    """
    if not all(np.isfinite(one).all() for one in values):
        raise EstimationError(_no_step(flight))


def inverse(M: Array) -> Array:
    """Covariance that belongs to an information matrix, by its eigenvalues, in scaled unknowns.

    A direction without information gets a huge variance, never none: what is not known must not look certain. For a
    step or an elimination, where such a direction is to stay as it is, there is `solve`.

    Parameters
    ----------
    M : Array, shape (P, P)
        Information matrix, in one over the units of both unknowns.

    Returns
    -------
    Array, shape (P, P)
        Covariance, in the product of the units of both unknowns.
    """
    scale = _scale(M)
    values, vectors = np.linalg.eigh(M * np.outer(scale, scale))
    values = np.maximum(values, 1e-14)
    inverse: Array = (vectors / values) @ vectors.T * np.outer(scale, scale)
    return inverse


def solve(M: Array, right: Array) -> Array:
    """M^-1 right, in scaled unknowns; nothing along directions of which M says nothing.

    Parameters
    ----------
    M : Array, shape (P, P)
        Information matrix, in one over the units of both unknowns.
    right : Array, shape (P,) or (P, K)
        Right-hand sides, such as gradients, in one over the unknown's unit.

    Returns
    -------
    Array, shape (P,) or (P, K)
        Solution, shape of `right`, in the unknowns' units.
    """
    scale = _scale(M)
    rows = scale if right.ndim == 1 else scale[:, None]
    return np.asarray(np.linalg.lstsq(M * np.outer(scale, scale), right * rows, rcond=1e-13)[0] * rows)


def _scale(M: Array) -> Array:
    return np.asarray(1.0 / np.sqrt(np.maximum(np.diag(M), 1e-30)))


def _no_step(flight: str) -> str:
    return (
        f"{flight}: the motion simulated from these signals nearly diverges, so that no estimate can be improved:"
        " check units, signs and delays of the signals, or give a shorter part (--from, --to) or --method ee"
    )


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
    """Add the squares of residuals to `sums`, and how many are no NaN to `counts`.

    Parameters
    ----------
    residual : Array, shape (N, outputs)
        Residuals, each column in its output's unit; values that are not finite are left out.
    sums : Array, shape (outputs,)
        Sums of squares, in the square of each output's unit; result, written over.
    counts : IntArray, shape (outputs,)
        Numbers of residuals that count; result, written over.
    """
    for k in range(residual.shape[0]):
        for j in range(residual.shape[1]):
            value = residual[k, j]
            if np.isfinite(value):
                sums[j] += value * value
                counts[j] += 1


def gram(s: Array, residual: Array, columns: IntArray, sigma: Array) -> tuple[Array, Array]:
    """Information matrix S' R^-1 S and gradient S' R^-1 nu of one record; missing samples count for nothing.

    Parts of the record are weighted and multiplied one after the other, so that a part never leaves the processor's
    cache.

    Parameters
    ----------
    s : Array, shape (N, outputs, unknowns)
        Sensitivities S, in the output's unit over the unknown's.
    residual : Array, shape (N, outputs)
        Residuals nu, each column in its output's unit; NaN where a sample is missing.
    columns : IntArray, shape (C,)
        Indices of the outputs that count.
    sigma : Array, shape (outputs,)
        Standard deviation of each output's noise, in its unit; R holds its square.

    Returns
    -------
    M : Array, shape (unknowns, unknowns)
        Information matrix, in one over the units of both unknowns.
    g : Array, shape (unknowns,)
        Gradient, in one over the unknown's unit.
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
    """What further unknowns share with those of `gram`: S' R^-1 N.

    Parameters
    ----------
    s : Array, shape (samples, outputs, unknowns)
        Sensitivities S as `gram` has them, in the output's unit over the unknown's.
    more : Array, shape (samples, outputs, further unknowns)
        Sensitivities N to the further unknowns, in the same units, in memory in the order of these axes.
    residual : Array, shape (samples, outputs)
        Residuals as `gram` has them, each column in its output's unit; NaN marks samples that are missing.
    columns : IntArray, shape (C,)
        Indices of the outputs that count.
    sigma : Array, shape (outputs,)
        Standard deviation of each output's noise, in its unit.

    Returns
    -------
    Array, shape (unknowns, further unknowns)
        Shared block of the information matrix, in one over the units of both unknowns.
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
