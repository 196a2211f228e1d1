"""Signals on their own stamps -> one uniform time base, without a phase shift between any two of them.

Timing is the largest single error source of the whole chain: 10 ms between the elevator and the rates moves
Cm_alpha by several percent. So samples that already sit on the grid are taken as they are (their noise stays white),
all others are interpolated on their own stamps, and a held command is held, not interpolated.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from sim_vehicle.vehicle.controls import Control
from sysid.arrays import Array
from sysid.errors import SignalError
from sysid.signals.flight import FlightData, FlightSignals, Signal
from sysid.signals.outliers import MOST, SELDOM_S, outliers
from sysid.signals.rounding import unrounded

IMU = ("ax", "ay", "az", "p", "q", "r")
ANGLES = ("phi", "theta", "psi")
# A satellite receiver's samples are outputs to compare with, never regressors, and a battery's are read before
# (sysid.signals.thrust.electric): between them there is nothing.
SPARSE = ("lat", "lon", "vn", "ve", "vd", "battery_voltage", "battery_current", "battery_power")
HELD = ("de", "da", "dr", "throttle")
GAP_S = 0.1  # s without a sample that are a gap
# No quantity of a flight is larger in SI units, no stamp later; what is, is a broken message.
LARGEST = 1e9
# Longest flight put on a grid, s: two days; how much longer than its samples fill it may be where it is longer than so
# much, s: beyond that it is the clock that jumped, or a vehicle that was switched off for hours.
_LONGEST_S = 2e5
_MOSTLY_EMPTY, _EMPTY_FROM_S = 20.0, 4000.0
# Share of the interval by which a stamp may miss its grid point and still be that grid point's sample (jitter), and
# by which all stamps together may (offset): an offset is a timing error, jitter averages out.
JITTER = 0.1
OFFSET = 0.02


def is_held(name: str, named: Collection[str] = ()) -> bool:
    """Whether the signal is a command that stays as sent until the next one (zero-order hold).

    named: controls of other names than de, da, dr and throttle.
    """
    return name in HELD or name in named or name.startswith("servo")


def resample(
    signals: FlightSignals,
    interval_s: float = 0.02,
    names: Sequence[str] | None = None,
    moving: Mapping[str, Control | None] = MappingProxyType({}),
    named: Collection[str] = (),
) -> FlightData:
    """Put the signals of a flight on one uniform time base.

    The base is the fastest IMU signal's: its own stamps where these are uniform within 10 % of the interval
    (the interval of the result is then the source's own, which may differ from the one asked for by 2 %), else a
    uniform grid of `interval_s`, or of the source's mean interval where that is longer.

    signals: signals on their own stamps, s.
    interval_s: step asked for, s.
    names: signals to take; None takes all. moving: those of the commands that are measured positions, not held,
    with the control of the vehicle file. named: controls of other names than de, da, dr and throttle, held as these.
    Returns columns of (N,) values, NaN in gaps longer than 0.1 s (or 2.5 intervals of a slower source). Angles are
    unwrapped, commands held, sources at least twice as fast low-pass filtered without phase, GPS left at its
    own samples with NaN between.
    Raises SignalError for constant stamps, no IMU signal, or a name the flight does not have.
    """
    if not interval_s > 0.0:
        raise SignalError(f"{signals.name}: the interval must be above 0 s, not {interval_s}")
    wanted = tuple(signals.signals) if names is None else tuple(names)
    signals.require(*wanted)
    warnings: list[str] = list(signals.warnings)
    clean = {name: _clean(signals.name, name, signals.signals[name], warnings, named) for name in wanted}
    imu = [name for name in IMU if name in clean] or [name for name in IMU if name in signals.signals]
    if not imu:
        raise SignalError(f"{signals.name}: no IMU signal ({' '.join(IMU)}) to take the time base from")
    base_name = _base(signals, imu)
    base = clean.get(base_name)
    if base is None:
        base = _clean(signals.name, base_name, signals.signals[base_name], warnings, named)
    grid, interval = _grid(signals.name, base_name, base, interval_s, warnings)
    for name, control in moving.items():
        if name in clean:
            one = clean[name]
            clean[name] = replace(one, values=unrounded(one.time_s, one.values, control))
    columns = {
        name: _on_grid(name, clean[name], grid, interval, is_held(name, named) and name not in moving)
        for name in wanted
    }
    missing: dict[int, list[str]] = {}
    for name, values in columns.items():
        lost = int(np.count_nonzero(np.isnan(values)))
        if lost and name not in SPARSE:
            missing.setdefault(lost, []).append(name)
    warnings += [
        f"{', '.join(names_lost)}: {lost * interval:.2f} s of {grid.size * interval:.1f} s without samples"
        for lost, names_lost in missing.items()
    ]
    return FlightData(signals.name, interval, grid, columns, tuple(dict.fromkeys(warnings)))


def _base(signals: FlightSignals, imu: Sequence[str]) -> str:
    """The fastest IMU signal; of several alike the one whose stamps most signals share, which need no interpolation."""
    fastest = max(signals.signals[name].rate_hz for name in imu)
    alike = [name for name in imu if signals.signals[name].rate_hz > 0.99 * fastest]

    def shared(name: str) -> int:
        time = signals.signals[name].time_s
        return sum(np.array_equal(other.time_s, time, equal_nan=True) for other in signals.signals.values())

    return max(alike or list(imu), key=shared)


def _clean(flight: str, name: str, source: Signal, warnings: list[str], named: Collection[str]) -> Signal:
    """Finite samples with strictly increasing stamps."""
    finite = np.isfinite(source.time_s) & np.isfinite(source.values)
    absurd = finite & ((np.abs(source.values) > LARGEST) | (np.abs(source.time_s) > LARGEST))
    if absurd.any():
        warnings.append(f"{name}: {int(absurd.sum())} reading(s) beyond {LARGEST:g} left out")
        finite &= ~absurd
    time = np.ascontiguousarray(source.time_s[finite], dtype=np.float64)
    values = np.ascontiguousarray(source.values[finite], dtype=np.float64)
    if time.size < 2:
        raise SignalError(f"{flight}: {name} ({source.source}) has {time.size} finite samples, two are the least")
    if np.ptp(time) <= 0.0:
        raise SignalError(f"{flight}: every stamp of {name} ({source.source}) is {time[0]:.6g} s; it has no clock")
    highest = np.concatenate([[-np.inf], np.maximum.accumulate(time)[:-1]])
    forward = time > highest
    dropped = int(time.size - np.count_nonzero(forward))
    if dropped:
        warnings.append(f"{name}: {dropped} samples with a repeated or backward stamp left out")
        time, values = time[forward], values[forward]
        if time.size < 2:
            raise SignalError(f"{flight}: the stamps of {name} ({source.source}) go backward; check its clock")
    if name in ANGLES:
        values = np.unwrap(values)
    if not is_held(name, named):
        seldom = float(np.median(np.diff(time))) > SELDOM_S
        bad = outliers(values, MOST.get(name, 0.0) if seldom else 0.0)
        if bad.any():
            warnings.append(f"{name}: {int(bad.sum())} reading(s) far off their neighbours left out")
            time, values = time[~bad], values[~bad]
    return Signal(time, values, source.unit, source.source)


def _grid(flight: str, name: str, base: Signal, interval_s: float, warnings: list[str]) -> tuple[Array, float]:
    steps = np.diff(base.time_s)
    typical = float(np.median(steps))
    span, filled = float(base.time_s[-1] - base.time_s[0]), base.time_s.size * typical
    if span > _LONGEST_S:
        raise SignalError(
            f"{flight}: the stamps of {name} span {span:.3g} s, more than a flight lasts; cut the recording, or check"
            " its clock"
        )
    if span > max(_MOSTLY_EMPTY * filled, _EMPTY_FROM_S):
        raise SignalError(
            f"{flight}: the stamps of {name} span {span:.0f} s, and its samples fill {filled:.0f} s of them: a clock"
            " jumped, or the vehicle was switched off meanwhile; take a part of the flight (--from, --to)"
        )
    if typical > 1.5 * interval_s:
        warnings.append(f"{name} comes at {1.0 / typical:.1f} Hz, slower than {1.0 / interval_s:.0f} Hz asked for")
        usual = steps[(steps > 0.5 * typical) & (steps < 1.5 * typical)]
        interval_s = float(np.mean(usual)) if usual.size else typical
    # The source's own clock against ours: the slope of the stamps over their whole-number index.
    for interval in (interval_s, _own_interval(base.time_s, typical)):
        if abs(interval - interval_s) > 0.02 * interval_s:
            continue
        index = np.rint((base.time_s - base.time_s[0]) / interval)
        offset = float(np.median(base.time_s - index * interval))
        miss = np.abs(base.time_s - offset - index * interval)
        if np.quantile(miss, 0.99) <= JITTER * interval and np.all(np.diff(index) > 0):
            return offset + interval * np.arange(int(index[-1]) + 1, dtype=np.float64), interval
    count = int(np.floor((base.time_s[-1] - base.time_s[0]) / interval_s * (1.0 + 1e-12))) + 1
    if count < 2:
        raise SignalError(f"{flight}: {name} lasts less than two intervals of {interval_s} s")
    return base.time_s[0] + interval_s * np.arange(count, dtype=np.float64), interval_s


def _own_interval(time: Array, typical: float) -> float:
    index = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(np.diff(time) / typical), 1.0))])
    return float(np.polyfit(index, time, 1)[0]) if time.size > 2 else typical


def _on_grid(name: str, source: Signal, grid: Array, interval: float, held: bool) -> Array:
    if held:
        return _hold(source, grid, interval)
    typical = float(np.median(np.diff(source.time_s)))
    if name in SPARSE and typical > 1.5 * interval:
        return _nearest_only(source, grid, interval)
    if typical < 0.6 * interval:
        source = _low_pass(source, typical, interval)
    elif (nearest := _already_there(source, grid, interval)) is not None:
        return nearest
    values = np.interp(grid, source.time_s, source.values)
    return _blank_gaps(values, source.time_s, grid, max(GAP_S, 2.5 * typical), interval)


def _is_jitter(miss: Array, interval: float) -> bool:
    """Whether stamps miss their grid points by jitter alone; miss: (N,) s."""
    return bool(np.quantile(np.abs(miss), 0.99) <= JITTER * interval and abs(np.median(miss)) <= OFFSET * interval)


def _already_there(source: Signal, grid: Array, interval: float) -> Array | None:
    """The samples themselves where each sits on a grid point; None where they have to be interpolated."""
    index = np.rint((source.time_s - grid[0]) / interval).astype(np.int64)
    inside = (index >= 0) & (index < grid.size)
    if np.count_nonzero(inside) < 2:
        return None
    index, time, values = index[inside], source.time_s[inside], source.values[inside]
    miss = time - grid[index]
    if not _is_jitter(miss, interval) or np.any(np.diff(index) <= 0):
        return None
    # A few lost messages are bridged by a line; the gap rule blanks the long ones.
    bridged = np.interp(grid, time, values)
    bridged[index] = values
    return _blank_gaps(bridged, grid[index], grid, GAP_S, interval)


def _blank_gaps(values: Array, time: Array, grid: Array, gap_s: float, interval: float) -> Array:
    """NaN at grid points inside a gap of the stamps, and more than one interval outside the signal."""
    after = np.searchsorted(time, grid, side="left").clip(0, time.size - 1)
    before = np.searchsorted(time, grid, side="right").clip(1, time.size) - 1
    outside = (grid < time[0] - interval) | (grid > time[-1] + interval)
    gap = (time[after] - time[before] > gap_s) & (grid > time[before]) & (grid < time[after])
    return np.where(outside | gap, np.nan, values)


def _hold(source: Signal, grid: Array, interval: float) -> Array:
    """What a held command is from each grid point to the next: its mean there where it changes in between.

    Stamps that miss the grid points by jitter alone belong to them.
    """
    miss = source.time_s - grid[0] - interval * np.rint((source.time_s - grid[0]) / interval)
    index = np.searchsorted(source.time_s, grid + JITTER * interval, side="right") - 1
    first = index.clip(0)
    typical = float(np.median(np.diff(source.time_s)))
    age = grid - source.time_s[first]
    stale = (age > max(GAP_S, 2.5 * typical)) | ((index < 0) & (age < -interval))
    values = source.values[first] if _is_jitter(miss, interval) else _held_means(source, grid, interval)
    return np.where(stale, np.nan, values)


def _held_means(source: Signal, grid: Array, interval: float) -> Array:
    """(N,) means of a held command over the interval after each grid point; its first value before its first stamp."""
    passed = np.concatenate(([0.0], np.cumsum(source.values[:-1] * np.diff(source.time_s))))

    def until(time: Array) -> Array:
        last = np.searchsorted(source.time_s, time, side="right").clip(1) - 1
        return np.asarray(passed[last] + source.values[last] * (time - source.time_s[last]))

    return (until(grid + interval) - until(grid)) / interval


def _nearest_only(source: Signal, grid: Array, interval: float) -> Array:
    values = np.full(grid.size, np.nan)
    index = np.rint((source.time_s - grid[0]) / interval).astype(np.int64)
    inside = (index >= 0) & (index < grid.size)
    values[index[inside]] = source.values[inside]
    return values


def _low_pass(source: Signal, typical: float, interval: float) -> Signal:
    """Zero-phase FIR below the grid's Nyquist frequency, on a uniform grid of the source's own interval."""
    count = int(np.floor((source.time_s[-1] - source.time_s[0]) / typical)) + 1
    time = source.time_s[0] + typical * np.arange(count, dtype=np.float64)
    values = np.interp(time, source.time_s, source.values)
    half = int(np.ceil(4.0 * interval / typical))
    if count <= 2 * half + 1:
        return Signal(time, values, source.unit, source.source)
    from scipy import signal as scipy_signal  # slow to import, and seldom wanted

    taps = scipy_signal.firwin(2 * half + 1, 0.8 * typical / interval, window="hamming")
    # Odd reflection about the end points keeps value and slope there.
    head = 2.0 * values[0] - values[half:0:-1]
    tail = 2.0 * values[-1] - values[-2 : -half - 2 : -1]
    filtered = np.convolve(np.concatenate([head, values, tail]), taps, mode="valid")
    # Gaps of the source must stay gaps.
    near = np.abs(time - source.time_s[np.searchsorted(source.time_s, time).clip(0, source.time_s.size - 1)])
    previous = source.time_s[(np.searchsorted(source.time_s, time, side="right") - 1).clip(0)]
    keep = np.minimum(near, np.abs(time - previous)) <= typical
    return Signal(time[keep], filtered[keep], source.unit, source.source)
