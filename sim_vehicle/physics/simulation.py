"""One control tick, and a whole stretch of flight under recorded inputs (compiled)."""

import math

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.effects import START_TIME, slot
from sim_vehicle.effects.sensor_time_skew import delay_channels, split_delay
from sim_vehicle.effects.thrust_sensor_hysteresis import load_behind
from sim_vehicle.jit import jit, jit_arrays
from sim_vehicle.physics.actuation import (
    act_late,
    advance_actuators,
    count_named,
    in_lines,
    mix_seen,
    start_actuators,
    surfaces_after_command,
    surfaces_at_rest,
    take_seen,
)
from sim_vehicle.physics.dynamics import derivatives, runge_kutta_along, runge_kutta_step
from sim_vehicle.physics.ideal_sensors import read_sensors
from sim_vehicle.physics.kernel_records import DrivingInputs, ModelArrays, Moment, TickInputs, TickState, TickWork
from sim_vehicle.physics.layout import ACTUATOR_SIZE, SENSOR_SIZE, STATE_SIZE, WORK_SIZE, Aux
from sim_vehicle.physics.rotation import euler_angles, quaternion_parts

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SLOW, _SLOW_TAU = slot("unsteady_lift"), slot("unsteady_lift", "tau")
_CL, _AX, _TIME = int(Aux.CL), int(Aux.ax), int(Aux.time)
_LOSS = slot("thrust_speed_loss")
_SKEW, _SKEW_S, _SKEW_GROUP = (slot("sensor_time_skew", name) for name in ("on", "delay", "group"))
_HYST, _HYST_W = slot("thrust_sensor_hysteresis"), slot("thrust_sensor_hysteresis", "width")
# Columns of the commands in which a height, and the way in which thrust's reading moves, may stand.
HEIGHT_COLUMN, WAY_COLUMN = 4, 5


@jit
def split_delay_ticks(E: Array, dt: float) -> tuple[int, float]:
    """Whole ticks by which the effects delay the sensors of their group, and the part beside them.

    Parameters
    ----------
    E : Array, shape (slots,)
        Effect vector (`sim_vehicle.effects`), SI units.
    dt : float
        Interval of the ticks, s.

    Returns
    -------
    whole : int
        Whole ticks of the delay, 0 without one.
    part : float
        Part of a tick beside them, 0 to 1, dimensionless.
    """
    return split_delay(E[_SKEW_S] / dt) if E[_SKEW] != 0.0 else (0, 0.0)


@jit_arrays
def effects_flown(E: Array, thrust: float) -> Array:
    """The effect vector less what measured thrust already holds: its own loss with speed.

    Parameters
    ----------
    E : Array, shape (slots,)
        Effect vector (`sim_vehicle.effects`), SI units.
    thrust : float
        Measured thrust, N; NaN where it follows from the throttle.

    Returns
    -------
    Array, shape (slots,)
        The effect vector, SI units: `E` itself where nothing is taken out, else a copy.
    """
    if E[_LOSS] == 0.0 or np.isnan(thrust):
        return E
    flown = E.copy()
    flown[_LOSS] = 0.0
    return flown


@jit_arrays
def undo_hysteresis(thrust: Array, commands: Array, E: Array) -> Array:
    """Thrust of the propeller behind its sensor's reading; NaN, where it follows from the throttle, stays.

    Parameters
    ----------
    thrust : Array, shape (N,)
        Thrust as the sensor reads it, N; NaN where it follows from the throttle.
    commands : Array, shape (N, 4), (N, 6), (N, 9) or (N, 9 + named)
        As of `DrivingInputs`; the sixth column is the way, -1 to 1, in which the reading moves.
    E : Array, shape (slots,)
        Effect vector (`sim_vehicle.effects`), SI units.

    Returns
    -------
    Array, shape (N,)
        Thrust of the propeller, N; `thrust` itself without the effect or without that column.
    """
    if E[_HYST] == 0.0 or commands.shape[1] <= WAY_COLUMN:
        return thrust
    pull = np.empty(thrust.size)
    for k in range(thrust.size):
        pull[k] = load_behind(thrust[k], commands[k, WAY_COLUMN], E[_HYST_W])
    return pull


