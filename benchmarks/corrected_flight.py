"""What learners that give no model file learn from, and the free-running simulation of a model that they correct.

The equations of motion are the simulator's; the correction is added to its rates, and all windows of a flight are
integrated side by side so that a learner is asked once for all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.physics.actuation import advance_actuators, start_actuators, surfaces_after_command, surfaces_at_rest
from sim_vehicle.physics.dynamics import derivatives
from sim_vehicle.physics.ideal_sensors import read_sensors
from sim_vehicle.physics.layout import ACTUATOR_SIZE, CHANNELS, SENSOR_SIZE, STATE_SIZE, WORK_SIZE, Aux, Par
from sim_vehicle.physics.rotation import quaternion
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.compatibility.reconstruction import smoothed_states
from sysid.numerics.smoothing import fourier_smooth
from sysid.problem.coefficient_residuals import CUTOFF_HZ, coefficient_path
from sysid.problem.free_run import GAP_NAMES, Fixed, windows
from sysid.problem.predictor import with_errors
from sysid.signals.preparation import Prepared
from sysid.signals.record import OUTPUTS, STATES, Record, angle_wrap, effects_at
from sysid.signals.sensor_mounting import SensorMounting

Array = NDArray[np.float64]

#: What a correction may depend on: angles and surfaces in rad, V over the reference speed, rates nondimensional as in
#: coefficient names, thrust over dynamic pressure and wing area.
REGRESSORS = ("alpha", "beta", "V", "p", "q", "r", "de", "da", "dr", "thrust")
AXES = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
#: Correction of the six AXES, (n, 6), at n rows of REGRESSORS, (n, 10).
Correction = Callable[[Array], Array]

_SUB_STEPS = 2  # as the gap is computed
_STILL = np.zeros(3)
_LOST = 1e4  # m/s, at which a simulation has diverged
_SPEED = 3  # first velocity in the state
# Sensor errors that are fitted to each model's own free runs, where they only shift what it reads.
_BIASES = {
    "gyro_bias_p": "p", "gyro_bias_q": "q", "gyro_bias_r": "r", "accel_bias_x": "ax", "accel_bias_y": "ay",
    "accel_bias_z": "az", "alpha_bias": "alpha", "beta_bias": "beta",
}  # fmt: skip
_ROUNDS = 3


def surfaces_along(record: Record, model: Fixed) -> tuple[Array, Array]:
    """Surfaces and throttle (4) behind their actuators: at the samples (N, 4), and their means over the steps between.

    Returns (N, 4) and (N - 1, _SUB_STEPS, 4). The model may hold effects of the actuators that need no other input.
    """
    P, E = model.flat.P, effects_at(model.flat, record)
    actuators, mean, end = np.zeros(ACTUATOR_SIZE), np.zeros(4), np.zeros(4)
    start_actuators(record.commands[0], actuators)
    surfaces_at_rest(record.commands[0], E, end)
    seen, felt = np.empty((record.length, 4)), np.empty((record.length - 1, _SUB_STEPS, 4))
    dt = record.interval_s
    step, last = dt / _SUB_STEPS, record.start + record.length - 1
    for k in range(last + 1):
        if k >= record.start:
            now = end.copy()
            if model.command_first:
                surfaces_after_command(record.commands, k, dt, E, now)
            seen[k - record.start] = now
        if k == last:
            break
        for i in range(_SUB_STEPS):
            advance_actuators(record.commands, k, i * step, step, dt, P, E, actuators, mean, end)
            if k >= record.start:
                felt[k - record.start, i] = mean
    return seen, felt


@dataclass
class _Run:
    """One window while it is flown: inputs, state (14,), and what its sensors read so far."""

    record: Record
    model: Fixed
    x: Array

    def __post_init__(self) -> None:
        record, flat = self.record, self.model.flat
        self.seen, self.felt = surfaces_along(record, self.model)
        self.thrust = record.thrust - record.moving_mass * self.model.errors.get("accel_bias_x", 0.0)
        self.E, self.W = effects_at(flat, record), np.zeros(WORK_SIZE)
        self.sensor, self.y = np.zeros(SENSOR_SIZE), np.full((record.length, len(CHANNELS)), np.nan)

    def rates(self, x: Array, surfaces: Array, thrust: float, row: int) -> Array:
        """(14,) of the uncorrected model; by-products are left in W."""
        flat, rate = self.model.flat, np.zeros(STATE_SIZE)
        rho = float(self.record.rho[self.record.start + row])
        derivatives(x, surfaces, thrust, _STILL, _STILL, rho, flat.P, self.E, flat.C, flat.F, flat.K, flat.T, self.W,
                    rate)  # fmt: skip
        return rate

    def regressors(self) -> Array:
        """(10,) at the last call of `rates`."""
        W, P = self.W, self.model.flat.P
        force = 0.5 * W[Aux.rho] * W[Aux.V] ** 2 * P[Par.S]
        flow = [W[0], W[2], W[Aux.V] / P[Par.reference_speed], *W[3:6], *W[6:9]]
        return np.array([*flow, W[Aux.thrust] / force])

    def add(self, coefficients: Array, rate: Array) -> None:
        """Let a correction (6,) act on the last `rates`, and on the accelerations that sensors read."""
        W, P = self.W, self.model.flat.P
        CL, CD, CY, Cl, Cm, Cn = coefficients
        force = 0.5 * W[Aux.rho] * W[Aux.V] ** 2 * P[Par.S]
        ca, sa = np.cos(W[0]), np.sin(W[0])
        shift = force / P[Par.mass] * np.array([CL * sa - CD * ca, CY, -CL * ca - CD * sa])
        roll, pitch, yaw = force * np.array([P[Par.b] * Cl, P[Par.c] * Cm, P[Par.b] * Cn])
        Ixx, Iyy, Izz, Ixz = (P[i] for i in (Par.Ixx, Par.Iyy, Par.Izz, Par.Ixz))
        inverse = 1.0 / (Ixx * Izz - Ixz**2)
        turn = np.array([(Izz * roll + Ixz * yaw) * inverse, pitch / Iyy, (Ixz * roll + Ixx * yaw) * inverse])
        rate[3:6] += shift
        rate[10:13] += turn
        W[Aux.ax : Aux.az + 1] += shift
        W[Aux.p_dot : Aux.r_dot + 1] += turn


def _rates(runs: Sequence[_Run], states: Sequence[Array], surfaces: Sequence[Array], thrust: Sequence[float],
           row: int, correction: Correction | None) -> list[Array]:  # fmt: skip
    """Rates of every run at these states."""
    found = [run.rates(x, s, t, row) for run, x, s, t in zip(runs, states, surfaces, thrust, strict=True)]
    if correction is not None:
        added = correction(np.stack([run.regressors() for run in runs]))
        for run, coefficients, rate in zip(runs, added, found, strict=True):
            run.add(coefficients, rate)
    return found


def _step(runs: Sequence[_Run], row: int, correction: Correction | None) -> None:
    """Fly all runs from one sample to the next, classical fourth-order Runge-Kutta."""
    step = runs[0].record.interval_s / _SUB_STEPS
    thrust = [float(np.mean(run.thrust[run.record.start + row : run.record.start + row + 2])) for run in runs]
    for i in range(_SUB_STEPS):
        surfaces, x = [run.felt[row, i] for run in runs], [run.x for run in runs]
        slopes = [_rates(runs, x, surfaces, thrust, row, correction)]
        for share in (0.5, 0.5, 1.0):
            states = [a + share * step * k for a, k in zip(x, slopes[-1], strict=True)]
            slopes.append(_rates(runs, states, surfaces, thrust, row, correction))
        for run, k1, k2, k3, k4 in zip(runs, *slopes, strict=True):
            run.x = run.x + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
            run.x[6:10] /= np.linalg.norm(run.x[6:10])


def free_runs(
    records: Sequence[Record], starts: Sequence[Array], model: Fixed, correction: Correction | None
) -> list[Array]:
    """Readings (N, 15) of free runs of a corrected model, one per record, from nine initial states each.

    What diverges is NaN from there on.
    """
    runs = []
    for record, states in zip(records, starts, strict=True):
        x = np.zeros(STATE_SIZE)
        x[3:6], x[10:13], x[6:10] = states[:3], states[3:6], quaternion(*(float(a) for a in states[6:9]))
        x[13] = np.arctan2(states[2], states[0])
        runs.append(_Run(record, model, x))
    row, flying = 0, runs
    while flying:
        thrust = [float(run.thrust[run.record.start + row]) for run in flying]
        _rates(flying, [run.x for run in flying], [run.seen[row] for run in flying], thrust, row, correction)
        for run in flying:
            interval = 0.0 if row == 0 else run.record.interval_s
            read_sensors(run.x, run.W, model.flat.P, run.E, interval, run.sensor, run.y[row])
        flying = [run for run in flying if row + 1 < run.record.length]
        if flying:
            _step(flying, row, correction)
        row += 1
        flying = [run for run in flying if np.isfinite(run.x).all() and abs(run.x[_SPEED]) < _LOST]
    return [with_errors(run.y, model.errors) for run in runs]


def _residuals(records: Sequence[Record], layout: SensorMounting, model: Fixed, correction: Correction | None) -> Array:
    """Measured less simulated, (N, 15), over the windows of five seconds of all records."""
    parts, starts = [], []
    for record in records:
        states = smoothed_states(record, layout, dict(model.errors))
        path, begin = np.stack([states[name] for name in STATES], axis=1), 0
        for part in windows(record):
            parts.append(part)
            starts.append(path[begin])
            begin += part.length
    flown = free_runs(parts, starts, model, correction)
    return np.concatenate([angle_wrap(part.z - y) for part, y in zip(parts, flown, strict=True)])


def _with_biases(errors: Mapping[str, float], residuals: Array) -> dict[str, float]:
    """Sensor errors with the biases that these residuals tell; as they were where a run diverged."""
    told = {name: residuals[:, OUTPUTS.index(output)] for name, output in _BIASES.items()}
    moved = {name: float(np.mean(r)) for name, r in told.items() if np.isfinite(r).all()}
    return dict(errors) | {name: errors.get(name, 0.0) + shift for name, shift in moved.items()}


def judged_gap(
    records: Sequence[Record], layout: SensorMounting, model: Fixed, correction: Correction | None = None
) -> dict[str, float]:
    """Gap per output (root mean square over windows of five seconds) of a model with its own sensor biases fitted.

    Infinite where a free run diverged.
    """
    residuals = _residuals(records, layout, model, correction)
    for _ in range(_ROUNDS - 1):
        model = replace(model, errors=_with_biases(model.errors, residuals))
        residuals = _residuals(records, layout, model, correction)
    size = np.sqrt(np.mean(np.square(residuals), axis=0))
    return {
        shown: float(np.nan_to_num(size[OUTPUTS.index(name)], nan=np.inf))
        for name, shown in GAP_NAMES.items()
        if all(np.isfinite(record.z[:, OUTPUTS.index(name)]).all() for record in records)
    }


def residual_coefficients(prepared: Sequence[Prepared], vehicle: Vehicle, model: Fixed) -> tuple[Array, Array]:
    """What peers learn from: REGRESSORS (N, 10) along the flights, and measured less predicted AXES (N, 6)."""
    P, rows, targets = model.flat.P, [], []
    for flight in prepared:
        for stretch in flight.stretches:
            record = stretch.record
            path = coefficient_path(record, flight.layout, vehicle, model)
            edge = (record.length - path.time_s.size) // 2  # the path leaves out the ends
            inner = slice(edge, record.length - edge)
            found, seen = path.variables, surfaces_along(record, model)[0][inner]
            rho = record.rho[record.start : record.start + record.length][inner]
            force = 0.5 * rho * found["V"] ** 2 * P[Par.S]
            flow = [found["alpha"], found["beta"], found["V"] / P[Par.reference_speed]]
            rates = [found[name] for name in ("phat", "qhat", "rhat")]
            rows.append(np.column_stack([*flow, *rates, *seen[:, :3].T, found["thrust"] / force]))
            dt = record.interval_s
            differences = (path.measured[axis] - path.predicted[axis] for axis in AXES)
            targets.append(np.column_stack([fourier_smooth(d, dt, CUTOFF_HZ).values for d in differences]))
    return np.concatenate(rows), np.concatenate(targets)
