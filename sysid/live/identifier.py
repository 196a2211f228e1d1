"""Live identification: contract signals in as they come, what is known of the aircraft out at any time."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.controls import DEFLECTION_SIGNALS
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.equation_error.equations import MOMENTS
from sysid.live.bias_correction import corrected
from sysid.live.posterior_window import Runner, SlidingWindow
from sysid.live.recursive.axis_estimators import Axis, SlowSamples
from sysid.live.recursive.change_detection import Change
from sysid.live.recursive.coefficient_status import CoefficientStatus, judged
from sysid.live.recursive.equations import LiveEquations
from sysid.live.recursive.frequency_estimator import VANES
from sysid.live.signal_requirements import CORE, OPTIONAL, axes_of, refusals
from sysid.live.signals.air_data_ekf import AirDataError, AirFilter
from sysid.live.signals.air_data_imm import ROW
from sysid.live.signals.airborne import Airborne
from sysid.live.signals.low_rate_buffer import SparseSamples
from sysid.live.signals.noise_estimator import WhiteNoise
from sysid.live.signals.row_alignment import Rows, TimeBase
from sysid.live.signals.sensor_failures import READINGS, SensorFailure
from sysid.live.signals.stuck_readings import StuckReadings
from sysid.live.signals.thrust_source import LiveThrust
from sysid.live.watch import Watch
from sysid.live.wording import change_sentence, sensor_warnings
from sysid.posterior.estimates import NuisanceEstimate
from sysid.problem.model_structure import default_structure, helpful_manoeuvre

_HEIGHT = ("altitude",)  # distinguishes ground and flight, where there is one
_SPARSE = ("vn", "ve", "vd")
# How long signals gather before it is settled which of them this aircraft has.
_GATHER_S = 1.5
# A signal that has not come for so long is gone: what does not need it goes on without.
_LOST_S = 3.0
# What is kept of signals before there are rows, which may never be.
_KEPT_S = 2.0
# Rows are worked on when a report is asked for, at the latest after this time: many cost hardly more than one does.
_PIECE_S = 0.5
# Equations want the control derivatives that are known, whether or not anybody asks for a report.
_REFRESH_S = 1.0
# How often it is looked for changes, however often estimates are made.
_CHECK_S, _EARLY_S = 0.4, 0.03
_RATES = ("p", "q", "r")
_ACCELERATIONS = ("ax", "ay", "az")
# What arithmetic of numbers beyond all measure raises, numpy's errors of linear algebra among them.
_FAULTS = (ArithmeticError, ValueError)
# Surfaces that move by so much later or sooner than was thought: what was known with the other delay begins anew, s.
_OTHER_DELAY_S = 0.015
_FAILING_S = 3.0  # for which a sensor's failure stands without being seen again


@dataclass(frozen=True)
class LiveReport:
    """What is known at `time_s`. Dictionaries are by name.

    nuisances: what stands between aircraft and log, by the newest window. failures: sensors that have failed.
    """

    time_s: float
    coefficients: dict[str, CoefficientStatus]
    sensors: dict[str, AirDataError]
    changes: tuple[Change, ...]
    warnings: tuple[str, ...]
    nuisances: tuple[NuisanceEstimate, ...] = ()
    failures: tuple[SensorFailure, ...] = ()

    def sentences(self) -> list[str]:
        """Each change in words."""
        return [change_sentence(change) for change in self.changes]


class LiveIdentifier:
    """Coefficients of all six axes while samples come. vehicle: what is known before the flight.

    runner: what estimates the last half minute by the estimator of after the flight; those coefficients are reported
    then, and recursive ones only watch for changes. Without it the recursive ones are reported.
    """

    def __init__(self, vehicle: Vehicle, runner: Runner | None = None) -> None:
        self._vehicle = vehicle
        self._window = None if runner is None else SlidingWindow(vehicle, runner)
        # The window finds flow angles by kinematics where there is no vane.
        self._dispensable = frozenset(("alpha",) if runner is not None else ())
        surfaces = [DEFLECTION_SIGNALS[n] for n in vehicle.controls if n != "throttle" and n in DEFLECTION_SIGNALS]
        self._surfaces = (*surfaces, *vehicle.named_controls)
        self._names = default_structure(surfaces, vehicle.named_controls)
        self._thrust = LiveThrust(vehicle)
        self._base: TimeBase | None = None
        self._waiting = deque[Mapping[str, tuple[Array, Array]]]()
        self._seen: dict[str, float] = {}
        self._looked: float | None = None
        self._needed: list[str] = []
        self._refused: dict[str, tuple[str, str]] = {}
        # Axes that stand still, and why; what went wrong since the last report, by axis.
        self._standing: dict[str, str] = {}
        self._faults: dict[str, str] = {}
        self._broken = False
        self._axes: dict[str, Axis] = {}
        self._slow: SlowSamples | None = None
        self._equations: LiveEquations | None = None
        self._air = AirFilter(vehicle.environment.gravity)
        self._airborne = Airborne(vehicle)
        self._stuck = StuckReadings()
        bending = (*_RATES, *_ACCELERATIONS)
        self._noise = {name: WhiteNoise(name in bending) for name in (*VANES, "airspeed", *bending)}
        self._watch = Watch(vehicle)
        self._settled: dict[str, float] = {}
        # How long after their commands surfaces move, s, as far as the window knows it.
        self._delays: dict[str, float] = {}
        self._sparse = SparseSamples(_SPARSE)
        self._worked = self._refreshed = self._checked = -np.inf
        self.time_s = -np.inf

    def take(self, samples: Mapping[str, tuple[Array, Array]]) -> None:
        """Take samples as they come: signal -> stamps (s) and values (SI). Late and repeated ones are left out."""
        for name, (time_s, values) in samples.items():
            if not time_s.size:
                continue
            self._seen[name] = float(time_s[-1])
            self._watch.silent.note(name, time_s)
            self._sparse.add(name, time_s, values)
        self._watch.positions.take(samples)
        if self._window is not None:
            self._window.take(samples)
        if self._base is None:
            self._gather(samples)
            return
        self._base.add(self._as_obeyed(samples))
        now = self._seen["az"]
        if self._looked is not None and now > self._looked + _GATHER_S:
            self._settle()
        if now > self._worked + _PIECE_S:
            self._work()

    def _as_obeyed(self, samples: Mapping[str, tuple[Array, Array]]) -> Mapping[str, tuple[Array, Array]]:
        """Commands on the stamps at which surfaces obey them: the recursive equations know no servo."""
        found = dict(samples)
        for name, delay in self._delays.items():
            if name in found:
                time_s, values = found[name]
                found[name] = (time_s + delay, values)
        return found

    def _learn_delays(self) -> None:
        if self._window is None:
            return
        delays = self._window.command_delays()
        if delays and max(abs(delay - self._delays.get(name, 0.0)) for name, delay in delays.items()) > _OTHER_DELAY_S:
            self._delays = delays
            self._restart_axes()

    def _gather(self, samples: Mapping[str, tuple[Array, Array]]) -> None:
        """Keep the newest of what comes until it is settled which signals there are, which it may never be."""
        self._waiting.append(samples)
        newest = max(self._seen.values(), default=-np.inf)
        while max((t[-1] for t, _ in self._waiting[0].values() if t.size), default=-np.inf) < newest - _KEPT_S:
            self._waiting.popleft()
        if self._looked is None and "az" in self._seen:
            self._looked = float(samples["az"][0][0])
        if self._looked is not None and self._seen["az"] >= self._looked + _GATHER_S:
            self._settle()

    @property
    def has_news(self) -> bool:
        """Whether the runner has done what the next report will hold."""
        return self._window is not None and self._window.done

    def finish(self) -> None:
        """Nothing comes any more: have the runner estimate the last that is in no estimate yet."""
        if self._window is not None:
            self._window.finish()

    @property
    def cost_elsewhere_s(self) -> float:
        """CPU that the runner's estimates took, s."""
        return 0.0 if self._window is None else self._window.cost_s

    @classmethod
    def warm_up(cls, vehicle: Vehicle) -> None:
        """Run all of it once on a made-up flight: the very first run of an installation compiles."""
        time_s: Array = 0.02 * np.arange(600, dtype=np.float64)  # beyond a whole window of the transform
        level = {"az": -vehicle.environment.gravity, "airspeed": 15.0, "air_density": SEA_LEVEL_DENSITY, "thrust": 1.0}
        names = (*CORE, *OPTIONAL, *_SPARSE, "thrust", *DEFLECTION_SIGNALS.values(), *vehicle.named_controls)
        live = cls(vehicle)
        for part in np.split(np.arange(time_s.size), 3):
            live.take({name: (time_s[part], np.full(part.size, level.get(name, 0.01))) for name in names})
            live.report()

    def update(self) -> dict[str, tuple[float, float]]:
        """Estimates by all samples that have come: value and standard error of each coefficient, without a word."""
        if self._base is not None:
            self._work()
        if self._window is None:
            return self._values(self._refresh())
        return {name: (one.value, one.std) for name, one in self._window.statuses().items() if isfinite(one.std)}

    def report(self) -> LiveReport:
        """What is known now, by all samples that have come."""
        if self._base is not None:
            self._work()
        if "az" in self._seen:
            self._watch.hear(self._seen["az"])
        errors = self._refresh()
        self._hand_on()
        if self._stuck.failed and isfinite(self.time_s):
            self._judge()  # without rows nothing else asks
        statuses = self._judged(errors) if self._window is None else self._window.statuses()
        coefficients = {**self._unknown(), **statuses}
        ordered = {name: coefficients[name] for name in self._names if name in coefficients}
        sensors = {name: error for name, error in errors.items() if error.observed}
        nuisances: tuple[NuisanceEstimate, ...] = ()
        problem: tuple[str, ...] = ()
        if self._window is not None:
            # Scales are what gusts and vanes that swing make the filter see.
            sensors = {name: error for name, error in sensors.items() if not name.endswith("_scale")}
            sensors |= self._window.sensors()
            if (found := self._window.found) is not None:
                nuisances, problem = found.nuisances, (found.problem,) if found.problem else ()
        moving = {name: error for name, error in sensors.items() if not name.startswith(self._stuck.names or ("?",))}
        warnings = (*sensor_warnings(moving), *self._lost(), *self._faults.values(), *problem)
        self._faults.clear()
        return LiveReport(
            self.time_s, ordered, sensors, tuple(self._watch.changes), warnings, nuisances, tuple(self._watch.failures)
        )

    def _judged(self, errors: Mapping[str, AirDataError]) -> dict[str, CoefficientStatus]:
        """What the recursive regression knows of each coefficient."""
        values = self._values(errors)
        return {
            name: judged(one.estimate, i, *values[name])
            for one in self._axes.values()
            for i, name in enumerate(one.names)
            if one.estimate is not None and name in values
        }

    def _values(self, errors: Mapping[str, AirDataError]) -> dict[str, tuple[float, float]]:
        """Value and standard error of each coefficient, with what the sensors' errors make of them."""
        found: dict[str, tuple[float, float]] = {}
        moved = {vane: self._air.moved(vane) for vane in VANES}
        shared = {vane: self._noise[vane].variance / m if m > 0.0 else 0.0 for vane, m in moved.items()}
        for axis, one in list(self._axes.items()):
            if one.estimate is None:
                continue
            try:
                unbiased = corrected(axis, one.factors, one.estimate, errors, shared)
            except _FAULTS as error:
                self._fault(axis, one, error)
                continue
            found |= zip(one.names, unbiased, strict=True)
        return found

    def _refresh(self) -> dict[str, AirDataError]:
        """Estimates by all samples so far, and what the equations need of them; the sensors' errors."""
        self._refreshed = self.time_s
        errors = self._air.errors() if self._air.rows else {}
        if not all(isfinite(error.value) for error in errors.values()):
            self._air, errors = AirFilter(self._vehicle.environment.gravity), {}
            self._faults["air"] = "wind and sensor errors begin anew: a measurement was beyond all measure"
        checked = self.time_s > self._checked + _CHECK_S - _EARLY_S
        if checked:
            self._hand_on()
            self._judge()
        for axis, one in list(self._axes.items()):
            if axis in self._standing:
                continue
            try:
                self._update(axis, one, errors, checked=checked)
                one.failing = np.nan
            except _FAULTS as error:
                self._fault(axis, one, error)
        if checked:
            self._checked = self.time_s
        if self._equations is not None:
            self._equations.learn_jumps(self._settled)
        return errors

    def _judge(self) -> None:
        """Judge sensors, and what has changed beside them; what fails in it is left out."""
        detectors = {axis: one.detector for axis, one in self._axes.items()}
        try:
            news = self._watch.judge(self.time_s, self._stuck.failed, detectors)
        except _FAULTS as error:
            self._watch.begin_anew()
            self._faults["sensors"] = f"what watches the sensors begins anew: {_in_words(error)}"
            return
        if news.changed_s is not None:
            self._begin_anew(news.changed_s)
        elif news.failed_s is not None:
            if self._window is not None:
                self._window.leave_out_before(news.failed_s)
            self._restart_axes()

    def _begin_anew(self, time_s: float) -> None:
        """What was before counts no more, in any axis."""
        if self._window is not None:
            self._window.begin_anew(time_s)
        self._restart_axes()

    def _restart_axes(self) -> None:
        for one in self._axes.values():
            one.estimator.restart()
            one.detector.restart()
            one.estimate = None

    def _fault(self, axis: str, one: Axis, error: Exception) -> None:
        """An axis whose arithmetic fails is left out of one report; where it goes on failing it begins anew."""
        one.estimate = None
        self._faults[axis] = f"{axis} is left out once: {_in_words(error)}"
        if np.isnan(one.failing):
            one.failing = self.time_s
        elif self.time_s > one.failing + _FAILING_S:
            del self._axes[axis]
            self._faults[axis] = f"{axis} begins anew: {_in_words(error)}"

    def _settle(self) -> None:
        """Decide by what has come lately which signals this aircraft has, and so which axes can be estimated."""
        if self._base is not None:
            self._work()
        now = self._looked = self._seen["az"]
        there = {name for name, at in self._seen.items() if name in CORE or at > now - _LOST_S}
        thrust = self._thrust.source(there)
        self._refused = refusals(self._names, self._surfaces, there, thrust)
        if self._vehicle.motors:
            # The regression knows no arms and no torques; the window does.
            why = ("what several motors do is known to the estimate of the last half minute alone", "")
            self._refused |= {name: why for name in self._names if not name.startswith("CY")}
        if not there >= set(CORE) - self._dispensable:
            return  # once more a while later: a sensor may be switched on after the radio
        needed = [*CORE, *OPTIONAL, *self._surfaces, *self._thrust.signals]
        needed = [name for name in dict.fromkeys(needed) if name in there]
        if needed == self._needed:
            return
        self._needed = needed
        known = {axis: one.names for axis, one in self._axes.items()}
        terms, self._standing = axes_of(self._names, self._refused, known)
        if self._base is not None and self._equations is not None:
            self._hand_on(ends=True)
            self._base.need(needed)
            self._equations.follow(terms, self._thrust.moving_mass)
            for axis, names in known.items():
                if axis in terms and len(terms[axis]) > len(names):
                    del self._axes[axis]
                elif axis in self._standing:
                    self._axes[axis].detector.restart()
            return
        self._base = TimeBase(needed, _HEIGHT, self._vehicle.named_controls)
        self._equations = LiveEquations(self._vehicle, terms, self._thrust.moving_mass)
        for samples in self._waiting:
            self._base.add(samples)
        self._waiting.clear()
        self._work()

    def _hand_on(self, *, ends: bool = False) -> None:
        """Give the slower estimators what waits for them. ends: what comes next does not continue it."""
        if self._slow is None:
            return
        try:
            self._slow.hand_on(self._axes)
        except _FAULTS as error:
            self._slow = self._slow.anew()
            self._faults["slow"] = f"samples are left out of what watches for changes: {_in_words(error)}"
        if ends:
            self._slow.restart()

    def _make_axes(self, interval_s: float) -> None:
        assert self._equations is not None
        self._hand_on()
        for axis, terms in self._equations.terms.items():
            if axis not in self._axes:
                self._axes[axis] = Axis.of(axis, terms, tuple(self._noise), interval_s)
        self._slow = SlowSamples(interval_s)

    def _work(self) -> None:
        assert self._base is not None
        assert self._equations is not None
        self._worked = self._seen["az"]
        for rows in self._stuck.moving(self._airborne.flown(self._base.rows())):
            if self._window is not None:
                self._window.flown(float(rows.time_s[0]), float(rows.time_s[-1]))
            rows = replace(rows, continues=False) if self._broken else rows
            self._broken = False
            self.time_s = float(rows.time_s[-1])
            if not self._equations.terms:
                continue
            try:
                self._take_rows(self._thrust.added(rows))
            except _FAULTS as error:
                self._broken = True
                self._faults["rows"] = f"{rows.time_s.size} samples are left out: {_in_words(error)}"
            if self.time_s > self._refreshed + _REFRESH_S:
                self._refresh()
        if self._window is not None:
            self._window.work()
            self._learn_delays()

    def _take_rows(self, rows: Rows) -> None:
        """Take a run of rows, or more of one, into all that is estimated."""
        assert self._equations is not None
        if self._equations.terms.keys() - self._axes.keys():
            self._make_axes(rows.interval_s)
            rows = replace(rows, continues=False)
        self._watch_noise(rows)
        self._watch.silent.take(rows)
        self._filter(rows)
        if self._air.rows:
            known = {name: error.value for name, error in self._air.errors().items() if error.observed}
            self._equations.biases = known
        sides = self._equations.take(rows)
        if not rows.continues:
            self._hand_on(ends=True)
        if sides is None or self._slow is None:
            return
        for name, place in sides.places.items():
            self._axes[name].estimator.add(sides.table[:, place])
        self._slow.add(sides)

    def _filter(self, rows: Rows) -> None:
        """Wind and sensor errors, where attitude is known."""
        if not rows.continues:
            self._air.restart_motion()
            self._watch.sensors.restart()
        columns, ground = rows.columns, self._sparse.at(rows)
        if any(name not in columns for name in ("phi", "theta", "psi")):
            return
        assert self._equations is not None
        known = {**self._equations.corrected(columns), **ground}
        unknown = np.full(rows.time_s.size, np.nan)
        table = np.column_stack([known.get(name, unknown) for name in ROW])
        self._air.take(table, rows.interval_s, self._known_noise())
        self._watch.sensors.take(rows.time_s, known, rows.interval_s)

    def _watch_noise(self, rows: Rows) -> None:
        lengths = {"p": self._vehicle.geometry.b, "q": self._vehicle.geometry.c, "r": self._vehicle.geometry.b}
        for name, noise in self._noise.items():
            if name in rows.columns:
                values = rows.columns[name]
                if name in lengths:  # as the equations hold it
                    values = values * lengths[name] / (2.0 * np.maximum(rows.columns["airspeed"], 1.0))
                noise.take(values, continues=rows.continues)

    def _known_noise(self) -> dict[str, float]:
        return {name: one.variance for name, one in self._noise.items() if isfinite(one.variance)}

    def _update(self, axis: str, one: Axis, errors: Mapping[str, AirDataError], *, checked: bool) -> None:
        # A scale on which the flight holds no information counts as calibrated, as it does after the flight.
        biases = {
            name: (error.value, error.std) for name, error in errors.items() if error.observed or "scale" not in name
        }
        known = self._known_noise()
        one.estimate = one.estimator.estimate(known, biases)
        if one.estimate is None:
            return
        if axis in MOMENTS:
            values, std = one.estimate.values, one.estimate.std
            self._settled |= {n: float(v) for n, v, s in zip(one.names, values, std, strict=True) if s < 0.2 * abs(v)}
        if not checked:
            return
        left = self._slow.white_noise_left if self._slow is not None else 1.0
        noise = np.array([left * known.get(name, 0.0) for name in one.estimator.noisy])
        detectors = {axis: one.detector for axis, one in self._axes.items()}
        change = one.detector.check(self.time_s, one.estimate.values, one.estimate.covariance, noise)
        if change is not None and self._watch.notice(self.time_s, change, detectors):
            self._begin_anew(change.time_s)

    def _unknown(self) -> dict[str, CoefficientStatus]:
        """Every coefficient before anything is known of it."""
        found = {}
        for name in self._names:
            begun = "the flight has only begun" if self._airborne.flying else "the aircraft is not in the air"
            if self._airborne.flying and self._window is not None:
                begun = f"the first estimate comes after {self._window.first_s:.0f} s of flight, or after a change"
                if self._window.under_way:
                    begun = "the first estimate is being made: seconds, a minute where it is this machine's first"
                return {
                    name: CoefficientStatus(name, np.nan, np.inf, False, begun, helpful_manoeuvre(name))
                    for name in self._names
                }
            why, fly = self._refused.get(name, (begun, helpful_manoeuvre(name)))
            found[name] = CoefficientStatus(name, np.nan, np.inf, False, why, fly)
        return found

    def _lost(self) -> list[str]:
        if self._base is None:
            return []
        missing = self._base.missing()
        lines = [f"no {', '.join(missing)} for a second: nothing is identified meanwhile"] if missing else []
        lines += [f"{READINGS[name]} does not move: nothing is identified meanwhile" for name in self._stuck.names]
        alone = ", ".join(f"{name} ({count})" for name, count in self._base.left_out().items())
        lines += [f"{why}: {axis} stands still" for axis, why in self._standing.items()]
        return [*lines, f"readings left out that no motion makes: {alone}"] if alone else lines


def _in_words(error: Exception) -> str:
    return " ".join(f"its arithmetic failed ({type(error).__name__}: {error})".split())