@jit
def begin_of_step(mean: Array, end: Array, first: Array) -> None:
    """Surfaces and throttle at the begin of a step over which they go in straight lines, into the first entries of
    `first`. mean, end: (4 + named,) over the step and at its end.
    """
    for c in range(mean.size):
        first[c] = 2.0 * mean[c] - end[c]


@jit
def tick(
    x: Array, actuators: Array, commands: Array, row: int, dt: float, sub_steps: int, wind: Array, gust: Array,
    rho: float, measured_thrust: float, slopes: Array, P: Array, E: Array, C: Array, F: IntArray, K: IntArray,
    T: IntArray, W: Array, scratch: Array, mean: Array, end: Array,
) -> None:  # fmt: skip
    """Fly from one row of the commands to the next, in place.

    The time in W goes on by `dt`; what changes with it is taken in the middle of each step.

    Parameters
    ----------
    x : Array, shape (14,)
        State (`sim_vehicle.physics.layout`), SI units and rad; changed in place.
    actuators : Array, shape (ACTUATOR_SIZE,)
        State of the actuators, rad and throttle (0 to 1); changed in place.
    commands : Array, shape (N, 4), (N, 6), (N, 9) or (N, 9 + named)
        de, da, dr [rad] and throttle (0 to 1), and what else is of `DrivingInputs`.
    row : int
        Row of `commands` to fly from.
    dt : float
        Interval of the ticks, s.
    sub_steps : int
        Runge-Kutta steps in the tick.
    wind : Array, shape (3,)
        Velocity of the air, north east down, m/s, mean over the tick.
    gust : Array, shape (3,)
        Velocity of the air in body axes on top, m/s, mean over the tick.
    rho : float
        Air density, kg/m^3.
    measured_thrust : float
        Measured thrust, N, or NaN where thrust follows from the throttle.
    slopes : Array, shape (6,) or (0,)
        Imposed rates of u v w [m/s^2] and p q r [rad/s^2], NaN where free; (0,) where all are free.
    P, E : Array, shapes (PAR_SIZE,) and (slots,)
        Vehicle constants and effect vector (`sim_vehicle.physics.layout`, `sim_vehicle.effects`), SI units.
    C : Array, shape (n,)
        Values of the aerodynamic terms, dimensionless.
    F, K, T : IntArray, shapes (n, 4), (n,) and (7,)
        Factor indices, kinds and axis bounds of the aerodynamic terms.
    W : Array, shape (WORK_SIZE + named,)
        Work array: regressors, by-products (`Aux`) and the time, SI units.
    scratch : Array, shape (6, 14)
        Work, written over.
    mean : Array, shape (4 + named,)
        Work, written over: mean surfaces over a step, rad, and throttle.
    end : Array, shape (4 + named,)
        Result, written over: the surfaces a sensor sees at the next row, rad, and throttle (0 to 1).
    """
    step, begin = dt / sub_steps, W[_TIME]
    for i in range(sub_steps):
        advance_actuators(commands, row, i * step, step, dt, P, E, actuators, mean, end)
        W[_TIME] = begin + (i + 0.5) * step
        if in_lines(commands):
            begin_of_step(mean, end, scratch[5])
            runge_kutta_along(x, scratch[5], mean, end, measured_thrust, wind, gust, rho, step, slopes, P, E, C, F, K,
                              T, W, scratch)  # fmt: skip
        else:
            runge_kutta_step(x, mean, measured_thrust, wind, gust, rho, step, slopes, P, E, C, F, K, T, W, scratch)
    W[_TIME] = begin + dt


