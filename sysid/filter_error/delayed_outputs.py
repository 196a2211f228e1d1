"""Delayed sensors, as the filter reads them.

A delay is so many whole samples, by which the measurement is read ahead, and a part of one, by which the prediction is
read on the way from the sample before (`sysid.filter_error.prediction.predict_path`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.effects import slot
from sim_vehicle.effects.sensor_time_skew import is_late
from sim_vehicle.physics.simulation import split_delay_ticks
from sysid.arrays import Array, IntArray
from sysid.numerics.fractional_delay import read_later
from sysid.signals.record import OUTPUT_PLACES, Record, angle_wrap

BoolArray = NDArray[np.bool_]

_SKEW, _GROUP = slot("sensor_time_skew"), slot("sensor_time_skew", "group")


def _is_late(effects: Array) -> BoolArray:
    """(15,) which outputs are delayed."""
    group = float(effects[_GROUP])
    return np.array([effects[_SKEW] != 0.0 and is_late(int(place), group) for place in OUTPUT_PLACES])


def select_delayed(y: Array, shown: Array, effects: Array) -> Array:
    """(N, 15) what is read, of sensors that are delayed by a part of a sample what was there so much before."""
    return np.where(_is_late(effects), shown, y) if shown.size else y


def delay_prediction(y: Array, effects: Array, whole: int) -> Array:
    """(N, 15) what is read, of a late group's sensors `whole` samples later; what was there at first until then."""
    past = np.concatenate((np.repeat(y[:1], whole, axis=0), y))[: y.shape[0]]
    return np.where(_is_late(effects), past, y)


def delay_measurements(record: Record, effects: Array, whole: int) -> Array:
    """(N, 15) what readings of a group that are delayed by `whole` samples would be more if they came in time.

    The filter knows the motion by its sensors: delayed ones are read ahead, so that its state is never theirs.
    """
    if whole == 0:
        return np.zeros(record.z.shape)
    more = read_later(record.z, whole * record.interval_s, record.interval_s) - record.z
    return np.asarray(angle_wrap(np.where(_is_late(effects) & np.isfinite(more), more, 0.0)))


def beyond_end(record: Record, effects: Array) -> BoolArray:
    """(N, 15) whether a reading, of those that there are, comes so late that what should be read is past the end."""
    whole, _ = split_delay_ticks(effects, record.interval_s)
    late = (np.arange(record.length) >= record.length - whole)[:, None] & _is_late(effects)
    return np.asarray(late & np.isfinite(record.z))


def missing_likelihood(innovations: Array, variances: Array, unread: IntArray) -> float:
    """Log likelihood of readings that come after a record's end, as much as the others' mean.

    Else a delay would gain or lose by how many readings there are. innovations, variances: (N, m), NaN where nothing is
    read; unread: (m,) how many readings of each output come too late. Of an output without any other nothing is known.
    """
    counted = (unread > 0) & np.isfinite(innovations).any(axis=0)
    if not counted.any():
        return 0.0
    each = -0.5 * (innovations[:, counted] ** 2 / variances[:, counted] + np.log(variances[:, counted]))
    return float(np.nanmean(np.where(np.isfinite(innovations[:, counted]), each, np.nan), axis=0) @ unread[counted])
