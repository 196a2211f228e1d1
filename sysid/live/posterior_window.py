"""The coefficients reported in flight, by the estimator of after the flight (sysid.posterior) on the last 25 s.

A window takes a second of work, so it is estimated elsewhere: the caller hands in what runs it, and asks again later.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from math import hypot, sqrt
from types import MappingProxyType
from typing import Protocol

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import SysidError
from sysid.identification.posterior_method import flown, refusals_of, thrust_known
from sysid.identification.repaired_flight import prepared_flight, without_dead
from sysid.live.recursive.coefficient_status import CoefficientStatus
from sysid.live.signals.air_data_ekf import AirDataError
from sysid.posterior.analysis import estimate, excited
from sysid.posterior.closed_loop import SHORTEST_LOOP_S
from sysid.posterior.estimates import NuisanceEstimate, PosteriorEstimate
from sysid.posterior.flight_part import FlightPart, make_part
from sysid.posterior.nuisance_priors import GROUPS, SURFACES_OF
from sysid.problem.model_structure import (
    REFUSED_SHARE,
    default_structure,
    helpful_manoeuvre,
    is_longitudinal,
    usual_size,
)
from sysid.signals.flight import FlightSignals, Signal, moved_controls
from sysid.signals.record import SURFACES

WINDOW_S = 25.0  # that an estimate looks back over
# The first estimate comes after so much flight; later ones as often as their cost allows, at most so often.
FIRST_S, EVERY_S = 8.0, 4.0
# Without its vane the angle of attack follows from what gusts and the attitude's errors leave of the kinematics.
FIRST_WITHOUT_ALPHA_S = 20.0
# A window so long shows whether an autopilot answers gusts, its ends cut.
_JUDGED_S = SHORTEST_LOOP_S + 0.5
# Share of one core that estimates may take.
_SHARE = 0.06
# Commands count from so long before the window on; the newest samples of slow sensors may still be on their way.
_BEFORE_S, _UNDER_WAY_S = 1.5, 0.15
# Without flight for so long the next flight is another; what it ends with is estimated once more, if it is so much.
_AWAY_S, _LAST_S = 3.0, 1.0
_ANGLES = ("alpha", "beta")
_FEWEST = 10  # samples of a signal
# Nuisances that are scale errors of sensors: what they are without an error, and what the error is called.
_NULL = {"alpha_scale": 1.0, "beta_scale": 1.0, "airspeed_error": 0.0}
# Times as uncertain as the servos were known, up to which a newer window's word of them counts.
_AS_SURE = 2.0
# Standard errors of a window and of what was known, beyond which the two are not of one aircraft.
_AGREES = 4.0
_SCALE = {"alpha_scale": "alpha_scale", "beta_scale": "beta_scale", "airspeed_error": "airspeed_scale"}

Columns = Mapping[str, tuple[Array, Array]]


class Runner(Protocol):
    """Runs a function elsewhere, as executors do."""

    def submit(self, function: Callable[..., WindowEstimate], /, *arguments: object) -> Future[WindowEstimate]:
        """The promise of its result."""


@dataclass(frozen=True)
class WindowEstimate:
    """The estimate of a window. begin_s, end_s: of the window. cost_s: CPU. problem: why there is nothing, else "".

    coefficients: those estimated, and why others are not known. nuisances: what stands between aircraft and log.
    ends: group of axes -> unknown -> its value. late: group -> by how much its surfaces follow their commands late, s,
    and its standard error. again_s: length of a window that is worth it at once, s.
    """

    begin_s: float
    end_s: float
    cost_s: float
    coefficients: Mapping[str, CoefficientStatus]
    nuisances: tuple[NuisanceEstimate, ...] = ()
    problem: str = ""
    ends: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    again_s: float = np.inf
    late: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def estimate_window(
    vehicle: Vehicle,
    signals: Columns,
    begin_s: float,
    end_s: float,
    near: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
) -> WindowEstimate:
    """Estimate from `begin_s` to `end_s`. signals: stamps (s) and values (SI) of each. near: `ends` of the last one."""
    began = time.process_time()
    flight = FlightSignals("live", {name: Signal(t, v, "", "") for name, (t, v) in signals.items()})
    named = moved_controls(vehicle.named_controls, ({name: values for name, (_, values) in signals.items()},))
    names = default_structure([name for name in SURFACES if name in signals], named)
    structure = Model(vehicle.name, {name: Coefficient(0.0) for name in names})
    try:
        parts = _parts(flight, vehicle, begin_s, end_s)
        if not excited(parts):
            why = f"no surface has moved from {begin_s:.0f} to {end_s:.0f} s"
            return WindowEstimate(begin_s, end_s, time.process_time() - began, _unknown(names, why))
        found = estimate(parts, vehicle, structure, systematic=False, near=near, fine=False)
    except SysidError as error:
        return WindowEstimate(begin_s, end_s, time.process_time() - began, {}, problem=str(error))
    if why := _too_short(found, end_s - begin_s):
        cost_s = time.process_time() - began
        return WindowEstimate(
            begin_s, end_s, cost_s, _unknown(names, why), ends=_ends(found), again_s=_JUDGED_S
        )  # fmt: skip
    known = thrust_known(parts, vehicle)
    refused = {one.name: one for one in refusals_of(found, structure, known)}
    std = np.sqrt(np.diag(found.joint.covariance))
    values = dict(zip(found.joint.names, zip(found.joint.mean.tolist(), std.tolist(), strict=True), strict=True))
    statuses = {}
    for name in names:
        value, spread = values.get(name, (np.nan, np.inf))
        reason = refused.get(name)
        if reason is not None and spread <= REFUSED_SHARE * max(abs(value), usual_size(name)):
            value, spread = np.nan, np.inf  # refused for what no bar shows: no number stands for it
        words = ("", "") if reason is None else (reason.reason, reason.manoeuvre)
        statuses[name] = CoefficientStatus(name, value, spread, reason is None, *words)
    return WindowEstimate(begin_s, end_s, time.process_time() - began, statuses, found.nuisances, "", _ends(found),
                          late=found.lateness())  # fmt: skip


def _ends(found: PosteriorEstimate) -> dict[str, dict[str, float]]:
    return {g: dict(zip(one.names, one.theta.tolist(), strict=True)) for g, one in found.results.items()}


def _too_short(found: PosteriorEstimate, length_s: float) -> str:
    """Why a window is too short to count, "" where it is not: in gusts that an autopilot may answer the aircraft cannot
    be distinguished from what flies it before there is enough to see whether one does.
    """
    if length_s >= _JUDGED_S or not any(one.unclear for one in found.results.values()):
        return ""
    return f"in gusts {length_s:.0f} s are too short to see whether an autopilot answers them"


def warm_up(vehicle: Vehicle) -> None:
    """Estimate a made-up window, so that the first of a flight does not wait for imports and compilation."""
    time_s: Array = 0.02 * np.arange(600, dtype=np.float64)
    noise = np.random.default_rng(0)
    level = {"az": -vehicle.environment.gravity, "airspeed": 15.0, "air_density": SEA_LEVEL_DENSITY, "thrust": 1.0}
    names = ("ax", "ay", "az", "p", "q", "r", "phi", "theta", "psi", "alpha", "beta", "airspeed", "air_density")
    columns = {}
    for k, name in enumerate((*names, "thrust", *SURFACES, *vehicle.named_controls)):
        swing = 0.05 * np.sin((3.0 + 0.3 * k) * time_s) + 0.002 * noise.standard_normal(time_s.size)
        columns[name] = (time_s, level.get(name, 0.0) + swing)
    estimate_window(vehicle, columns, 1.5, 11.5)


def _unknown(names: Iterable[str], why: str) -> dict[str, CoefficientStatus]:
    return {name: CoefficientStatus(name, np.nan, np.inf, False, why, helpful_manoeuvre(name)) for name in names}


def _parts(flight: FlightSignals, vehicle: Vehicle, begin_s: float, end_s: float) -> Sequence[FlightPart]:
    """The window as the estimator takes it; what kinematics say of flow angles without a vane beside it."""
    vanes = [name for name in _ANGLES if name in flight.signals and _goes_on(flight.signals[name].time_s, end_s)]
    if len(vanes) == len(_ANGLES):
        return [make_part(flight, vehicle, begin_s, end_s)]
    there = {name: one for name, one in flight.signals.items() if name not in _ANGLES or name in vanes}
    flight = replace(flight, signals=there)
    return flown([prepared_flight(without_dead(flight), vehicle, begin_s, end_s)], vehicle).parts


def _goes_on(stamps: Array, end_s: float) -> bool:
    return stamps.size >= _FEWEST and float(stamps[-1]) > end_s - _AWAY_S


class SlidingWindow:
    """Keeps the newest signals, has them estimated, and holds what came out. runner: runs `estimate_window`."""

    def __init__(self, vehicle: Vehicle, runner: Runner) -> None:
        self._vehicle, self._runner = vehicle, runner
        self._kept: dict[str, deque[tuple[Array, Array]]] = {}
        self._begin = self._end = self._asked = self._newest = -np.inf
        self._running: Future[WindowEstimate] | None = None
        self._known: dict[str, tuple[float, CoefficientStatus]] = {}
        self._of_servos: dict[str, tuple[float, float]] = {}
        self.found: WindowEstimate | None = None
        # CPU that was spent elsewhere, s.
        self.cost_s = 0.0

    def take(self, samples: Columns) -> None:
        """Take samples as they come; late and repeated ones are left out."""
        for name, (stamps, values) in samples.items():
            kept = self._kept.setdefault(name, deque())
            last = kept[-1][0][-1] if kept else -np.inf
            good = np.isfinite(stamps) & np.isfinite(values) & (stamps > last)
            if good.any():
                kept.append((stamps[good], values[good]))
                self._newest = max(self._newest, float(stamps[good][-1]))
                while kept[0][0][-1] < stamps[good][-1] - WINDOW_S - _BEFORE_S:
                    kept.popleft()

    def flown(self, begin_s: float, end_s: float) -> None:
        """Rows of flight have come."""
        if begin_s > self._end + _AWAY_S:
            self._begin = begin_s
        self._end = end_s

    def leave_out_before(self, time_s: float) -> None:
        """What came before is not to be estimated with what comes; what is known stays."""
        self._begin = max(self._begin, time_s)

    def begin_anew(self, time_s: float) -> None:
        """The aircraft has changed: what was before counts no more."""
        self.leave_out_before(time_s)
        self._known.clear()
        self._of_servos.clear()
        self.found = None

    def work(self) -> None:
        """Take an estimate that is done, ask for another where one is due."""
        self._collect()
        cost = self.found.cost_s if self.found is not None else 0.0
        landed = self._newest > self._end + _AWAY_S
        self._ask(_LAST_S if landed else max(EVERY_S, cost / _SHARE))
        self._collect()

    def finish(self) -> None:
        """Nothing comes any more: ask for an estimate of the last that is in none yet."""
        self._ask(_LAST_S)

    def _ask(self, after_s: float) -> None:
        """Ask for an estimate if the last one ended so long before what there is now."""
        end = self._end - _UNDER_WAY_S
        begin = max(self._begin, end - WINDOW_S)
        again = self.found is not None and end - begin >= self.found.again_s
        if self._running is None and end - begin >= self.first_s and (again or end >= self._asked + after_s):
            self._asked = end
            near = {} if self.found is None else self.found.ends
            self._running = self._runner.submit(estimate_window, self._vehicle, self._cut(begin, end), begin, end, near)

    def _collect(self) -> None:
        if self._running is not None and self._running.done():
            self._accept(self._running)
            self._running = None

    @property
    def done(self) -> bool:
        """Whether an estimate is done that `work` has not taken yet."""
        return self._running is not None and self._running.done()

    @property
    def under_way(self) -> bool:
        """Whether an estimate is being made."""
        return self._running is not None

    @property
    def first_s(self) -> float:
        """So much flight a first estimate takes."""
        alpha = self._kept.get("alpha")
        return FIRST_S if alpha and alpha[-1][0][-1] > self._end - _AWAY_S else FIRST_WITHOUT_ALPHA_S

    def statuses(self) -> dict[str, CoefficientStatus]:
        """What is known of each coefficient now; nothing before the first estimate."""
        if self.found is None:
            return {}
        return {name: self._status(name, one) for name, one in self.found.coefficients.items()}

    def sensors(self) -> dict[str, AirDataError]:
        """Scale errors of the air data, on which the newest window holds information."""
        every = () if self.found is None else self.found.nuisances
        errors = {one.name: (one.value - _NULL[one.name], one.std, one.prior_std) for one in every if one.name in _NULL}
        found = {_SCALE[name]: AirDataError(*error, "1") for name, error in errors.items()}
        return {name: error for name, error in found.items() if error.observed}

    def command_delays(self) -> dict[str, float]:
        """By surface, how long after its command it moves, s: delay and lag of the servo, and what stamps are late by.
        Nothing before the first estimate.

        A window that lies across a change of the aircraft is neither's: it says nothing of servos.
        """
        return {surface: late for group, (late, _) in self._of_servos.items() for surface in SURFACES_OF[group]}

    def _accept(self, done: Future[WindowEstimate]) -> None:
        try:
            found = done.result()
        except Exception as error:  # whatever a window makes of arithmetic, what is reported beside it goes on
            words = f"the estimate was lost ({type(error).__name__}: {error})"
            found = WindowEstimate(self._begin, self._asked, 0.0, {}, problem=" ".join(words.split()))
        self.cost_s += found.cost_s
        if found.begin_s < self._begin:
            return  # it began before what has changed since
        if found.problem and self.found is not None:
            statuses = _unknown(self.found.coefficients, found.problem)
            found = replace(
                self.found, problem=found.problem, cost_s=found.cost_s, coefficients=statuses, again_s=np.inf
            )
        found = replace(
            found, coefficients={name: self._doubted(name, one) for name, one in found.coefficients.items()}
        )
        self.found = found
        for group in SURFACES_OF:
            own = found.late.get(group)
            if own is not None and self._is_as_before(group, found.coefficients) and self._is_as_sure(group, own[1]):
                self._of_servos[group] = own
        self._known |= {name: (found.end_s, one) for name, one in found.coefficients.items() if one.known}

    def _is_as_sure(self, group: str, std: float) -> bool:
        """Whether a window knows about as well as one before how late the surfaces follow.

        One that lies across a change may be right in what it still knows, and explain the change by servos.
        """
        return group not in self._of_servos or std <= _AS_SURE * self._of_servos[group][1]

    def _doubted(self, name: str, one: CoefficientStatus) -> CoefficientStatus:
        """An estimate, not known where it contradicts what was known and no change has been found.

        A window in which an autopilot moves the surfaces, or one of two rests, can be wrong by far more than its bars.
        """
        if not one.known or name not in self._known:
            return one
        before = self._aged(name)
        if abs(one.value - before.value) <= _AGREES * hypot(one.std, before.std):
            return one
        why = f"a window says {one.value:.3g} ± {one.std:.2g}, which contradicts that, and no change has been seen"
        return CoefficientStatus(name, one.value, one.std, False, why)

    def _aged(self, name: str) -> CoefficientStatus:
        """What was known, by now: what is not looked at may change, by as much as it was known to, once in a window."""
        at, before = self._known[name]
        return replace(before, std=before.std * sqrt(1.0 + max(self._end - at, 0.0) / WINDOW_S))

    def _is_as_before(self, group: str, now: Mapping[str, CoefficientStatus]) -> bool:
        """Whether what was known of a group of axes and is known again is the same; something must be."""
        before = {name: one for name, (_, one) in self._known.items() if is_longitudinal(name) is (group == GROUPS[0])}
        both = {name: one for name, one in before.items() if name in now and now[name].known}
        return bool(both) == bool(before) and all(
            abs(now[name].value - one.value) <= _AGREES * hypot(now[name].std, one.std) for name, one in both.items()
        )

    def _status(self, name: str, one: CoefficientStatus) -> CoefficientStatus:
        if one.known or name not in self._known:
            return one
        at, before = self._known[name]
        std = self._aged(name).std
        why = f"last known at {at:.0f} s as {before.value:.3g} ± {before.std:.2g}: since then {one.why}"
        # It has been flown: to ask for it again would keep who flies from what was never seen.
        return CoefficientStatus(name, before.value, std, False, why)

    def _cut(self, begin: float, end: float) -> dict[str, tuple[Array, Array]]:
        cut = {}
        for name, kept in self._kept.items():
            stamps = np.concatenate([t for t, _ in kept])
            inside = (stamps >= begin - _BEFORE_S) & (stamps <= end + _UNDER_WAY_S)
            if inside.any():
                cut[name] = (stamps[inside], np.concatenate([v for _, v in kept])[inside])
        return cut