@jit_arrays
def read_within_tick(
    state: TickState,
    inputs: TickInputs,
    moment: Moment,
    model: ModelArrays,
    work: TickWork,
    sensor: Array,
    y: Array,
) -> None:
    """What sensors read a share of the way from one row of the commands to the next.

    The same equations as of `tick` are integrated, the last step only as far as that moment. The motion, the actuators
    and the surfaces stay where they are.

    Parameters
    ----------
    state : TickState
        The vehicle at the row, SI units and rad.
    inputs : TickInputs
        What drives the tick, SI units and rad.
    moment : Moment
        When the sensors are read, and the gust [m/s] and the thrust [N] there.
    model : ModelArrays
        Vehicle and model, SI units and rad.
    work : TickWork
        Work arrays, written over; the time is as it came afterwards, the rate is that at the moment.
    sensor : Array, shape (SENSOR_SIZE,)
        Memory of sensors that are read at such moments alone, a tick apart, SI units and rad; it goes on, in place.
    y : Array, shape (19,)
        Result, written over: readings in the order of CHANNELS, SI units and rad.
    """
    x, actuators, end = state.x.copy(), state.actuators.copy(), state.surfaces.copy()
    commands, row, wind, gust, rho, thrust, slopes, dt, sub_steps = inputs
    P, E, C, F, K, T = model
    W, scratch, mean, rate = work
    share = moment.share
    step, begin = dt / sub_steps, W[_TIME]
    last = min(int(share * sub_steps), sub_steps - 1)
    for i in range(last + 1):
        length = step if i < last else share * dt - last * step
        if length > 0.0:
            advance_actuators(commands, row, i * step, length, dt, P, E, actuators, mean, end)
            W[_TIME] = begin + i * step + 0.5 * length
            if in_lines(commands):
                begin_of_step(mean, end, scratch[5])
                runge_kutta_along(x, scratch[5], mean, end, thrust, wind, gust, rho, length, slopes, P, E, C, F, K, T,
                                  W, scratch)  # fmt: skip
            else:
                runge_kutta_step(x, mean, thrust, wind, gust, rho, length, slopes, P, E, C, F, K, T, W, scratch)
    W[_TIME] = begin + share * dt
    derivatives(x, end, moment.thrust, wind, moment.gust, rho, P, E, C, F, K, T, W, rate)
    read_sensors(x, W, P, E, dt, sensor, y)
    W[_TIME] = begin


@jit
def impose(x: Array, held: Array) -> None:
    """Replace the imposed ones of u v w p q r phi theta psi in the state.

    Parameters
    ----------
    x : Array, shape (14,)
        State (`sim_vehicle.physics.layout`), SI units and rad; changed in place.
    held : Array, shape (9,)
        u v w [m/s], p q r [rad/s], phi theta psi [rad]; those that are not finite are free.
    """
    for i in range(3):
        if np.isfinite(held[i]):
            x[3 + i] = held[i]
        if np.isfinite(held[3 + i]):
            x[10 + i] = held[3 + i]
    free = 0
    for i in range(6, 9):
        if not np.isfinite(held[i]):
            free += 1
    if free == 3:
        return
    phi, theta, psi = held[6], held[7], held[8]
    if free > 0:  # the angles of a quaternion take as long as all the rest
        angles = euler_angles(x[6], x[7], x[8], x[9])
        phi = phi if np.isfinite(phi) else angles[0]
        theta = theta if np.isfinite(theta) else angles[1]
        psi = psi if np.isfinite(psi) else angles[2]
    x[6], x[7], x[8], x[9] = quaternion_parts(phi, theta, psi)


@jit_arrays
def settle_lift(
    x: Array, surfaces: Array, thrust: float, rho: float, model: ModelArrays, W: Array, rate: Array
) -> None:
    """Give the angle that lift feels, where it is NaN, its value in a steady change: alpha - tau alpha'."""
    P, E, C, F, K, T = model
    if np.isfinite(x[13]):
        return
    still = np.zeros(3)
    alpha = math.atan2(x[5], x[3])
    x[13] = alpha
    if E[_SLOW] == 0.0:
        return
    for _ in range(4):
        derivatives(x, surfaces, thrust, still, still, rho, P, E, C, F, K, T, W, rate)
        x[13] = alpha - E[_SLOW_TAU] * (x[3] * rate[5] - x[5] * rate[3]) / (x[3] ** 2 + x[5] ** 2)


