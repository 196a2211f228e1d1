"""Surfaces that a log holds in whole steps, as pulses in whole microseconds, as what they are expected to have been.

What drives a simulation is an input without noise to every method. Rounding is noise of it: it moves the simulated
aircraft where the real one did nothing, and a servo's lag, estimated beside, is a filter that keeps it out. A lag of
46 ms where there is none, and moments 10 % too large, were seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from sim_vehicle.vehicle.controls import Control
from sysid.arrays import Array

# Times that noise is filtered out and the result held within what was rounded.
_ROUNDS = 8
# Width of the bands, Hz, in which the rounding's power is held against the signal's.
_BAND_HZ = 0.8
# Fewer levels than this may be a stick's own positions, and no rounding; by so much of a step levels may miss its
# multiples, and so many of the multiples between the ends there must be.
_FEWEST_LEVELS, _OFF_A_MULTIPLE, _DENSE = 16, 0.02, 0.5
# Largest share of the samples that may be levels of their own: where nothing is rounded, hardly two are alike.
_MOST_LEVELS = 0.9
# Of single samples that were lost a line takes the place; more than this is a burst, s.
_BURST_S = 0.2
# Decimals to which levels are distinguished.
_DECIMALS = 9


@dataclass(frozen=True)
class Rounding:
    """What rounding does to samples of a surface: std and the most, rad; both 0 where none shows."""

    std: float
    most: float


_NONE = Rounding(0.0, 0.0)


def rounding_of(values: Array, control: Control | None) -> Rounding:
    """What rounding did to samples of a surface.

    Parameters
    ----------
    values : Array, shape (N,)
        Positions or commands as logged, rad.
    control : Control or None
        The surface in the vehicle file: each of its servos' pulses is rounded to a microsecond at most.

    Returns
    -------
    Rounding
        Standard deviation and largest size, rad.
    """
    levels = np.unique(np.round(values, _DECIMALS))
    if not 2 <= levels.size <= _MOST_LEVELS * values.size:
        return _NONE
    steps = np.diff(levels)
    step = float(np.median(steps))
    each = () if control is None else control.microseconds
    if len(each) == 1:
        return _of_steps(min(step, *each))
    if each:  # each servo's pulse by itself, added
        return _of_steps(*each)
    # Nobody says what a step is: positions of a stick lie as they will, what was rounded on every multiple of one step.
    times = steps / step
    regular = np.abs(times - np.round(times)) < _OFF_A_MULTIPLE
    dense = levels.size > _DENSE * (levels[-1] - levels[0]) / step
    return _of_steps(step) if levels.size >= _FEWEST_LEVELS and regular.all() and dense else _NONE


def _of_steps(*steps: float) -> Rounding:
    return Rounding(float(np.sqrt(np.sum(np.square(steps)) / 12.0)), 0.5 * sum(steps))


def unrounded(time_s: Array, values: Array, control: Control | None) -> Array:
    """What rounded samples are expected to have been: Wiener's filter, held within what rounding does, in turn.

    Parameters
    ----------
    time_s : Array, shape (N,)
        Stamps, s.
    values : Array, shape (N,)
        Positions or commands as logged, rad.
    control : Control or None
        The surface in the vehicle file, where it stands there.

    Returns
    -------
    Array, shape (N,)
        Values as far from those given as rounding may have put them, rad.

    Notes
    -----
    Rounding of a signal that passes many steps is white, with a variance of a twelfth of the step squared (Widrow,
    Kollar & Liu, IEEE Trans. Instrum. Meas. 45, 1996).
    """
    rounding = rounding_of(values, control)
    if rounding is _NONE or values.size < _FEWEST_LEVELS:
        return values
    steps = np.diff(time_s)
    interval_s = float(np.median(steps))
    # Put end to end, what lies before and behind a burst of lost samples jumps, and the spectrum of a jump hides that
    # of the rounding.
    breaks = np.flatnonzero(steps > _BURST_S + interval_s) + 1
    parts = zip(np.split(time_s, breaks), np.split(values, breaks), strict=True)
    return np.concatenate([_smooth(*one, interval_s, rounding) for one in parts])


def _smooth(time_s: Array, values: Array, interval_s: float, rounding: Rounding) -> Array:
    """Samples (N,) without a burst of lost ones between them; lines where single ones are lost."""
    if values.size < _FEWEST_LEVELS:
        return values
    slots = np.maximum(np.round(np.diff(time_s) / interval_s), 1.0)
    place = np.concatenate(([0.0], np.cumsum(slots)))
    every = np.arange(place[-1] + 1.0)
    width = max(round(_BAND_HZ * interval_s * every.size), 1)
    found, least, most = values, values - rounding.most, values + rounding.most
    for _ in range(_ROUNDS):
        whole = _without_white_noise(np.interp(every, place, found), rounding.std, width)
        found = np.clip(whole[place.astype(np.int64)], least, most)
    return found


def _without_white_noise(values: Array, std: float, width: int) -> Array:
    """Wiener's filter of a series (N,) that white noise of `std` is in, by its spectrum over bands of `width` lines."""
    middle, size = float(values.mean()), values.size
    # Followed by itself backwards: no jump where its end meets its beginning.
    Z = np.fft.rfft(np.concatenate((values, values[::-1])) - middle)
    power = uniform_filter1d(np.abs(Z) ** 2, width, mode="nearest")
    gain = np.clip(1.0 - 2.0 * size * std * std / np.maximum(power, 1e-300), 0.0, 1.0)
    return np.asarray(middle + np.fft.irfft(Z * gain, 2 * size)[:size])
