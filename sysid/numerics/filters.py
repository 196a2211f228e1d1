"""Convolutions and lags, without the import of a whole signal-processing library, which takes most of a second."""

from __future__ import annotations

import numpy as np
from scipy import fft
from scipy.linalg import blas

from sysid.arrays import Array


def correlation(values: Array, lags: int) -> Array:
    """Sums of products of values with themselves `0 ... lags - 1` samples later, zeros beyond the ends.

    Parameters
    ----------
    values : Array, shape (N,)
        Samples in any unit.
    lags : int
        Number of lags.

    Returns
    -------
    Array, shape (lags,)
        Sums, in the square of the unit of `values`.
    """
    size = fft.next_fast_len(values.size + lags, real=True)
    sums = fft.irfft(np.abs(fft.rfft(values, size)) ** 2, size)[:lags]
    return np.asarray(sums, dtype=np.float64)


def convolved(rows: Array, kernel: Array) -> Array:
    """Each column of `rows` convolved with `kernel` about its middle, zeros beyond the ends.

    Parameters
    ----------
    rows : Array, shape (N, K)
        Series to convolve, each column in its own unit.
    kernel : Array, shape (2 L + 1,)
        Kernel, one weight per sample from -L to L, in any unit.

    Returns
    -------
    Array, shape (N, K)
        Convolved columns, each in its own unit times that of `kernel`.
    """
    size = fft.next_fast_len(rows.shape[0] + kernel.size - 1, real=True)
    product = fft.rfft(rows, size, axis=0) * fft.rfft(kernel, size)[:, None]
    middle = kernel.size // 2
    wide = fft.irfft(product, size, axis=0)[middle : middle + rows.shape[0]]
    return np.asarray(wide, dtype=np.float64)


def first_order_lag(values: Array, kept: float, start: float) -> Array:
    """First-order lag y[k] = kept y[k - 1] + (1 - kept) values[k], with y = start before the first.

    The recursion is a triangular system of two bands, which a compiled solver goes through once.

    Parameters
    ----------
    values : Array, shape (N,)
        Input in any unit.
    kept : float
        Share of the previous output that stays from one sample to the next, dimensionless.
    start : float
        Output before the first sample, in the unit of `values`.

    Returns
    -------
    Array, shape (N,)
        Output y, in the unit of `values`.
    """
    driven = (1.0 - kept) * values
    driven[0] += kept * start
    bands = np.empty((2, values.size), order="F")
    bands[0], bands[1] = 1.0, -kept
    return np.asarray(blas.dtbsv(1, bands, driven, lower=1, diag=1, overwrite_x=True), dtype=np.float64)
