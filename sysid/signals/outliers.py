"""Single readings that no motion makes: a bit error, a converter's glitch, a number far off all others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sysid.arrays import Array

# Neighbours on both sides that a reading is compared with: a step or a pulse of more samples than these passes.
_REACH = 2
# A reading is an outlier if it is this many robust deviations off its neighbours' median, ...
SIGMAS = 20.0
# ... and by this share of the range that the signal otherwise covers, so that a quiet flight's one pulse is none.
SHARE = 0.5
# Where readings come so seldom, s, that two of them are as long as an aircraft's answer to a doublet, none is one up to
# what a small aircraft does: rad/s, m/s^2, rad.
SELDOM_S = 0.03
MOST = {
    **dict.fromkeys(("p", "q", "r"), 12.0),
    **dict.fromkeys(("ax", "ay", "az"), 150.0),
    **dict.fromkeys(("alpha", "beta"), 1.0),
    **dict.fromkeys(("phi", "theta"), 3.2),
}
# Standard deviation of a Gaussian over its median absolute deviation.
MAD_TO_SIGMA = 1.4826


def outliers(values: Array, least: float = 0.0) -> NDArray[np.bool_]:
    """(N,) which readings are outliers. values: (N,) finite, in order of time; of angles, unwrapped. least: size up to
    which none is.

    Where more than 1 % of the readings deviate so they are no accidents, and none counts as an outlier. Median filter
    after F. R. Hampel, "The influence curve and its role in robust estimation", JASA 69, 1974.
    """
    none = np.zeros(values.size, dtype=np.bool_)
    if values.size < 50:
        return none
    off = np.abs(values - ndimage.median_filter(values, size=2 * _REACH + 1, mode="mirror"))
    low, high = np.percentile(values, (5.0, 95.0))
    limit = max(SIGMAS * MAD_TO_SIGMA * float(np.median(off)), SHARE * float(high - low), 0.0)
    found = _alone(values, np.asarray(off > limit), limit) & (np.abs(values) > least)
    return found if found.any() and found.mean() <= 0.01 else none


def _alone(values: Array, far: NDArray[np.bool_], limit: float) -> NDArray[np.bool_]:
    """(N,) which of the readings `far` off differ by `limit` from the next good ones before and after, and from all.

    A motion that breaks off, as lift does in a stall, jumps to what it has been before, and mostly comes back over
    several samples.
    """
    good = np.flatnonzero(~far)
    if good.size == 0:
        return np.zeros_like(far)
    places = np.flatnonzero(far)
    after = np.searchsorted(good, places)
    # At an end of the signal there is one neighbour only.
    left = values[good[np.maximum(after - 1, 0)]]
    right = values[good[np.minimum(after, good.size - 1)]]
    apart = np.minimum(np.abs(values[places] - left), np.abs(values[places] - right)) > limit
    apart &= (values[places] > values[good].max() + limit) | (values[places] < values[good].min() - limit)
    found = np.zeros_like(far)
    found[places[apart]] = True
    return found
