"""Which way a sensor with free play was moving, from its reading alone."""

from __future__ import annotations

import numpy as np

from sysid.flight import Array
from sysid.smoothing import fourier_smooth, noise_sigma

# Loads turn in this band. A reading has moved when it has gone further than the noise does, in standard deviations.
_BAND_HZ = 4.0
_MOVED = 4.0
_FEWEST = 16  # samples that can be smoothed
_SURE = 0.9


def way_of(reading: Array, interval_s: float) -> Array:
    """(N,) 1 where the reading rises, -1 where it falls, and on a straight line between where it stands.

    The way in which it came, seen forwards in time, holds until the reading has left a turn; that in which it goes on,
    seen backwards, holds from where it came into the turn. Where both agree it moves.
    """
    if reading.size < _FEWEST or np.ptp(reading) == 0.0:
        return np.zeros(reading.size)
    smooth = fourier_smooth(reading, interval_s, _BAND_HZ).values
    noise = noise_sigma(reading, interval_s) * float(np.sqrt(min(2.0 * _BAND_HZ * interval_s, 1.0)))
    moved = max(_MOVED * noise, 1e-3 * float(np.ptp(smooth)))
    way = 0.5 * (_way_come(smooth, moved) - _way_come(smooth[::-1], moved)[::-1])
    sure = np.abs(way) > _SURE
    places = np.arange(way.size)
    return np.interp(places, places[sure], way[sure]) if sure.any() else np.zeros(way.size)


def _way_come(values: Array, moved: float) -> Array:
    """(N,) which way values have come, -1 to 1: how far they are ahead of a play of full width `moved` behind them."""
    behind = []
    follower, half = float(values[0]), 0.5 * moved
    for low, high in zip((values - half).tolist(), (values + half).tolist(), strict=True):
        if follower < low:
            follower = low
        elif follower > high:
            follower = high
        behind.append(follower)
    return np.asarray((values - np.array(behind)) / half, dtype=np.float64)
