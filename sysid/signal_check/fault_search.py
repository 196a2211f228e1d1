"""Mistakes in signals: which of them make the sensors tell one motion, found by likelihood.

Every hypothesis (sysid.signal_check.fault_hypotheses, a scale factor, a delay) reads the same data differently, in
every window that has its signals; the kinematic relations (sysid.signal_check.kinematic_residuals) say how likely each
reading is. The best one counts if it gains far more log likelihood than chance would give it among so many; then the
search goes on in the data so corrected.

Which parts of flights, and which of their signals, are examined for mistakes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Array
from sysid.numerics.fractional_delay import read_later
from sysid.numerics.smoothing import noise_sigma
from sysid.signal_check.fault import Mistake, delay_mistake
from sysid.signal_check.fault_hypotheses import Hypothesis, hypotheses, scale_hypothesis
from sysid.signal_check.kinematic_residuals import (
    AIR,
    CALM_RELATIONS,
    DENSE,
    GROUND_DELAY,
    MEASURED_IN,
    Fit,
    KinematicResiduals,
    Window,
    delay_slope,
    quick_cost,
    scale_slope,
)
from sysid.signals.delay import Delay
from sysid.signals.flight import FlightData
from sysid.signals.sensor_groups import ACCEL, GROUND, GROUPS, IMU, VANES, group_name
from sysid.signals.sensor_layout import SensorLayout

# Log likelihood by which a reading must beat the one as given: some 400 readings are tried.
GAIN = 20.0
# A delay counts from four standard errors and two milliseconds on, up to LONGEST_DELAY_S: on clean flights a roll rate,
# which follows its command within a few samples, may seem 1.1 ms late.
DELAY_SIGMAS, DELAY_LEAST_S, LONGEST_DELAY_S = 4.0, 2e-3, 0.3
# A scale factor that no sensor error stands for counts from five standard errors and 3 % on ...
SCALE_SIGMAS, SCALE_LEAST = 5.0, 0.03
# ... and from here on the data are not used as they are.
SCALE_REFUSED = 0.2
_SHORTLIST = 6
_LEVEL_GAIN = 5.0
_NO_DOUBT = 10.0 * GAIN  # of a sign, where a signal moves by hardly more than its noise
_HUGE = 1e20
_MOST = 4
_STEPS = 6
_CALM_RATIO = 1.15
_SCALED = (
    ("ax",), ("ay",), ("az",), ("p",), ("q",), ("r",), ("phi",), ("theta",), ("psi",), ("p", "q", "r"),
    ("ax", "ay", "az"), ("vn", "ve", "vd"), ("vn",), ("ve",), ("vd",),
)  # fmt: skip

_SCALE_LINEAR, _LIKELIER = 0.01, 3.0
# Delays tried where the relations do not hold, before the derivative is trusted.
_SCAN_S = 0.02

Columns = Mapping[str, Array]
Names = tuple[str, ...] | None

_FEWEST = 100  # samples of a part
_LONGEST_S = 60.0


@dataclass(frozen=True)
class LikelyReading:
    """One reading of the data with its gain over the one before; columns: per window.

    stretched: logarithm of its Jacobian, less its penalty.
    """

    gain: float
    mistake: Mistake
    columns: list[dict[str, Array]]
    stretched: float = 0.0


def find_mistakes(parts: Sequence[FlightData], layout: SensorLayout) -> list[Mistake]:
    """Mistakes in the signals of uniform parts without NaN in IMU, attitude and airspeed, the surest first."""
    parts = longest(parts)
    if not parts:
        return []
    windows = [Window(part, layout) for part in parts]
    columns = [{name: window.data[name] for name in known(window.data)} for window in windows]
    found: list[Mistake] = []
    # Readings far from any motion overflow; their likelihood is then no number, which wins no comparison.
    with np.errstate(all="ignore"):
        while len(found) < _MOST:
            if not all(_finite(w, c) for w, c in zip(windows, columns, strict=True)):
                break
            best = _best(windows, columns)
            if best is None:
                break
            found.append(best.mistake)
            columns = best.columns
    return _merged(found)


def _finite(window: Window, columns: Columns) -> bool:
    """Whether the relations can be compared at all: their residuals are numbers whose squares are numbers."""
    return all(np.isfinite(gap @ gap) and gap @ gap < _HUGE for gap in window.gaps(columns, {}).values())


def _best(windows: list[Window], columns: list[dict[str, Array]]) -> LikelyReading | None:
    base = KinematicResiduals(windows, columns)
    found = _discrete(windows, columns, base)
    # Large scale errors of vanes and airspeed are estimated later; here they must only do no harm.
    read, there, stretched = _rescaled(windows, columns, base)
    entries = [(one, columns, 0.0) for one in found]
    entries += [(one, read, stretched) for one in (*_scales(windows, read, there), *_delays(windows, read, there))]
    best = max(entries, key=lambda entry: entry[0].gain, default=None)
    if there is not base and (best is None or best[0].mistake.kind != "unit"):
        # Such scale errors may themselves be what a delay does.
        late = max(_delays(windows, columns, base), key=lambda one: one.gain, default=None)
        if late is not None:
            worth = _worth(windows, late, columns)
            other = -np.inf if best is None else _worth(windows, best[0], best[1]) + best[2]
            if worth > max(other, stretched - there.null().cost + GAIN):
                return late
    return None if best is None else best[0]


def _worth(windows: list[Window], one: LikelyReading, given: list[dict[str, Array]]) -> float:
    """Log likelihood of a reading of `given` with the large scale errors that it leaves taken off.

    Late signals are moved by whole samples: parts of a sample would make their noise small, which is no merit.
    """
    columns = one.columns
    if one.mistake.kind == "delay":
        interval = windows[0].interval_s
        whole = round(one.mistake.found / interval) * interval
        columns = [advanced(c, one.mistake.signals, whole, interval) for c in given]
    _, there, stretched = _rescaled(windows, columns, KinematicResiduals(windows, columns))
    return one.stretched + stretched - there.null().cost


def _rescaled(
    windows: list[Window], columns: list[dict[str, Array]], base: KinematicResiduals
) -> tuple[list[dict[str, Array]], KinematicResiduals, float]:
    """The signals without scale errors so large that their derivative does not hold, where that is likelier.

    The third is the logarithm of the Jacobian.
    """
    total = 0.0
    for _ in range(_STEPS):
        large = {name: s for name, s in base.null().scales.items() if name != "theta" and abs(s) > _SCALE_LINEAR}
        if not large:
            break
        read, stretched = columns, 0.0
        for name, scale in large.items():
            one = scale_hypothesis((name,), max(scale, -0.5))
            read = [one.apply(c) for c in read]
            stretched += _stretched(one, windows)
        there = KinematicResiduals(windows, read)
        if base.null().cost - there.null().cost + stretched < _LIKELIER:
            break
        columns, base, total = read, there, total + stretched
    return columns, base, total


def _discrete(windows: list[Window], columns: list[dict[str, Array]], base: KinematicResiduals) -> list[LikelyReading]:
    present = set.union(*(set(c) for c in columns)) - {GROUND_DELAY}
    return discrete_readings(windows, columns, base, hypotheses(present, windows[0].layout.gravity))


def discrete_readings(
    windows: list[Window], columns: list[dict[str, Array]], base: KinematicResiduals, tried: Sequence[Hypothesis]
) -> list[LikelyReading]:
    """Those of the readings tried that are far likelier than the data as they are, the likeliest first."""
    present = set.union(*(set(c) for c in columns)) - {GROUND_DELAY}
    filters = base.filters()
    quick = quick_cost(windows, columns, filters)
    ranked = []
    quiet = {n for n in present - set(GROUND) if n not in ACCEL and _still(windows, columns, n)}
    for one in tried:
        # Of a signal that is hardly more than noise little can be said: that its unit makes it so small, or that it has
        # the wrong sign, where thousands of samples leave no doubt.
        silent = quiet.issuperset(one.signals) and one.shrinks(one.signals[0]) >= 0.0
        if silent and one.kind != "sign":
            continue
        read = [one.apply(c) for c in columns]
        gain = quick - quick_cost(windows, read, filters) + _stretched(one, windows) - one.penalty
        if gain > (_NO_DOUBT if silent else 0.5 * GAIN):
            ranked.append((gain, one, read))
    ranked.sort(key=lambda entry: -entry[0])
    found = []
    for _, one, read in ranked[:_SHORTLIST]:
        there = KinematicResiduals(windows, read)
        gain = base.null().cost - there.null().cost + _stretched(one, windows) - one.penalty
        if gain > GAIN and (base.level_cost - there.level_cost > _LEVEL_GAIN or _moved_by(one, base)):
            found.append(LikelyReading(gain, one.as_mistake(), read, _stretched(one, windows) - one.penalty))
    return sorted(found, key=lambda entry: -entry.gain)


def _moved_by(one: Hypothesis, base: KinematicResiduals) -> bool:
    """Whether the motion itself speaks against the scale of an inertial signal, not the noise that it brings along."""
    if one.kind == "axis" or not set(one.signals) <= set(IMU):
        return True
    slopes = [
        _summed([scale_slope(w, c, name) for name in one.signals])
        for w, c in zip(base.windows, base.smooth, strict=True)
    ]
    value, std = base.score(slopes)
    return abs(value) > SCALE_SIGMAS * std


def _stretched(one: Hypothesis, windows: Sequence[Window]) -> float:
    """Log of the Jacobian: a reading in smaller numbers leaves smaller residuals, which is no merit."""
    return sum(
        one.shrinks(name) * window.rows[key].size
        for window in windows
        if one.concerns(window.data)
        for name, relations in MEASURED_IN.items()
        for key in relations
        if key in window.relations
    )


def _still(windows: list[Window], columns: list[dict[str, Array]], name: str) -> bool:
    """Whether a signal moves by no more than its own noise where it is read, so that its scale cannot be told."""
    if name in GROUND:
        return False
    read = [(w, c[name]) for w, c in zip(windows, columns, strict=True) if name in c]
    travel = np.sqrt(np.mean([np.var(one - np.polyval(np.polyfit(w.data.time_s, one, 1), w.data.time_s))
                              for w, one in read]))  # fmt: skip
    noise = np.mean([noise_sigma(one, w.interval_s) for w, one in read])
    return bool(travel < 3.0 * noise)


def _scales(windows: list[Window], columns: list[dict[str, Array]], base: KinematicResiduals) -> list[LikelyReading]:
    """Scale factors of signals for which no sensor error stands."""
    found = []
    singles = {
        name: [scale_slope(w, c, name) for w, c in zip(windows, base.smooth, strict=True)]
        for name in dict.fromkeys(itertools.chain(*_SCALED))
        if any(name in c for c in columns) and not _still(windows, columns, name)
    }
    for names in _SCALED:
        if not all(name in singles for name in names):
            continue
        slopes = [_summed(of_window) for of_window in zip(*(singles[name] for name in names), strict=True)]
        relations = None
        scale, std = base.score(slopes)
        if abs(scale) < max(0.5 * SCALE_LEAST, SCALE_SIGMAS * std):
            continue
        better = base.fit(slopes)
        if not _calm(windows, columns, better):
            relations = CALM_RELATIONS
            better = base.fit(slopes, relations)
        scale, std = _refined(windows, columns, names, float(better.values[0]), relations)
        if abs(scale) < max(SCALE_LEAST, SCALE_SIGMAS * std) or scale < -0.9:
            continue
        one = scale_hypothesis(names, scale)
        read = [one.apply(c) for c in columns]
        there = KinematicResiduals(windows, read)
        gain = base.null(relations).cost - there.null(relations).cost + _stretched(one, windows) - one.penalty
        if gain > GAIN:
            usable = abs(scale) < SCALE_REFUSED
            mistake = Mistake(group_name(names), "scale", 1.0 / (1.0 + scale), std, "1", one.sentence, names, usable)
            found.append(LikelyReading(gain, mistake, read, _stretched(one, windows) - one.penalty))
    return found


def _refined(
    windows: list[Window], columns: list[dict[str, Array]], names: tuple[str, ...], scale: float, relations: Names
) -> tuple[float, float]:
    """A scale error after further Gauss-Newton steps, with its standard error."""
    std = float("inf")
    for _ in range(2):
        there = KinematicResiduals(windows, [scale_hypothesis(names, scale).apply(c) for c in columns])
        slopes = [
            _summed([scale_slope(w, c, name) for name in names]) for w, c in zip(windows, there.smooth, strict=True)
        ]
        more, std = there.score(slopes, relations)
        scale = (1.0 + scale) * max(1.0 + more, 0.1) - 1.0
    return scale, std


def _summed(slopes: Sequence[dict[str, Array]]) -> dict[str, Array]:
    return {key: np.sum([one[key] for one in slopes], axis=0) for key in slopes[0]}


def noise_at_most(values: Array, interval: float) -> float:
    """Noise of one sample, also of readings that were interpolated, whose neighbours share theirs; motion may add."""
    return max(noise_sigma(values, interval), noise_sigma(values[::2], 2.0 * interval))


def _calm(windows: list[Window], columns: list[dict[str, Array]], fit: Fit, names: Sequence[str] = AIR) -> bool:
    """Whether what remains of the air data is their noise, so that gusts cannot feign what is looked for."""
    for name in names:
        if name in fit.sigma:
            level = []
            for window, c in zip(windows, columns, strict=True):
                if name in window.relations:
                    level.append(noise_at_most(window.measured(window.states(c, {}), c)[name], window.interval_s))
            if fit.sigma[name] > _CALM_RATIO * float(np.mean(level)):
                return False
    return True


def _delays(windows: list[Window], columns: list[dict[str, Array]], base: KinematicResiduals) -> list[LikelyReading]:
    """Delays of groups and single signals against all others."""
    found = []
    singles = [(name,) for name in dict.fromkeys(n for group in GROUPS.values() for n in group) if name not in GROUND]
    astray = not _calm(windows, columns, base.null(), DENSE)
    for names in dict.fromkeys([*GROUPS.values(), *singles]):
        here = tuple(name for name in names if any(name in c for c in columns))
        if len(here) != len(names) and not (names == GROUPS["attitude"] and len(here) == 2):
            continue
        slopes = [delay_slope(w, c, here) for w, c in zip(windows, base.smooth, strict=True)]
        looks = [base.score(slopes, relations) for relations in (None, CALM_RELATIONS)]
        likely = any(abs(value) > max(0.5 * DELAY_LEAST_S, DELAY_SIGMAS * std) for value, std in looks)
        start = 0
        if astray and (len(here) > 1 or here[0] in (*VANES, "airspeed")):
            start = _scanned(windows, columns, here, base.filters())
        if likely or start:
            candidate = _delay(windows, columns, base, here, start)
            if candidate is not None:
                found.append(candidate)
    return found


def _scanned(
    windows: list[Window], columns: list[dict[str, Array]], names: tuple[str, ...], filters: dict[str, Array]
) -> int:
    """Likeliest delay in whole samples among a few; 0 unless another one is far likelier."""
    interval = windows[0].interval_s
    stride = max(round(_SCAN_S / interval), 1)
    last = int(LONGEST_DELAY_S / interval)
    costs = {
        shift: quick_cost(windows, [advanced(c, names, shift * interval, interval) for c in columns], filters)
        for shift in range(-last + last % stride, last + 1, stride)
    }
    best = min(costs, key=lambda shift: costs[shift])
    return best if costs[0] - costs[best] > GAIN else 0


def _delay(
    windows: list[Window], columns: list[dict[str, Array]], base: KinematicResiduals, names: tuple[str, ...], start: int
) -> LikelyReading | None:
    """One delay by Gauss-Newton from `start` samples on: whole samples by shifting, the rest by its derivative."""
    interval = windows[0].interval_s
    for relations in (None, CALM_RELATIONS):
        plain = base.null(relations)
        shift, here, there = 0, columns, base
        step = start
        for _ in range(_STEPS):
            if step:
                shift += step
                here = [advanced(c, names, shift * interval, interval) for c in columns]
                there = KinematicResiduals(windows, here)
            slopes = [delay_slope(w, c, names) for w, c in zip(windows, there.smooth, strict=True)]
            fit = there.fit(slopes, relations)
            if not np.isfinite(fit.values[0]):
                return None
            step = round(float(fit.values[0]) / interval)
            if step == 0 or abs(shift + step) * interval > LONGEST_DELAY_S:
                break
        delay, std = shift * interval + float(fit.values[0]), float(fit.std[0])
        if relations is None and not _calm(windows, here, fit):
            continue
        gain = plain.cost - fit.cost - (0.0 if len(names) > 1 else 1.0)
        if gain < GAIN or abs(delay) < max(DELAY_LEAST_S, DELAY_SIGMAS * std) or abs(delay) > LONGEST_DELAY_S:
            return None
        read = [advanced(c, names, delay, interval) for c in columns]
        return LikelyReading(gain, delay_mistake(Delay(names, delay, std)), read)
    return None


def advanced(columns: Columns, names: Sequence[str], delay: float, interval: float) -> dict[str, Array]:
    """Signals, as far as they are there, taken earlier by any time; velocities over ground keep their samples, which
    then count as later.
    """
    if set(names) <= set(GROUND):
        return dict(columns) | {GROUND_DELAY: columns.get(GROUND_DELAY, np.array(0.0)) + delay}
    return dict(columns) | {name: read_later(columns[name], delay, interval) for name in names if name in columns}


def _merged(found: list[Mistake]) -> list[Mistake]:
    """One entry for a signal whose delay was found in two steps."""
    merged: dict[tuple[tuple[str, ...], str], Mistake] = {}
    for one in found:
        key = (one.signals, one.kind)
        if key in merged and one.kind == "delay":
            one = delay_mistake(Delay(one.signals, merged[key].found + one.found, one.std))
        merged[key] = one
    return list(merged.values())


def longest(parts: Sequence[FlightData]) -> list[FlightData]:
    """The longest parts, together at most some minutes: more of the same tells nothing new."""
    kept: list[FlightData] = []
    total = 0.0
    for part in sorted(map(_whole, parts), key=lambda one: -one.time_s.size):
        if part.time_s.size < _FEWEST or (kept and total > 2.0 * _LONGEST_S):
            break
        kept.append(part)
        total += part.time_s.size * part.interval_s
    return kept


def _whole(part: FlightData) -> FlightData:
    """The longest run in which vanes and heading, where they are there at all, carry values."""
    good = np.ones(part.time_s.size, dtype=np.bool_)
    for name in (*VANES, "psi"):
        if name in part and np.isfinite(part[name]).mean() > 0.5:
            good &= np.isfinite(part[name])
    edges = np.concatenate(([-1], np.flatnonzero(~good), [good.size]))
    longest = int(np.argmax(np.diff(edges)))
    return part.window(int(edges[longest]) + 1, int(edges[longest + 1]))


def known(part: FlightData) -> list[str]:
    """Signals that are examined and carry values."""
    names = [name for group in (*GROUPS.values(),) for name in group]
    return [name for name in dict.fromkeys(names) if name in part and np.isfinite(part[name]).any()]