@jit_arrays
def simulate(x0: Array, first: int, start: int, stop: int, inputs: DrivingInputs, model: ModelArrays, y: Array) -> None:
    """Free-running simulation of samples start ... stop - 1 under recorded inputs.

    Parameters
    ----------
    x0 : Array, shape (14,)
        State at sample `start` (`sim_vehicle.physics.layout`), its last entry NaN where it is to be found, SI units and
        rad.
    first, start, stop : int
        Sample at which the actuators are at rest (they run from there to `start`), first sample of the simulation, and
        the one after its last.
    inputs : DrivingInputs
        What drives the simulation, SI units and rad.
    model : ModelArrays
        Vehicle and model, SI units and rad.
    y : Array, shape (stop - start, 19)
        Result, written over: readings in the order of CHANNELS, SI units and rad. A diverging motion leaves NaN rows.
    """
    commands, thrust, rho, held, gusts, dt, sub_steps, command_first, seen = inputs
    P, E, C, F, K, T = model
    x = x0.copy()
    actuators, sensor = np.zeros(ACTUATOR_SIZE), np.zeros(SENSOR_SIZE)
    named = count_named(F)
    W, scratch, rate = np.zeros(WORK_SIZE + named), np.zeros((6, STATE_SIZE)), np.zeros(STATE_SIZE)
    mean, end, now, still = np.zeros(4 + named), np.zeros(4 + named), np.zeros(4 + named), np.zeros(3)
    slopes = np.zeros(6 if held.shape[0] > 0 else 0)
    thrust = undo_hysteresis(thrust, commands, E)
    E = effects_flown(E, thrust[first])
    flown, state, work = ModelArrays(P, E, C, F, K, T), TickState(x, actuators, end), TickWork(W, scratch, mean, rate)
    whole, part = split_delay_ticks(E, dt)
    late = whole + part
    shown, past_sensor = np.full((stop - start if late > 0.0 else 0, y.shape[1]), np.nan), np.zeros(SENSOR_SIZE)
    heights = commands.shape[1] > HEIGHT_COLUMN and np.isfinite(commands[start, HEIGHT_COLUMN])
    known = seen.shape[0] > 0 and not act_late(E)
    start_actuators(commands[first], actuators)
    step = dt / sub_steps
    W[_TIME] = E[START_TIME]
    surfaces_at_rest(commands[first], E, end)
    for k in range(first, start):
        for i in range(sub_steps):
            advance_actuators(commands, k, i * step, step, dt, P, E, actuators, mean, end)
    if heights:
        x[2] = -commands[start, HEIGHT_COLUMN]
    settle_lift(x, end, thrust[start], rho[start], flown, W, rate)
    for k in range(start, stop):
        if held.shape[0] > 0:
            impose(x, held[k])
        if heights:
            x[2] = -commands[k, HEIGHT_COLUMN]
        now[:] = end
        if known:
            take_seen(seen[k], E, now)
        elif command_first > 0.0:
            surfaces_after_command(commands, k, dt, E, now)
            mix_seen(end, command_first, now)
        W[_TIME] = E[START_TIME] + (k - start) * dt
        gust = gusts[k] if gusts.shape[0] > 0 else still
        derivatives(x, now, thrust[k], still, gust, rho[k], P, E, C, F, K, T, W, rate)
        read_sensors(x, W, P, E, 0.0 if k == start else dt, sensor, y[k - start])
        if k == start:
            past_sensor[:] = sensor
        if k + 1 < stop:
            middle = 0.5 * (thrust[k] + thrust[k + 1])
            gust = 0.5 * (gusts[k] + gusts[k + 1]) if gusts.shape[0] > 0 else still
            for i in range(slopes.size):
                slopes[i] = (held[k + 1, i] - held[k, i]) / dt
            if part > 0.0:
                share = 1.0 - part
                there = gusts[k] + share * (gusts[k + 1] - gusts[k]) if gusts.shape[0] > 0 else still
                moment = Moment(share, there, thrust[k] + share * (thrust[k + 1] - thrust[k]))
                over = TickInputs(commands, k, still, gust, rho[k], middle, slopes, dt, sub_steps)
                read_within_tick(state, over, moment, flown, work, past_sensor, shown[k + 1 - start])
            tick(x, actuators, commands, k, dt, sub_steps, still, gust, rho[k], middle, slopes, P, E, C, F, K, T, W,
                 scratch, mean, end)  # fmt: skip
            if not np.isfinite(x[3]) or abs(x[3]) > 1e4:
                y[k + 1 - start :] = np.nan
                break
    if late > 0.0:
        delay_channels(y, shown if part > 0.0 else y.copy(), E[_SKEW_GROUP], late)


