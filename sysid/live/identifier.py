"""Live identification: contract signals in as they come, what is known of the aircraft out at any time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sim_vehicle.controls import DEFLECTION_SIGNALS
from sim_vehicle.terms import parse_term
from sim_vehicle.vehicle import SEA_LEVEL_DENSITY, Vehicle
from sysid.coefficients import AXES
from sysid.equations import MOMENTS
from sysid.flight import Array
from sysid.live.air import AirFilter, SensorError
from sysid.live.airborne import Airborne
from sysid.live.airsteps import ROW
from sysid.live.changes import Change, ChangeDetector
from sysid.live.equations import BIASES, LiveEquations
from sysid.live.excitation import Coefficient, judged
from sysid.live.recursive import Decimator, RecursiveLeastSquares
from sysid.live.sentences import change_sentence, sensor_warnings
from sysid.live.spectral import VANES, AxisEstimator, Estimate
from sysid.live.stuck import StuckVanes
from sysid.live.thrust import LiveThrust
from sysid.live.timebase import Rows, TimeBase
from sysid.structure import LONGITUDINAL_AXES, default_structure, helpful_manoeuvre, usual_size

_CORE = ("ax", "ay", "az", "p", "q", "r", "alpha", "airspeed", "air_density")
_OPTIONAL = ("beta", "phi", "theta", "psi")
_HEIGHT = ("altitude",)  # tells the ground from the air, where there is one
_SPARSE = ("vn", "ve", "vd")
# How long signals gather before it is settled which of them this aircraft has.
_GATHER_S = 1.5
# Rows are worked on when a report is asked for, at the latest after this time: many cost hardly more than one does.
_PIECE_S = 0.5
# Equations want the control derivatives that are known, whether or not anybody asks for a report.
_REFRESH_S = 1.0
_NOISE_MEMORY = 300  # rows
# Sum of the squares of the fourth difference's weights: the variance of white noise in it.
_FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
_RATES = ("p", "q", "r")
_ACCELERATIONS = ("ax", "ay", "az")
# Least share of a variance that is left where the noise that two estimates share is taken off.
_LEAST_OWN = 0.25
# Of the square of a normal variate, the median over the mean.
_MEDIAN_OF_SQUARES = 0.4549


@dataclass(frozen=True)
class LiveReport:
    """What is known at `time_s`. Dictionaries are by name; least_squares: value and standard error."""

    time_s: float
    coefficients: dict[str, Coefficient]
    least_squares: dict[str, tuple[float, float]]
    sensors: dict[str, SensorError]
    changes: tuple[Change, ...]
    warnings: tuple[str, ...]

    def sentences(self) -> list[str]:
        """Each change in words."""
        return [change_sentence(change) for change in self.changes]


@dataclass
class _Axis:
    """One axis of the model: its terms and everything that estimates them."""

    names: tuple[str, ...]
    factors: tuple[tuple[str, ...], ...]
    estimator: AxisEstimator
    squares: RecursiveLeastSquares
    detector: ChangeDetector
    estimate: Estimate | None = None


@dataclass
class _Noise:
    """Variance of a sensor's white noise, by the fourth difference, in which motion does not show.

    jumps: whether what is measured may bend from one sample to the next, as a rate does at a step of a command. Then
    the median tells it.
    """

    jumps: bool = False
    tail: Array = field(default_factory=lambda: np.empty(0))
    recent: Array = field(default_factory=lambda: np.empty(0))
    variance: float = np.nan
    count: int = 0

    def take(self, values: Array, *, continues: bool) -> None:
        joined = np.concatenate([self.tail, values]) if continues else values
        self.tail = joined[-4:]
        if joined.size < 5:
            return
        squares = np.convolve(joined, _FOURTH, mode="valid") ** 2 / float(_FOURTH @ _FOURTH)
        if self.jumps:
            self.recent = np.concatenate([self.recent, squares])[-_NOISE_MEMORY:]
            self.variance = float(np.median(self.recent)) / _MEDIAN_OF_SQUARES
            return
        self.count += squares.size
        share = min(squares.size / min(self.count, _NOISE_MEMORY), 1.0)
        mean = float(np.mean(squares))
        self.variance = mean if np.isnan(self.variance) else self.variance + share * (mean - self.variance)


class LiveIdentifier:
    """Coefficients of all six axes while samples come. vehicle: what is known before the flight."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        surfaces = [DEFLECTION_SIGNALS[name] for name in vehicle.controls if name != "throttle"]
        self._surfaces = tuple(surfaces)
        self._names = default_structure(surfaces)
        self._thrust = LiveThrust(vehicle.propulsion)
        self._base: TimeBase | None = None
        self._waiting: list[Mapping[str, tuple[Array, Array]]] = []
        self._seen: dict[str, float] = {}
        self._begun: float | None = None
        self._refused: dict[str, tuple[str, str]] = {}
        self._axes: dict[str, _Axis] = {}
        self._decimator: Decimator | None = None
        self._equations: LiveEquations | None = None
        self._air = AirFilter(vehicle.environment.gravity)
        self._airborne = Airborne(vehicle)
        self._stuck = StuckVanes()
        bending = (*_RATES, *_ACCELERATIONS)
        self._noise = {name: _Noise(name in bending) for name in (*VANES, "airspeed", *bending)}
        self._changes: list[Change] = []
        self._settled: dict[str, float] = {}
        self._sparse: dict[str, list[tuple[float, float]]] = {name: [] for name in _SPARSE}
        self._worked = self._refreshed = -np.inf
        self.time_s = -np.inf

    def take(self, samples: Mapping[str, tuple[Array, Array]]) -> None:
        """Take samples as they come: signal -> stamps (s) and values (SI). Late and repeated ones are left out."""
        for name, (time_s, values) in samples.items():
            if not time_s.size:
                continue
            self._seen[name] = float(time_s[-1])
            if name in self._sparse:
                self._sparse[name] += zip(time_s.tolist(), values.tolist(), strict=True)
        if self._base is None:
            self._waiting.append(samples)
            if "az" in samples and self._begun is None:
                self._begun = float(samples["az"][0][0])
            if self._begun is None or self._seen.get("az", -np.inf) < self._begun + _GATHER_S:
                return
            self._settle()
            return
        self._base.add(samples)
        if self._seen.get("az", -np.inf) > self._worked + _PIECE_S:
            self._work()

    @classmethod
    def warm_up(cls, vehicle: Vehicle) -> None:
        """Run all of it once on a made-up flight: the very first run of an installation compiles."""
        time_s: Array = 0.02 * np.arange(300, dtype=np.float64)
        level = {"az": -vehicle.environment.gravity, "airspeed": 15.0, "air_density": SEA_LEVEL_DENSITY, "thrust": 1.0}
        names = (*_CORE, *_OPTIONAL, *_SPARSE, "thrust", *DEFLECTION_SIGNALS.values())
        live = cls(vehicle)
        for part in np.split(np.arange(time_s.size), 3):
            live.take({name: (time_s[part], np.full(part.size, level.get(name, 0.01))) for name in names})
            live.report()

    def report(self) -> LiveReport:
        """What is known now, by all samples that have come."""
        if self._base is not None:
            self._work()
        errors = self._refresh()
        coefficients = dict(self._unknown())
        squares = {}
        for axis, one in self._axes.items():
            if one.estimate is not None:
                for i, _ in enumerate(one.names):
                    value, std = self._corrected(axis, one, one.estimate, i, errors)
                    coefficients[one.names[i]] = judged(one.estimate, i, value, std)
            for name, value, std in zip(one.names, one.squares.values, one.squares.std, strict=True):
                if std < usual_size(name):
                    squares[name] = (float(value), float(std))
        ordered = {name: coefficients[name] for name in self._names if name in coefficients}
        told = {name: error for name, error in errors.items() if error.told}
        moving = {name: error for name, error in told.items() if not name.startswith(self._stuck.names or ("?",))}
        warnings = (*sensor_warnings(moving), *self._lost())
        return LiveReport(self.time_s, ordered, squares, told, tuple(self._changes), warnings)

    def _refresh(self) -> dict[str, SensorError]:
        """Estimates by all samples so far, and what the equations need of them; the sensors' errors."""
        self._refreshed = self.time_s
        errors = self._air.errors() if self._air.rows else {}
        for axis, one in self._axes.items():
            self._update(axis, one, errors)
        if self._equations is not None:
            self._equations.learn_jumps(self._settled)
        return errors

    def _settle(self) -> None:
        """Decide by the first seconds which signals this aircraft has, and so which axes can be estimated."""
        there = set(self._seen)
        missing = [name for name in _CORE if name not in there]
        moment_only = self._thrust.source(there) is None
        lateral = "beta" in there
        for name in self._names:
            term = parse_term(name)
            lost = [factor for factor in term.factors if factor in self._surfaces and factor not in there]
            if missing:
                self._refused[name] = (f"there is no {', '.join(missing)}", "")
            elif term.axis not in LONGITUDINAL_AXES and not lateral:
                self._refused[name] = ("there is no sideslip vane (beta)", "")
            elif term.axis in ("CL", "CD") and moment_only:
                self._refused[name] = ("thrust is neither measured nor told by [propulsion]", "")
            elif lost:
                self._refused[name] = (f"there is no {', '.join(lost)}: its servo's output does not come", "")
        if missing:
            # Once more a while later: a sensor may be switched on after the radio.
            self._begun = self._seen["az"]
            self._waiting.clear()
            return
        names = [name for name in self._names if name not in self._refused]
        thrust = self._thrust.source(there)
        needed = [*_CORE, *(name for name in _OPTIONAL if name in there)]
        needed += [name for name in (*self._surfaces, thrust or "") if name in there]
        self._base = TimeBase(list(dict.fromkeys(needed)), _HEIGHT)
        grouped = {axis: [parse_term(name) for name in names if name.startswith(f"{axis}_")] for axis in AXES}
        terms = {axis: chosen for axis, chosen in grouped.items() if chosen}
        self._equations = LiveEquations(self._vehicle, terms, self._thrust.moving_mass)
        for samples in self._waiting:
            self._base.add(samples)
        self._waiting.clear()
        self._work()

    def _make_axes(self, interval_s: float) -> None:
        assert self._equations is not None
        for axis, terms in self._equations.terms.items():
            names = tuple(term.name for term in terms)
            factors = tuple(term.factors for term in terms)
            noisy = [chosen[0] if len(chosen) == 1 and chosen[0] in self._noise else "" for chosen in factors]
            scales = np.array([usual_size(name) for name in names])
            self._axes[axis] = _Axis(
                names,
                factors,
                AxisEstimator(names, noisy, interval_s, BIASES.get(axis, ())),
                RecursiveLeastSquares(scales),
                ChangeDetector(axis, names),
            )
        self._decimator = Decimator(interval_s)

    def _work(self) -> None:
        assert self._base is not None
        assert self._equations is not None
        self._worked = self._seen["az"]
        for rows in self._stuck.moving(self._airborne.flown(self._base.rows())):
            rows = self._thrust.added(rows)
            if not self._axes:
                self._make_axes(rows.interval_s)
            self.time_s = float(rows.time_s[-1])
            self._watch_noise(rows)
            self._filter(rows)
            if self._air.rows:
                told = {name: error.value for name, error in self._air.errors().items() if error.told}
                self._equations.biases = told
            time_s, sides = self._equations.take(rows)
            if not rows.continues and self._decimator is not None:
                self._decimator.restart()
            if sides:
                self._add(time_s, sides)
            if self.time_s > self._refreshed + _REFRESH_S:
                self._refresh()

    def _add(self, time_s: Array, sides: Mapping[str, Array]) -> None:
        """Take equations of all axes."""
        assert self._decimator is not None
        for name, columns in sides.items():
            self._axes[name].estimator.add(columns)
        filtered, places = self._decimator.take(np.concatenate(list(sides.values()), axis=1))
        ends = np.cumsum([columns.shape[1] for columns in sides.values()])
        for name, rows in zip(sides, np.split(filtered, ends[:-1], axis=1), strict=True):
            axis = self._axes[name]
            X = rows[:, : len(axis.names)].copy()
            for i, factors in enumerate(axis.factors):
                if not factors:  # the constant's column is the weight, which is filtered as the others are
                    X[:, i] = rows[:, -2]
            axis.squares.add(X, np.ascontiguousarray(rows[:, -1]))
            for at, row in zip(time_s[places].tolist(), np.column_stack([X, rows[:, -2:]]), strict=True):
                axis.detector.add(at, row)

    def _filter(self, rows: Rows) -> None:
        """Wind and sensor errors, where attitude is known."""
        if not rows.continues:
            self._air.restart_motion()
        columns = rows.columns
        if any(name not in columns for name in ("phi", "theta", "psi")):
            return
        assert self._equations is not None
        known = {**self._equations.corrected(columns), **self._ground_velocity(rows)}
        unknown = np.full(rows.time_s.size, np.nan)
        table = np.column_stack([known.get(name, unknown) for name in ROW])
        self._air.take(table, rows.interval_s, self._known_noise())

    def _ground_velocity(self, rows: Rows) -> dict[str, Array]:
        """Samples that come seldom, each at the row nearest to it; NaN elsewhere. One far from any row is left out."""
        columns = {}
        for name, found in self._sparse.items():
            column = columns[name] = np.full(rows.time_s.size, np.nan)
            taken = 0
            for stamp, value in found:
                if stamp > rows.time_s[-1] + 0.5 * rows.interval_s:
                    break
                taken += 1
                place = min(int(np.searchsorted(rows.time_s, stamp - 0.5 * rows.interval_s)), column.size - 1)
                if stamp > rows.time_s[place] - 0.1:
                    column[place] = value
            del found[:taken]
        return columns

    def _watch_noise(self, rows: Rows) -> None:
        lengths = {"p": self._vehicle.geometry.b, "q": self._vehicle.geometry.c, "r": self._vehicle.geometry.b}
        for name, noise in self._noise.items():
            if name in rows.columns:
                values = rows.columns[name]
                if name in lengths:  # as the equations hold it
                    values = values * lengths[name] / (2.0 * np.maximum(rows.columns["airspeed"], 1.0))
                noise.take(values, continues=rows.continues)

    def _known_noise(self) -> dict[str, float]:
        return {name: one.variance for name, one in self._noise.items() if np.isfinite(one.variance)}

    def _update(self, axis: str, one: _Axis, errors: Mapping[str, SensorError]) -> None:
        # A scale of which the flight has said nothing counts as calibrated, as it does after the flight.
        biases = {name: (error.value, error.std) for name, error in errors.items() if error.told or "scale" not in name}
        one.estimate = one.estimator.estimate(self._known_noise(), biases)
        if one.estimate is None:
            return
        if axis in MOMENTS:
            values, std = one.estimate.values, one.estimate.std
            self._settled |= {n: float(v) for n, v, s in zip(one.names, values, std, strict=True) if s < 0.2 * abs(v)}
        change = one.detector.check(self.time_s, one.estimate.values, one.estimate.covariance)
        if change is not None:
            self._changes.append(change)
            one.estimator.restart()
            one.detector.restart()
            one.estimate = None

    def _corrected(
        self, axis: str, one: _Axis, estimate: Estimate, index: int, errors: Mapping[str, SensorError]
    ) -> tuple[float, float]:
        """A coefficient and its standard error, with what the live sensor errors make of it."""
        value, variance = float(estimate.values[index]), float(estimate.covariance[index, index])
        factors = one.factors[index]
        for vane in VANES:
            error = errors.get(f"{vane}_scale")
            if factors == (vane,) and error is not None and error.told:
                shared = self._shared_noise(vane)
                own = [max(one - shared, _LEAST_OWN * one) for one in (variance / value**2, error.std**2)]
                value *= 1.0 + error.value
                variance = sum(own) * value**2
        if not factors and errors:
            shift, doubt = self._bias_in_constant(axis, one, errors)
            value, variance = value + shift, variance + doubt
        return value, float(np.sqrt(max(variance, 0.0)))

    def _shared_noise(self, vane: str) -> float:
        """Variance of what the noise of a vane's samples adds to its scale and takes off its derivatives, relative.

        Noise e of an angle x adds sum(e x) / sum(x^2) to the scale by which the vane seems to read x, and takes as much
        off any coefficient of x, whatever else is fitted: in the product of both it is not there.
        """
        moved = self._air.moved(vane)
        return self._noise[vane].variance / moved if moved > 0.0 else 0.0

    def _bias_in_constant(self, axis: str, one: _Axis, errors: Mapping[str, SensorError]) -> tuple[float, float]:
        """What takes the vanes' biases off a constant, and the variance that their errors leave."""
        gains: dict[str, float] = {}
        assert one.estimate is not None
        for vane in VANES:
            if f"{axis}_{vane}" in one.names:
                gains[f"{vane}_bias"] = float(one.estimate.values[one.names.index(f"{axis}_{vane}")])
        shift = sum(gain * errors[name].value for name, gain in gains.items())
        doubt = sum((gain * errors[name].std) ** 2 for name, gain in gains.items())
        return shift, doubt

    def _unknown(self) -> dict[str, Coefficient]:
        """Every coefficient before anything is known of it."""
        found = {}
        for name in self._names:
            begun = "the flight has only begun" if self._airborne.flying else "the aircraft is not in the air"
            why, fly = self._refused.get(name, (begun, helpful_manoeuvre(name)))
            found[name] = Coefficient(name, np.nan, np.inf, False, why, fly)
        return found

    def _lost(self) -> list[str]:
        if self._base is None:
            return []
        missing = self._base.missing()
        told = [f"no {', '.join(missing)} for a second: nothing is identified meanwhile"] if missing else []
        told += [f"the {name} vane does not move: nothing is identified meanwhile" for name in self._stuck.names]
        alone = ", ".join(f"{name} ({count})" for name, count in self._base.left_out().items())
        return [*told, f"readings left out that no motion makes: {alone}"] if alone else told
