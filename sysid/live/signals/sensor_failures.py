"""Sensors that fail in flight, detected by kinematics and redundancy alone: without aerodynamics no aircraft is blamed.

What a sensor reads is compared with what the others make of the same motion: attitude with the integral of the gyros,
airspeed and vanes with that of the accelerometers turned by the attitude, ground velocity with the same in the earth's
axes (the equations of `sysid.compatibility.kinematics`). Over the last seconds each comparison is a curve; a failure
from some moment on is a curve of its own in one or several of them: a step (bent, jumped), a ramp (a zero that stepped
in what is integrated, a drift), or what was integrated itself (stuck, blocked). The hypothesis that explains most is
reported where it is far beyond what the comparison is usually off by and leaves little of it.
Sources: M. Basseville & I. V. Nikiforov, "Detection of Abrupt Changes", 1993, section 7.2 (a bank of matched
signatures); R. J. Patton, P. M. Frank & R. N. Clark, "Fault Diagnosis in Dynamic Systems", 1989, chapter 2 (analytical
redundancy).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from sysid.arrays import Array

# Seconds that are looked at, the least of them behind a failure and before it, and between moments that are tried.
WINDOW_S, _AFTER_S, _BEFORE_S, _GRID_S = 8.0, 0.4, 1.0, 0.2
# What comparisons are off by at least, 1 sigma: attitude rad, airspeed m/s, flow angles rad, ground velocity m/s.
_LEAST = {
    "phi": 0.020, "theta": 0.020, "psi": 0.040, "V": 0.4, "alpha": 0.012, "beta": 0.012,
    "vn": 0.5, "ve": 0.5, "vd": 0.5,
}  # fmt: skip
# Sizes below which an attitude that wanders does the same: gyros rad/s, accelerometers m/s^2 (3 deg of it).
_LEAST_SIZE = {**dict.fromkeys("pqr", 0.0175), **dict.fromkeys(("ax", "ay", "az"), 0.5)}
# A failure is reported from so many times what is usual on, of more where the airspeed is to blame or what shows it
# hangs on the wind, since one that grows along the way looks alike; and where it explains so much of what is off.
_FAR, _FAR_IN_WIND, _FAR_OF_AIRSPEED, _EXPLAINED = 5.0, 6.5, 8.0, 0.8
_FLOW = ("V", "alpha", "beta")
# A reading that jumps from one moment to the next is reported though gusts go further in time: from so many times the
# usual jump of means over so many kept rows on, and from this size on.
_JUMP, _JUMP_ROWS = 6.0, 2
_LEAST_JUMP = {"V": 1.5, "alpha": 0.035, "beta": 0.035, "psi": 0.2}
# A step is one at its moment: what is off in so few kept rows behind it is that much of its size away from those before
# it, since a wind or an attitude moves more slowly; a jump still is in so many, since a vane that swings comes back.
_STEP_ROWS, _STAYS_ROWS, _AT_ONCE = 2, 10, 0.5
# A comparison in which a failure would be seen from so many times what is usual on must bear it out.
_SEEN = 1.3
# One in which it would be seen clearly, from so many times on, must be explained by it to that share.
_CLEAR, _BORNE_OUT = 2.0, 0.5
# Share of what is far, from which on it is looked for failures.
_LOOK = 0.4
# Beyond this pitch, rad, Euler's angles turn so fast that nothing is compared: an aircraft that is lost.
_STEEP = 1.0
# Lags of a vane that turns slowly that are tried, s.
_SLOW_S = (0.1, 0.2, 0.4, 0.8)
# Of what is usual: so much of a new window counts; windows before which nothing is known.
_MEMORY, _FIRST = 0.05, 6
# What may stick. A sensor that is stuck shows nothing of the motion: share of it that is missing; of it what the
# reading still moves.
_STUCK, _NOTHING, _MOVES = ("V", "alpha", "beta"), (0.8, 1.2), 0.3
_ROWS_S, _ROWS = 0.1, 4  # comparisons are kept at this interval, so many at a time


@dataclass(frozen=True)
class SensorFailure:
    """A sensor that has failed. name: of the hypothesis. size: in `unit`, of which there is none where it is stuck.
    text: in words. check: what is to be looked at. until_s: when it was over, None while it lasts. std: standard error
    of the size, and the failure's probability, NaN where none is estimated.
    """

    time_s: float
    name: str
    signal: str
    size: float
    unit: str
    text: str
    check: str = "the sensor, not the aircraft"
    until_s: float | None = None
    std: float = np.nan
    probability: float = np.nan


_Sums = dict[str, float]
_Kept = tuple[float, _Sums, _Sums, _Sums, _Sums]


@dataclass(frozen=True)
class _Hypothesis:
    """curves: comparison -> unit signature by the kind of curve that it is built of. signal: what has failed. factor:
    from SI to the unit.
    """

    name: str
    signal: str
    kind: str
    words: str
    factor: float
    unit: str
    curves: Mapping[str, str]


# What a sensor that may stick is called.
READINGS = {"alpha": "the alpha vane", "beta": "the beta vane", "airspeed": "the airspeed"}
_TO_DEG = float(np.degrees(1.0))
_HYPOTHESES = (
    _Hypothesis("airspeed_step", "airspeed", "step", "the airspeed jumped by {}", 1.0, "m/s", {"V": ""}),
    _Hypothesis("airspeed_drift", "airspeed", "ramp", "the airspeed drifts by {}", 1.0, "m/s per s", {"V": ""}),
    _Hypothesis("airspeed_still", "airspeed", "still", "the airspeed no longer moves", 1.0, "", {"V": ""}),
    *(
        _Hypothesis(f"{vane}_step", vane, "step", f"the {vane} vane jumped by {{}}", _TO_DEG, "deg", {vane: ""})
        for vane in ("alpha", "beta")
    ),
    *(
        _Hypothesis(f"{vane}_still", vane, "still", f"the {vane} vane is stuck", 1.0, "", {vane: ""})
        for vane in ("alpha", "beta")
    ),
    *(
        _Hypothesis(f"{vane}_slow", vane, f"slow {lag}", f"the {vane} vane lags by {lag:.1f} s", 1.0, "", {vane: ""})
        for vane in ("alpha", "beta") for lag in _SLOW_S
    ),
    _Hypothesis("psi_step", "psi", "step", "the heading jumped by {}", _TO_DEG, "deg", {"psi": ""}),
    *(
        _Hypothesis(f"{rate}_step", rate, "ramp", f"gyro {rate} stepped by {{}}", _TO_DEG, "deg/s",
                    {name: f"{rate} in {name}" for name in ("phi", "theta", "psi", "alpha", "beta")})
        for rate in ("p", "q", "r")
    ),
    *(
        _Hypothesis(f"a{axis}_step", f"a{axis}", "ramp", f"accelerometer {axis} stepped by {{}}", 1.0, "m/s^2",
                    {name: f"a{axis} in {name}" for name in ("V", "alpha", "beta", "vn", "ve", "vd")})
        for axis in ("x", "y", "z")
    ),
)  # fmt: skip


def comparisons(columns: Mapping[str, Array], gravity: float) -> tuple[dict[str, Array], dict[str, Array]]:
    """Rates of what is compared by the other sensors, and what a unit of each inertial sensor adds to them.

    columns: (N,) phi theta psi p q r ax ay az V alpha beta [SI, rad]. The second is by "p in phi".
    """
    phi, theta, psi = (columns[name] for name in ("phi", "theta", "psi"))
    sp, cp, st, ct, ss, cs = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta), np.sin(psi), np.cos(psi)
    alpha, beta, V = columns["alpha"], columns["beta"], np.maximum(columns["V"], 1.0)
    sa, ca, sb, cb = np.sin(alpha), np.cos(alpha), np.sin(beta), np.cos(beta)
    one, none = np.ones_like(phi), np.zeros_like(phi)
    # Rows of what p, q and r turn.
    turning = {
        "phi": (one, sp * st / ct, cp * st / ct), "theta": (none, cp, -sp), "psi": (none, sp / ct, cp / ct),
        "alpha": (-ca * sb / cb, one, -sa * sb / cb), "beta": (sa, none, -ca),
    }  # fmt: skip
    # Rows of what specific forces along x, y and z change.
    pushing = {
        "V": (ca * cb, sb, sa * cb), "alpha": (-sa / (V * cb), none, ca / (V * cb)),
        "beta": (-ca * sb / V, cb / V, -sa * sb / V),
        "vn": (ct * cs, sp * st * cs - cp * ss, cp * st * cs + sp * ss),
        "ve": (ct * ss, sp * st * ss + cp * cs, cp * st * ss - sp * cs), "vd": (-st, sp * ct, cp * ct),
    }  # fmt: skip
    felt = (columns["ax"] - gravity * st, columns["ay"] + gravity * ct * sp, columns["az"] + gravity * ct * cp)
    rates: dict[str, Array] = dict.fromkeys(_LEAST, none)
    unit: dict[str, Array] = {}
    for name, row in turning.items():
        for rate, gain in zip(("p", "q", "r"), row, strict=True):
            rates[name] = rates[name] + gain * columns[rate]
            unit[f"{rate} in {name}"] = gain
    for name, row in pushing.items():
        for axis, gain, force in zip(("ax", "ay", "az"), row, felt, strict=True):
            rates[name] = rates[name] + gain * force
            unit[f"{axis} in {name}"] = gain
    return rates, unit


class SensorMonitor:
    """Takes rows as they come; reports each sensor that fails once. gravity: m/s^2."""

    def __init__(self, gravity: float) -> None:
        self._gravity = gravity
        # Of each row that is kept: time, readings, integrals since the first of what the others make of them and of
        # what a unit of each inertial sensor adds, and mean squares of the steps from reading to reading.
        self._kept: deque[_Kept] = deque()
        self._motion: dict[str, float] = {}
        self._unit: dict[str, float] = {}
        self._waiting: list[tuple[Array, Mapping[str, Array]]] = []
        self._usual: dict[str, float] = {}
        self._jumps: dict[str, float] = {}
        self._drift: dict[str, float] = {}
        self._windows = 0
        # How far a comparison is off, of what is far.
        self.doubt = 0.0
        self.reported: dict[str, SensorFailure] = {}
        self._suspect = ""

    def restart(self) -> None:
        """What comes next does not continue what came before."""
        self._kept.clear()
        self._waiting = []

    def take(self, time_s: Array, columns: Mapping[str, Array], interval_s: float) -> None:
        """Take rows. columns: as of `comparisons`, and vn ve vd, NaN where there are none. Rows wait for others: a few
        take as long as many.
        """
        self._waiting.append((time_s, columns))
        count = sum(times.size for times, _ in self._waiting)
        step = max(1, round(_ROWS_S / interval_s))
        if count < _ROWS * step:
            return
        names = set.intersection(*(set(one) for _, one in self._waiting))
        times = np.concatenate([one for one, _ in self._waiting])
        joined = {name: np.concatenate([one[name] for _, one in self._waiting]) for name in names}
        whole = count - count % step
        self._waiting = [(times[whole:], {name: one[whole:] for name, one in joined.items()})] if whole < count else []
        if float(np.max(np.abs(joined["theta"]))) > _STEEP:
            self.restart()
            return
        self._keep(times[:whole], {name: one[:whole] for name, one in joined.items()}, interval_s, step)

    def _keep(self, time_s: Array, columns: Mapping[str, Array], interval_s: float, step: int) -> None:
        full = {name: columns.get(name, np.full(time_s.size, np.nan)) for name in _LEAST}
        still = np.zeros(time_s.size)
        rates, unit = comparisons({**columns, "beta": columns.get("beta", still)}, self._gravity)
        integrals = {n: self._motion.get(n, 0.0) + interval_s * np.cumsum(np.nan_to_num(r)) for n, r in rates.items()}
        units = {n: self._unit.get(n, 0.0) + interval_s * np.cumsum(np.nan_to_num(r)) for n, r in unit.items()}
        self._motion = {name: float(values[-1]) for name, values in integrals.items()}
        self._unit = {name: float(values[-1]) for name, values in units.items()}
        # The mean over a kept interval is quieter than one reading; of what comes seldom the newest counts.
        for begin in range(0, time_s.size - step + 1, step):
            here = slice(begin, begin + step)
            with np.errstate(invalid="ignore"):
                read = {n: _mean(values[here] - integrals[n][here]) for n, values in full.items()}
            self._kept.append(
                (
                    float(time_s[begin + step - 1]), read,
                    {n: float(np.mean(values[here])) for n, values in integrals.items()},
                    {n: float(np.mean(values[here])) for n, values in units.items()},
                    {n: float(np.mean(np.diff(full[n][here]) ** 2)) for n in _STUCK},
                )
            )  # fmt: skip
        while self._kept and self._kept[0][0] < float(time_s[-1]) - WINDOW_S:
            self._kept.popleft()

    def check(self) -> SensorFailure | None:
        """The sensor that has failed by now, if any."""
        if len(self._kept) < 2 or self._kept[-1][0] - self._kept[0][0] < WINDOW_S - 2.0 * _ROWS_S:
            return None
        times = np.array([one[0] for one in self._kept])
        gaps = {name: _unwrapped(name, np.array([one[1][name] for one in self._kept])) for name in _LEAST}
        lost = {"V" if signal == "airspeed" else signal for signal in self.reported}
        gaps = {n: gap for n, gap in gaps.items() if n not in lost and np.isfinite(gap).sum() > 0.3 * gap.size}
        seconds = times - times[0]
        flat = {name: gap - self._drift.get(name, 0.0) * seconds for name, gap in gaps.items()}
        best = self._likeliest(times, flat) or self._jumped(times, flat) if self._windows >= _FIRST else None
        suspect, self._suspect = self._suspect, "" if best is None else best.name
        if best is None:
            self._learn(seconds, gaps, flat)
        elif best.name == suspect:  # twice in a row
            self.note(best)
            return best
        return None

    def stands_still(self, name: str, time_s: float) -> SensorFailure:
        """Take the word of who sees that a sensor repeats one reading."""
        failure = SensorFailure(time_s, f"{name}_still", name, 1.0, "", f"{READINGS[name]} repeats one reading")
        self.note(failure)
        return failure

    def note(self, failure: SensorFailure) -> None:
        """Take a failure that is reported: what comes is compared anew, and this sensor with nothing more."""
        self.reported[failure.signal] = failure
        self._kept.clear()
        self._drift.clear()
        self._windows = 0
        self.doubt = 0.0

    def _learn(self, seconds: Array, gaps: Mapping[str, Array], flat: Mapping[str, Array]) -> None:
        self._windows += 1
        share = max(_MEMORY, 1.0 / self._windows)
        for name, gap in gaps.items():
            here = np.isfinite(gap)
            slope = float(np.polyfit(seconds[here], gap[here], 1)[0])
            self._drift[name] = self._drift.get(name, 0.0) + share * (slope - self._drift.get(name, 0.0))
            power = float(np.var(flat[name][here]))
            self._usual[name] = self._usual.get(name, 0.0) + share * (power - self._usual.get(name, 0.0))
            jumps = _jumps(gap) if name in _LEAST_JUMP else np.zeros(0)
            if np.isfinite(jumps).any():
                jump = float(np.nanmean(jumps**2))
                self._jumps[name] = self._jumps.get(name, 0.0) + share * (jump - self._jumps.get(name, 0.0))

    def _jumped(self, times: Array, gaps: Mapping[str, Array]) -> SensorFailure | None:
        """A reading that has jumped, none of the others with it."""
        found = []
        for name in _LEAST_JUMP.keys() & gaps.keys():
            jumps = _jumps(gaps[name])
            place = int(np.nanargmax(np.abs(jumps))) if np.isfinite(jumps).any() else 0
            far = float(abs(jumps[place])) / max(_JUMP * float(np.sqrt(self._jumps.get(name, 0.0))), _LEAST_JUMP[name])
            if far > 1.0 and _steps(gaps[name], place + _JUMP_ROWS, float(jumps[place]), _STAYS_ROWS):
                found.append((far, name, float(jumps[place]), place))
        if len(found) != 1:
            return None
        _, name, size, place = found[0]
        one = next(one for one in _HYPOTHESES if one.kind == "step" and name in one.curves)
        if one.signal in self.reported:
            return None
        words = one.words.format(f"{one.factor * size:+.2g} {one.unit}")
        moment = float(times[place + _JUMP_ROWS])
        return SensorFailure(moment, one.name, one.signal, one.factor * size, one.unit, words)

    def _likeliest(self, times: Array, gaps: Mapping[str, Array]) -> SensorFailure | None:
        sigma = {name: max(float(np.sqrt(self._usual.get(name, 0.0))), _LEAST[name]) for name in gaps}
        off = {name: float(np.nanmax(np.abs(gap - np.nanmean(gap)))) / sigma[name] for name, gap in gaps.items()}
        self.doubt = max(off.values()) / _FAR
        if self.doubt < _LOOK:
            return None
        curves = _Curves(times, [one[2:] for one in self._kept], self._drift)
        found: tuple[float, SensorFailure] | None = None
        for one in _HYPOTHESES:
            names = [name for name in one.curves if name in gaps]
            if one.signal in self.reported or max((off[name] for name in names), default=0.0) < _LOOK * _FAR:
                continue
            gain, size, place = _fitted(one, names, curves, gaps, sigma)
            if gain <= 0.0 or (found is not None and gain <= found[0]):
                continue
            if one.kind == "still" and not curves.is_still(names[0], place, gaps[names[0]]):
                continue
            at = int(np.argmax(curves.later[place]))
            if one.kind == "step" and not _steps(gaps[names[0]], at, size, _STEP_ROWS):
                continue
            words = one.words.format(f"{one.factor * size:+.2g} {one.unit}")
            moment = float(curves.moments[place])
            found = (gain, SensorFailure(moment, one.name, one.signal, one.factor * size, one.unit, words))
        return None if found is None else found[1]


class _Curves:
    """What a unit of each failure makes of a comparison, for every moment that is tried: (M, N) of N times.

    kept: of each time what else is kept of it. drift: of comparisons, a second.
    """

    def __init__(self, times: Array, kept: Sequence[tuple[_Sums, _Sums, _Sums]], drift: Mapping[str, float]) -> None:
        self.times = times
        self.moments: Array = np.arange(times[0] + _BEFORE_S, times[-1] - _AFTER_S, _GRID_S)
        self.later: NDArray[np.bool_] = times >= self.moments[:, np.newaxis]
        self._first = np.argmax(self.later, axis=1)
        self._kept, self._drift = kept, drift

    def of(self, one: _Hypothesis, name: str) -> Array:
        """(M, N) of a hypothesis and a comparison."""
        if one.kind == "step":
            return np.asarray(self.later, dtype=np.float64)
        if one.kind.startswith("slow"):
            moved = self.moved(name)
            return np.asarray(np.where(self.later, _lagged(moved, float(one.kind[5:]), self.times) - moved, 0.0))
        if one.kind == "still":
            return -self._since(self.moved(name))
        if one.curves[name]:
            return -self._since(np.array([units[one.curves[name]] for _, units, _ in self._kept]))
        return self._since(self.times)

    def moved(self, name: str) -> Array:
        """(N,) what the others make of a reading, without what they usually drift by."""
        integral = np.array([motion[name] for motion, _, _ in self._kept])
        return np.asarray(integral + self._drift.get(name, 0.0) * (self.times - self.times[0]))

    def is_still(self, name: str, place: int, gap: Array) -> bool:
        """Whether a reading hardly moves beside what it should, and is far smoother than it was: an aircraft that goes
        with the gusts does the first without a fault.
        """
        later, motion = self.later[place], self.moved(name)
        if float(np.nanstd((gap + motion)[later])) > _MOVES * float(np.std(motion[later])):
            return False
        rough = np.array([steps[name] for _, _, steps in self._kept])
        return float(np.mean(rough[later])) < _MOVES**2 * float(np.mean(rough[~later]))

    def _since(self, values: Array) -> Array:
        return np.asarray(np.where(self.later, values - values[self._first][:, np.newaxis], 0.0))


def _fitted(
    one: _Hypothesis, names: Sequence[str], curves: _Curves, gaps: Mapping[str, Array], sigma: Mapping[str, float]
) -> tuple[float, float, int]:
    """What a failure explains from the best of the moments on, its size and that moment's place; 0 where it is not far
    beyond what is usual. Gains of all hypotheses are of the same comparisons, and so can be compared.
    """
    # By comparison and moment: products of curve and gap, of the curve with itself; energy of the gap; reach.
    along, own, reach = (np.zeros((len(names), curves.moments.size)) for _ in range(3))
    total = np.zeros((len(names), 1))
    for k, name in enumerate(names):
        here = np.isfinite(gaps[name])
        y, x = gaps[name][here] / sigma[name], curves.of(one, name)[:, here] / sigma[name]
        y, x = y - y.mean(), x - x.mean(axis=1, keepdims=True)
        along[k], own[k], total[k], reach[k] = x @ y, np.sum(x * x, axis=1), y @ y, np.ptp(x, axis=1)
    size = along.sum(axis=0) / np.maximum(own.sum(axis=0), 1e-12)
    good = np.abs(size) >= _LEAST_SIZE.get(one.signal, 0.0)
    if one.kind == "still" or one.kind.startswith("slow"):
        good &= (size > _NOTHING[0]) & (size < _NOTHING[1])
    if one.kind == "still":
        size = np.ones_like(size)
    explained = size * (2.0 * along - size * own)
    # Where it shows most it must be far off, and what is off there must be it; where it is seen it must be borne out.
    shown = np.argmax(reach, axis=0), np.arange(size.size)
    windy = one.kind == "ramp" and np.array([name in _FLOW for name in names])[shown[0]]
    far = _FAR_OF_AIRSPEED if one.signal == "airspeed" else np.where(windy, _FAR_IN_WIND, _FAR)
    good &= (np.abs(size) * reach[shown] >= far) & (explained[shown] >= _EXPLAINED * total[shown[0], 0])
    seen = np.abs(size) * reach
    good &= ~np.any((seen > _SEEN) & (explained < 0.0), axis=0)
    good &= ~np.any((seen > _CLEAR) & (explained < _BORNE_OUT * total), axis=0)
    gain = np.where(good, explained.sum(axis=0), 0.0)
    place = int(np.argmax(gain))
    return float(gain[place]), float(size[place]), place


def _lagged(values: Array, lag_s: float, times: Array) -> Array:
    """Values behind a lag of the first order, at rest in the beginning."""
    step = float(np.median(np.diff(times)))
    keep = float(np.exp(-step / lag_s))
    lagged: Array = values[0] + np.asarray(lfilter([1.0 - keep], [1.0, -keep], values - values[0]))
    return lagged


def _steps(gap: Array, place: int, size: float, rows: int) -> bool:
    """Whether a comparison steps by this size at a row, rather than that it wanders or swings."""
    before, after = _mean(gap[max(place - rows, 0) : place]), _mean(gap[place : place + rows])
    return bool(gap.size >= place + rows and (after - before) * np.sign(size) > _AT_ONCE * abs(size))


def _jumps(gap: Array) -> Array:
    """Mean over some rows less that over as many before."""
    means = np.convolve(gap, np.full(_JUMP_ROWS, 1.0 / _JUMP_ROWS), mode="valid")
    return np.asarray(means[_JUMP_ROWS:] - means[:-_JUMP_ROWS])


def _mean(values: Array) -> float:
    here = values[np.isfinite(values)]
    return float(here.mean()) if here.size else np.nan


def _unwrapped(name: str, gap: Array) -> Array:
    """Differences of angles that go round, in one piece."""
    if name not in ("phi", "psi") or not np.isfinite(gap).all():
        return gap
    return np.asarray(np.unwrap(gap))
