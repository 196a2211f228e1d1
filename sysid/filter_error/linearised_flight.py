"""A flight as the filter-error method sees it: linearised along a path, filtered in turbulence.

The path is where the filter itself runs: predictions before and states after each sample. It moves with every estimate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from sim_vehicle.effects import EFFECTS, Remembers, slot
from sim_vehicle.physics.actuation import count_named
from sim_vehicle.physics.simulation import effects_flown, split_delay_ticks, undo_hysteresis
from sim_vehicle.vehicle.packed_model import PackedModel
from sysid.arrays import Array, IntArray
from sysid.filter_error.augmented_states import (
    HiddenInput,
    Memory,
    System,
    fill_memory,
    fill_unseen,
    lags,
    remember,
    unseen,
)
from sysid.filter_error.delayed_outputs import (
    beyond_end,
    delay_measurements,
    delay_prediction,
    missing_likelihood,
    select_delayed,
)
from sysid.filter_error.gust_states import motion_and_gusts
from sysid.filter_error.jacobians import STATE_COLUMNS, THRUST_COLUMN, path_slopes
from sysid.filter_error.kalman import kalman_pass
from sysid.filter_error.linearisation_path import Path, apart
from sysid.filter_error.motor_on_load_cell import at_the_centre, misreads
from sysid.filter_error.prediction import predict_path, run_actuators
from sysid.numerics.dryden import Turbulence, gust_system
from sysid.numerics.parallel import side_by_side
from sysid.numerics.smoothing import noise_sigma
from sysid.problem.free_parameters import THRUST_ERROR
from sysid.problem.predictor import Predictor, error_gains, sensor_derivative, with_placed_errors
from sysid.signals.record import (
    OUTPUT_PLACES,
    OUTPUTS,
    Record,
    angle_wrap,
    effects_at,
    height_for,
    held_by_dead_band,
    with_other_inputs,
)

# Standard deviations of what is known of the start: a reconstruction from noisy sensors is far better than this.
_START = np.array([3.0, 3.0, 3.0, 1.0, 1.0, 1.0, 0.3, 0.3, 0.3])
# Least noise of an output, m/s, below which one without noise would be trusted without end.
_FLOOR = {"airspeed": 1e-3, "vn": 0.02, "ve": 0.02, "vd": 0.02}
_LOWEST_NOISE = 1e-5
# Effects with a memory that the filter's state does not hold.
_LAGGING = [slot(name) for name, effect in EFFECTS.items() if effect.memory is Remembers.LAG]
# All that says which sensors are late, and by how much.
_LATENESS = [slot("sensor_time_skew"), *(slot("sensor_time_skew", name) for name in ("delay", "group"))]
_AX = OUTPUTS.index("ax")
_SURFACE_STEP = 1e-3  # rad, small beside what bends an aircraft's motion over a sample
_GPS_NOISE = 0.1  # m/s; too few samples to read it off them


@dataclass(frozen=True)
class LinearisedRecord:
    """A record linearised about its path; gusts still as body-axis velocities, scaled in by `_pass`."""

    drift: Array  # (N - 1, nf)
    step_x: Array  # (N - 1, nf, nf + na)
    step_theta: Array  # (N - 1, nf, P)
    left: Array  # (N, m) of the used outputs
    read_x: Array  # (N, m, nf + na)
    read_theta: Array  # (N, m, P)
    unseen: tuple[HiddenInput, ...]  # L of them
    step_unseen: Array  # (N - 1, nf, L)
    read_unseen: Array  # (N, m, L)
    surface_noise: Array  # (N - 1, nf, 3) of each step, by what is not known of the surfaces over it, or (N - 1, nf, 0)
    memory: Memory | None  # of sensors that lag
    unread: IntArray  # (m,) readings that come after the record's end


@dataclass(frozen=True)
class Pass:
    """Sums over all records of one filter pass; per record innovations, their variances and slopes, and deviations of
    the filter from the path before and after each sample, with their slopes.
    """

    likelihood: float
    information: Array
    gradient: Array
    innovations: list[Array]
    variances: list[Array]
    slopes: list[Array]
    deviations: list[tuple[Array, Array]]
    deviation_slopes: list[tuple[Array, Array]]
    outputs: list[Array]

    @property
    def is_finite(self) -> bool:
        """Whether likelihood, information and gradient are numbers, which they are not where a filter runs away."""
        return all(np.isfinite(one).all() for one in (self.likelihood, self.information, self.gradient))


class FilteredFlight:
    """Records of one or more flights, and the paths that they are linearised along.

    predictor: of the records, with the parameters. paths: per record (N, 9) u v w p q r phi theta psi, reconstructed.
    used: names of OUTPUTS in the likelihood.
    """

    def __init__(self, predictor: Predictor, paths: Sequence[Array], used: Sequence[str]) -> None:
        self.predictor = predictor
        self.records: tuple[Record, ...] = predictor.records
        measured = np.any([np.isfinite(record.z).any(axis=0) for record in self.records], axis=0)
        self.columns = np.array([OUTPUTS.index(name) for name in used if measured[OUTPUTS.index(name)]])
        self.free = [np.array(free, dtype=np.int64) for free in predictor.free_states]
        # Gusts along an imposed axis would act on nothing.
        self.axes = [np.array([a for a in range(3) if a in free], dtype=np.int64) for free in self.free]
        self.noise = self._measured_noise()
        self.paths = [Path.along(states) for states in paths]

    def _measured_noise(self) -> Array:
        """(m,) variances of the used outputs from their highest frequencies."""
        found = []
        for j in self.columns:
            name = OUTPUTS[j]
            if name in ("vn", "ve", "vd"):
                found.append(_GPS_NOISE**2)
                continue
            sigma = [noise_sigma(r.z[:, j], r.interval_s) for r in self.records if np.isfinite(r.z[:, j]).sum() > 20]
            found.append(max(float(np.median(sigma)) if sigma else 0.0, _FLOOR.get(name, _LOWEST_NOISE)) ** 2)
        return np.array(found)

    def all_linearised(self, theta: Array, slopes: bool = True) -> list[LinearisedRecord]:
        """All records about their paths at parameters theta (P,), side by side; without slopes if not `slopes`."""
        return side_by_side(lambda k: self.linearised(k, theta, slopes), range(len(self.records)))

    def linearised(self, k: int, theta: Array, slopes: bool = True) -> LinearisedRecord:
        """A record about its path at parameters theta (P,); without their slopes if not `slopes`."""
        record, path, free = self.records[k], self.paths[k], self.free[k]
        flat, errors = self.predictor.apply(theta)
        thrust = self._thrust(k, errors)
        over, seen = self._surfaces(k, flat)
        ahead, y = self._predicted(k, flat, thrust, over, seen)
        never = beyond_end(record, flat.E)
        gains = error_gains(errors)
        predicted = with_placed_errors(y, errors)
        hidden = unseen(record, flat)
        places, terms, columns, weights = self._direct(flat, record, slopes, hidden)
        # Parameters first, then the unseen.
        count = theta.size if slopes else 0
        targets = np.concatenate((places, count + np.arange(len(hidden)))).astype(np.int64)
        step_x, step_v, read_x, read_v = path_slopes(
            path.before, path.gust_before, path.after, path.gust_over, ahead, free, self.axes[k], over, seen, thrust,
            record.rho[record.start :], _heights(record, flat.E), record.interval_s, flat.P,
            _without_lag(self._effects(flat, record)), flat.C, flat.F, flat.K, flat.T, terms, columns, weights,
            np.arange(len(OUTPUTS)), targets, count + len(hidden),
        )  # fmt: skip
        read_v *= gains[:, None]
        step_theta, read_theta = step_v[:, :, :count], read_v[:, :, :count]
        for i, parameter in enumerate(self.predictor.parameters if slopes else ()):
            if parameter.kind == "sensor":
                name, slope = sensor_derivative(parameter.name, predicted, errors)
                read_theta[:, OUTPUTS.index(name), i] += slope
            elif parameter.kind == "effect":
                h = parameter.step * max(1.0, abs(theta[i]))
                h = -h if theta[i] + h > parameter.high else h
                moved = theta.copy()
                moved[i] += h
                other, _ = self.predictor.apply(moved)
                there = self._predicted(k, other, thrust, *self._surfaces(k, other))
                step_theta[:, :, i] = apart(there[0], ahead)[:, free] / h
                read_theta[:, :, i] = (there[1] - y) * gains / h
        read_x *= gains[:, None]
        memory = remember(lags(flat.E, record.interval_s), self.columns, record.z, read_x, read_theta, places)
        return LinearisedRecord(
            drift=apart(ahead, path.before[1:])[:, free],
            step_x=step_x,
            step_theta=step_theta,
            left=np.where(never, np.nan, angle_wrap(record.z - predicted))[:, self.columns],
            read_x=np.take(read_x, self.columns, axis=1),
            read_theta=np.take(read_theta, self.columns, axis=1),
            unseen=tuple(hidden),
            step_unseen=step_v[:, :, count:],
            read_unseen=np.take(read_v[:, :, count:], self.columns, axis=1),
            surface_noise=self._surface_noise(k, flat, thrust, over, seen, ahead),
            memory=memory,
            unread=never.sum(axis=0)[self.columns],
        )

    def widened(self, k: int, one: LinearisedRecord, theta: Array, others: Sequence[PackedModel]) -> LinearisedRecord:
        """`one` with a column more for each other model: how its steps and readings differ along the same path.

        Of one that is late as the model is both are read ahead, as the filter does; else both with their delays.
        """
        flat, errors = self.predictor.apply(theta)
        thrust, gains = self._thrust(k, errors), error_gains(errors)
        as_read = {ahead: self._predicted(k, flat, thrust, *self._surfaces(k, flat), ahead) for ahead in (True, False)}
        steps, reads = [one.step_theta], [one.read_theta]
        for other in others:
            read_ahead = bool(np.array_equal(other.E[_LATENESS], flat.E[_LATENESS]))
            there = self._predicted(k, other, thrust, *self._surfaces(k, other), read_ahead)
            here = as_read[read_ahead]
            steps.append(apart(there[0], here[0])[:, self.free[k], None])
            reads.append(((there[1] - here[1]) * gains)[:, self.columns, None])
        return replace(
            one,
            step_theta=np.concatenate(steps, axis=2),
            read_theta=np.ascontiguousarray(np.concatenate(reads, axis=2)),
        )

    def _direct(
        self, flat: PackedModel, record: Record, slopes: bool, hidden: Sequence[HiddenInput]
    ) -> tuple[list[int], IntArray, IntArray, Array]:
        """Parameters with a slope in closed form: their places, terms, columns of the Jacobian and weights.

        slopes: whether parameters count. Last, and without places, come the unseen.
        """
        axis = np.searchsorted(flat.T, np.arange(flat.C.size), side="right") - 1
        found: list[tuple[int, int, int]] = []
        weights: list[Array] = []
        same = np.ones(record.length)
        for i, parameter in enumerate(self.predictor.parameters if slopes else ()):
            if parameter.kind == "coefficient":
                term = flat.names.index(parameter.name)
                found.append((i, term, STATE_COLUMNS + int(axis[term])))
                weights.append(same)
            elif parameter.name == "accel_bias_x" and record.moving_mass > 0.0:
                # The apparent thrust of the bias, beside the bias itself.
                found.append((i, -1, THRUST_COLUMN))
                weights.append(-record.moving_mass * same)
            elif parameter.kind == "input":
                found.append((i, -1, THRUST_COLUMN))
                weights.append(_thrust_error(record, parameter.name))
        count = len(found)
        found += [(-1, -1, one.column) for one in hidden]
        weights += [one.weight for one in hidden]
        places, terms, columns = zip(*found, strict=True) if found else ((), (), ())
        return (
            list(places[:count]), np.array(terms, np.int64), np.array(columns, np.int64),
            np.array(weights).reshape(len(places), same.size),
        )  # fmt: skip

    def _thrust(self, k: int, errors: Mapping[str, float]) -> Array:
        record = self.records[k]
        thrust = record.thrust[record.start :] + self.predictor.thrust_shift(record, errors)
        for name, size in errors.items():
            if name.startswith(THRUST_ERROR):
                thrust = thrust + size * _thrust_error(record, name)
        return thrust

    def _effects(self, flat: PackedModel, record: Record) -> Array:
        return effects_flown(effects_at(flat, record), record.thrust[record.start])

    def _surfaces(self, k: int, flat: PackedModel) -> tuple[Array, Array]:
        """What the motion feels (N, sub, 3, 4 + named) and what sensors see (N, 4 + named) of the surfaces."""
        record, sub_steps = self.records[k], self.predictor.sub_steps
        count = 4 + count_named(flat.F)
        over, seen = np.empty((record.length, sub_steps, 3, count)), np.empty((record.length, count))
        commands = with_other_inputs(held_by_dead_band(record.commands, record, flat.E), record, flat.E)
        run_actuators(commands, record.start, record.length, record.interval_s, sub_steps,
                      float(self.predictor.command_first), flat.P, flat.E, over, seen)  # fmt: skip
        return over, seen

    def _surface_noise(self, k: int, flat: PackedModel, thrust: Array, over: Array, seen: Array, ahead: Array) -> Array:
        """(N - 1, nf, 3) standard deviations of each step by what positions leave open between samples, or none."""
        record, free = self.records[k], self.free[k]
        if not record.surface_doubt.any():
            return np.zeros((record.length - 1, free.size, 0))
        moved = []
        for j, doubt in enumerate(record.surface_doubt[record.start :].T):
            other = over.copy()
            other[..., j] += _SURFACE_STEP
            there = self._predicted(k, flat, thrust, other, seen)[0]
            moved.append(apart(there, ahead)[:, free] * (doubt[:-1, None] / _SURFACE_STEP))
        return np.stack(moved, axis=2)

    def _predicted(
        self, k: int, flat: PackedModel, thrust: Array, over: Array, seen: Array, read_ahead: bool = True
    ) -> tuple[Array, Array]:
        """One step ahead and what is read. read_ahead: see `delay_measurements`; else delayed readings are
        expected with their delay, which keeps their noise out of what is compared with them.
        """
        record, path = self.records[k], self.paths[k]
        lagging, effects = bool(np.any(flat.E[_LAGGING])), self._effects(flat, record)
        whole, part = split_delay_ticks(effects, record.interval_s)
        others = with_other_inputs(record.commands, record, effects)[record.start :]
        thrust = undo_hysteresis(thrust, others, effects)

        def along(
            before: Array, gust_before: Array, pull: Array, parameters: Array = flat.P, there: Array = effects
        ) -> tuple[Array, Array]:
            ahead, y, shown = predict_path(
                before, gust_before, path.after, path.gust_after, path.gust_over, self.free[k], over, seen, pull,
                record.rho[record.start :], _heights(record, effects), record.interval_s,
                bool(record.imposed_states.size), lagging, part, parameters, there, flat.C, flat.F, flat.K, flat.T,
                OUTPUT_PLACES,
            )  # fmt: skip
            return ahead, select_delayed(y, shown, there)

        if record.moving_mass > 0.0 and misreads(flat.P, effects):
            # The pull was put together with what the accelerometer read, not with what the motor felt.
            read = along(path.after, path.gust_after, thrust)[1]
            read = delay_prediction(read, effects, whole)
            felt = along(path.after, path.gust_after, thrust, *at_the_centre(flat.P, effects))[1]
            thrust = thrust - record.moving_mass * (read - felt)[:, _AX]
        ahead, y = along(path.before, path.gust_before, thrust)
        if read_ahead:
            return ahead, y - delay_measurements(record, effects, whole)
        return ahead, delay_prediction(y, effects, whole)

    def system(self, k: int, one: LinearisedRecord, turbulence: Turbulence) -> System:
        """The linear system of a record in these gusts."""
        record, path, nf, axes = self.records[k], self.paths[k], self.free[k].size, self.axes[k]
        n = one.left.shape[0]
        speed = float(np.mean(np.linalg.norm(path.before[:, :3], axis=1)))
        gusts = gust_system(turbulence, axes.tolist(), speed, record.interval_s)
        moving = nf + gusts.transition.shape[0]
        remembering = moving + len(one.unseen)
        more = len(one.unseen) + (one.memory.columns.size if one.memory is not None else 0)
        nx = moving + more
        transition, process, observe = motion_and_gusts(
            one.step_x, one.read_x, one.surface_noise, gusts.transition, gusts.process, gusts.output, more
        )
        p_start, output = np.zeros((nx, nx)), np.zeros((axes.size, nx - nf))
        p_start[nf:moving, nf:moving] = gusts.stationary
        p_start[np.arange(nf), np.arange(nf)] = _START[self.free[k]] ** 2
        output[:, : moving - nf] = gusts.output
        jump, drift = np.zeros((n, nx)), np.zeros((n - 1, nx))
        jump[:, :nf] = apart(path.after, path.before)[:, self.free[k]]
        # Gusts are whole here, not deviations: what the path assumed of them comes off again.
        drift[:, :nf] = one.drift - np.einsum("kia,ka->ki", one.step_x[:, :, nf:], path.gust_over[:, axes])
        left = one.left + np.einsum("kja,ka->kj", one.read_x[:, :, nf:], path.gust_before[:, axes])
        system = System(transition, drift, left, observe, jump, process, p_start, output)
        for i, state in enumerate(one.unseen):
            fill_unseen(system, moving + i, state, one.step_unseen[:, :, i], one.read_unseen[:, :, i])
        begun = np.zeros(nx)
        begun[:nf] = path.begin_deviation[self.free[k]]
        if one.memory is not None:
            # Sensors that remember are at rest there too.
            begun[remembering:] = one.memory.held * (one.memory.slopes[0, :, :nf] @ begun[:nf])
            fill_memory(system, remembering, one.memory, nf, path.gust_after[:, axes])
        return _begun_at(system, begun)

    def filtered(
        self, linear: Sequence[LinearisedRecord], noise: Array, turbulence: Turbulence, wanted: bool = True
    ) -> Pass:
        """One filter pass over all records; with information and slopes if `wanted`."""
        count = linear[0].step_theta.shape[2]
        total = Pass(0.0, np.zeros((count, count)), np.zeros(count), [], [], [], [], [], [])
        likelihood = 0.0

        def of_record(k: int) -> tuple[Array, tuple[Any, ...]]:
            one = linear[k]
            system, nf = self.system(k, one, turbulence), self.free[k].size
            slopes = np.zeros((*system.drift.shape, count))
            slopes[:, :nf] = one.step_theta
            return system.output, kalman_pass(
                system.transition, system.drift, slopes, system.left, system.observe, one.read_theta, system.jump,
                noise, system.process, system.p_start, wanted,
            )  # fmt: skip

        for one, (output, passed) in zip(linear, side_by_side(of_record, range(len(linear))), strict=True):
            likelihood += passed[0] + missing_likelihood(passed[3], passed[4], one.unread)
            total.information[:] += passed[1]
            total.gradient[:] += passed[2]
            total.innovations.append(passed[3])
            total.variances.append(passed[4])
            total.slopes.append(passed[7])
            total.deviations.append((passed[5], passed[6]))
            total.deviation_slopes.append((passed[8], passed[9]))
            total.outputs.append(output)
        return replace(total, likelihood=likelihood if np.isfinite(likelihood) else -np.inf)

    def move(self, found: Pass, step: Array | None = None) -> None:
        """Bring every path to where the filter was, or to where it will be after a step (P,) of the parameters."""
        self.paths = self.moved(found, step)

    def moved(self, found: Pass, step: Array | None = None) -> list[Path]:
        """Paths where the filter was, or where it will be after a step (P,) of the parameters."""
        paths = []
        for k, (deviations, slopes) in enumerate(zip(found.deviations, found.deviation_slopes, strict=True)):
            free, axes, nf = self.free[k], self.axes[k], self.free[k].size
            there = [s if step is None else s + d @ step for s, d in zip(deviations, slopes, strict=True)]
            path = self.paths[k].moved(free, there[0][:, :nf], there[1][:, :nf])
            path.gust_before[:, axes] = there[0][:, nf:] @ found.outputs[k].T
            path.gust_after[:, axes] = there[1][:, nf:] @ found.outputs[k].T
            paths.append(path)
        return paths

    def along(self, paths: Sequence[Path]) -> Self:
        """The same flight along other paths."""
        other = copy(self)
        other.paths = list(paths)
        return other


def _begun_at(system: System, mean: Array) -> System:
    """The system whose state begins at a mean (states,) other than zero, expressed for passes that begin at zero."""
    if not np.any(mean):
        return system
    left, jump = system.left.copy(), system.jump.copy()
    left[0] -= system.observe[0] @ mean
    jump[0] -= mean
    return replace(system, left=left, jump=jump)


def _thrust_error(record: Record, name: str) -> Array:
    """(N,) N, one standard deviation of an error of the thrust that is a parameter."""
    return record.thrust_doubt[int(name.removeprefix(THRUST_ERROR)), record.start :]


def _heights(record: Record, effects: Array) -> Array:
    """(N,) height of a record's samples that an effect depends on, 0 where none does."""
    heights = height_for(record, effects)
    return heights[record.start :] if heights.size else np.zeros(record.length)


def _without_lag(effects: Array) -> Array:
    """Effects without those that remember the motion: the filter's gains take lift and sensors as free of lag."""
    without_lag = effects.copy()
    without_lag[_LAGGING] = 0.0
    return without_lag