@jit_arrays
def simulate_variants(
    x0: Array,
    first: int,
    start: int,
    stop: int,
    inputs: DrivingInputs,
    models: ModelArrays,
    thrust_shift: Array,
    y: Array,
) -> None:
    """Run `simulate` for n variants of the same stretch in one call.

    Parameters
    ----------
    x0 : Array, shape (n, 14)
        States at sample `start` (`sim_vehicle.physics.layout`), SI units and rad.
    first, start, stop : int
        Sample at which the actuators are at rest, first sample of the simulation, and the one after its last.
    inputs : DrivingInputs
        What drives all of them, SI units and rad.
    models : ModelArrays
        Vehicle and model, of which E (n, slots) and C (n, terms) have a row for each variant, SI units and rad.
    thrust_shift : Array, shape (n,)
        Added to the measured thrust of each variant, N.
    y : Array, shape (n, stop - start, 19)
        Result, written over: readings in the order of CHANNELS, SI units and rad. A diverging motion leaves NaN rows.
    """
    commands, thrust, rho, held, gusts, dt, sub_steps, command_first, seen = inputs
    P, E, C, F, K, T = models
    for i in range(x0.shape[0]):
        shifted = DrivingInputs(
            commands, thrust + thrust_shift[i], rho, held, gusts, dt, sub_steps, command_first, seen
        )
        simulate(x0[i], first, start, stop, shifted, ModelArrays(P, E[i], C[i], F, K, T), y[i])


@jit_arrays
def evaluate_path(
    states: Array, commands: Array, first: int, thrust: Array, rho: Array, dt: float, command_first: float,
    model: ModelArrays, coefficients: Array,
) -> None:  # fmt: skip
    """Coefficients and accelerations that a model gives along a known motion, no integration.

    Elements with memory of the motion itself (a lift that lags) start settled.

    Parameters
    ----------
    states : Array, shape (N, 9)
        u v w [m/s], p q r [rad/s], phi theta psi [rad] at the samples from `first` of the commands on.
    commands : Array, shape (M, 4), (M, 6), (M, 9) or (M, 9 + named)
        de, da, dr [rad] and throttle (0 to 1), and what else is of `DrivingInputs`.
    first : int
        Sample of the commands at which the states begin.
    thrust : Array, shape (M,)
        Thrust as the sensor reads it, N; NaN where it follows from the throttle.
    rho : Array, shape (M,)
        Air density, kg/m^3.
    dt : float
        Interval of the samples, s.
    command_first : float
        1 where a sample already sees its own command, 0 where it sees that of the sample before; see `DrivingInputs`.
    model : ModelArrays
        Vehicle and model, SI units and rad.
    coefficients : Array, shape (N, 12)
        Result, written over: the six of AXES (dimensionless), ax ay az [m/s^2], p' q' r' [rad/s^2], at the centre of
        gravity.
    """
    P, E, C, F, K, T = model
    named = count_named(F)
    actuators, mean, end, now = np.zeros(ACTUATOR_SIZE), np.zeros(4 + named), np.zeros(4 + named), np.zeros(4 + named)
    W, rate, x, still = np.zeros(WORK_SIZE + named), np.zeros(STATE_SIZE), np.zeros(STATE_SIZE), np.zeros(3)
    thrust = undo_hysteresis(thrust, commands, E)
    E = effects_flown(E, thrust[0])
    start_actuators(commands[0], actuators)
    surfaces_at_rest(commands[0], E, end)
    x[6] = 1.0
    for k in range(commands.shape[0]):
        if k >= first:
            row = k - first
            impose(x, states[row])
            if row == 0:
                x[13] = math.atan2(x[5], x[3])
            now[:] = end
            if command_first > 0.0:
                surfaces_after_command(commands, k, dt, E, now)
                mix_seen(end, command_first, now)
            if commands.shape[1] > HEIGHT_COLUMN and np.isfinite(commands[k, HEIGHT_COLUMN]):
                x[2] = -commands[k, HEIGHT_COLUMN]
            W[_TIME] = E[START_TIME] + row * dt
            derivatives(x, now, thrust[k], still, still, rho[k], P, E, C, F, K, T, W, rate)
            x[13] += rate[13] * dt
            for axis in range(6):
                coefficients[row, axis] = W[_CL + axis]
                coefficients[row, 6 + axis] = W[_AX + axis]
        advance_actuators(commands, k, 0.0, dt, dt, P, E, actuators, mean, end)
