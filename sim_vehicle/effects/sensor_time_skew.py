"""Sensors of one group that show the motion with a delay: z(t) = y(t - delay).

Groups: the vanes; air data (airspeed); the inertial unit (ax ay az p q r); the attitude (phi theta psi). A delay is so
many whole ticks and a part of one; what was there at that moment within a tick is flown to (`simulation.glimpse`), not
interpolated: with surfaces that move within a tick a cubic through samples is off by ten times a gyro's noise. Before
the first sample the motion is a straight line.
"""

import math

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.effects.base import Effect, Parameter, Remembers, Stage
from sim_vehicle.jit import jit, jit_arrays

Array = NDArray[np.float64]

GROUPS = ("vanes", "air_data", "imu", "attitude")
SENSOR_TIME_SKEW = Effect(
    "sensor_time_skew",
    "delayed sensors",
    Stage.SENSOR,
    (
        Parameter("delay", "s", 0.0, 0.3, starts=(0.01, 0.03, 0.05, 0.09, 0.15)),
        Parameter("group", "1", 0.0, len(GROUPS) - 1.0, fitted=False, choices=GROUPS),
    ),
    "hardware that stamps all sensors on one clock; a tap on the airframe",
    memory=Remembers.LATENESS,
    phrase="a group of sensors is delayed by {delay:ms}",
)
# Places among CHANNELS and READINGS: airspeed, alpha beta, p q r, phi theta psi, ax ay az.
_FIRST_OF_GROUP = ((1, 3), (0, 1), (3, 6), (6, 9))
_ACCELEROMETERS = (9, 12)
_ROUNDING = 1e-9  # ticks


@jit
def is_late(channel: int, group: float) -> bool:
    """Whether a channel (its place among CHANNELS) belongs to a group (its place among GROUPS)."""
    place = int(group)
    first, end = _FIRST_OF_GROUP[place]
    if first <= channel < end:
        return True
    return place == 2 and _ACCELEROMETERS[0] <= channel < _ACCELEROMETERS[1]


@jit
def split_delay(late: float) -> tuple[int, float]:
    """Whole ticks of a delay of `late` ticks, and the part of one beside them; a part within rounding is none."""
    whole = math.floor(late + _ROUNDING)
    part = late - whole
    return whole, part if part > _ROUNDING else 0.0


@jit
def late_nodes(last: int, count: int, late: float) -> tuple[int, float, float, float, float]:
    """First of up to four rows of `count` and their weights, for the reading `late` samples before row `last`."""
    place = last - late
    if place <= 0.0 or last < 3:
        row = max(min(math.floor(place), min(max(last, 1), count - 1) - 1), 0)
        share = place - row if count > 1 else 0.0
        return row, 1.0 - share, share, 0.0, 0.0
    row = min(max(math.floor(place) - 1, 0), last - 3)
    s = place - row
    return (
        row,
        -(s - 1.0) * (s - 2.0) * (s - 3.0) / 6.0,
        s * (s - 2.0) * (s - 3.0) / 2.0,
        -s * (s - 1.0) * (s - 3.0) / 2.0,
        s * (s - 1.0) * (s - 2.0) / 6.0,
    )


@jit
def late_reading(values: Array, last: int, late: float, turns: bool) -> float:
    """What (N,) readings show that come `late` samples late, at row `last`; an angle that turns stays within +-pi."""
    row, a, b, c, d = late_nodes(last, values.size, late)
    origin: float = values[row]
    total = 0.0
    for offset, weight in ((0, a), (1, b), (2, c), (3, d)):
        if weight != 0.0:
            apart = values[row + offset] - origin
            if turns:
                apart -= 2.0 * math.pi * math.floor(apart / (2.0 * math.pi) + 0.5)
            total += weight * apart
    total += origin
    if turns:
        total -= 2.0 * math.pi * math.floor(total / (2.0 * math.pi) + 0.5)
    return total


@jit_arrays
def delay_channels(y: Array, shown: Array, group: float, late: float) -> None:
    """Let the channels of a group of sensors come `late` samples late, in place.

    Parameters
    ----------
    y : Array, shape (N, CHANNELS)
        Readings, SI units and rad; changed in place.
    shown : Array, shape (N, CHANNELS)
        Readings the part of a sample before each, for the samples after the first one; units as `y`.
    group : float
        Place of the group among GROUPS.
    late : float
        Delay in samples, with its part of one.
    """
    whole, _ = split_delay(late)
    for channel in range(12):
        if is_late(channel, group):
            values = y[:, channel].copy()
            for k in range(y.shape[0]):
                if k - whole >= 1:
                    y[k, channel] = shown[k - whole, channel]
                else:
                    y[k, channel] = late_reading(values, k, late, channel == 6 or channel == 8)


@jit_arrays
def delay_rows(values: Array, late: float) -> Array:
    """Derivatives of readings, as those of readings delayed by `late` samples.

    Parameters
    ----------
    values : Array, shape (N, K)
        Derivatives of a reading by K unknowns at N samples, unit of the reading per unit of the unknown.
    late : float
        Delay in samples, with its part of one.

    Returns
    -------
    Array, shape (N, K)
        Derivatives of the delayed reading, units as `values`.
    """
    delayed = np.zeros(values.shape)
    for k in range(values.shape[0]):
        row, a, b, c, d = late_nodes(k, values.shape[0], late)
        for offset, weight in ((0, a), (1, b), (2, c), (3, d)):
            if weight != 0.0:
                delayed[k] += weight * values[row + offset]
    return delayed
