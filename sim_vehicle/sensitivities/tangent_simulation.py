"""Exact derivatives of a free-running simulation by coefficients, initial states and thrust, in one pass (compiled).

The tangents dx/dtheta are carried through the very Runge-Kutta steps that `sim_vehicle.physics.simulation` makes, so
they are the derivatives of what it computes, not of the continuous motion (forward mode; Griewank & Walther, Evaluating
Derivatives, ch. 3).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.effects import START_TIME, slot
from sim_vehicle.effects.wind_shear import shear_slopes
from sim_vehicle.jit import jit_fused, jit_fused_arrays
from sim_vehicle.model.aerodynamic_terms import REGRESSORS
from sim_vehicle.physics.actuation import (
    act_late,
    advance_actuators,
    count_named,
    mix_seen,
    start_actuators,
    surfaces_after_command,
    surfaces_at_rest,
    take_seen,
)
from sim_vehicle.physics.dynamics import derivatives
from sim_vehicle.physics.kernel_records import DrivingInputs, ModelArrays
from sim_vehicle.physics.layout import ACTUATOR_SIZE, STATE_SIZE, WORK_SIZE, Aux, Par
from sim_vehicle.physics.rotation import euler_angles
from sim_vehicle.physics.simulation import effects_flown, impose, undo_hysteresis
from sim_vehicle.sensitivities.dynamics_jacobian import COLUMNS, STATE_COLUMNS, force_jacobian
from sim_vehicle.sensitivities.sensor_jacobian import READINGS, euler_slopes, reading_jacobian
from sim_vehicle.sensitivities.tangent_blocks import (
    BLOCK,
    FORCED,
    STAGE,
    WIDTH,
    advance_lanes,
    direct_effects,
    driven_effects,
    read_driven,
    read_lanes,
    turn_quaternions,
)

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_GRAVITY, _TIME = int(Par.gravity), int(Aux.time)
_SHEAR, _SHEAR_G = slot("wind_shear"), slot("wind_shear", "gradient")
_REGRESSORS, _READINGS = len(REGRESSORS), len(READINGS)


class Unknowns(NamedTuple):
    """What to differentiate by, n unknowns of which m are initial states, and r readings to differentiate.

    Attributes
    ----------
    terms : IntArray, shape (n,)
        The term that each unknown is the coefficient of; -1 where it acts through its column by itself (the thrust).
    columns : IntArray, shape (n,)
        The column of `force_jacobian` that each acts through, -1 where it acts on nothing.
    places : IntArray, shape (n,)
        The place of each in the last axis of the result, ascending.
    states : IntArray, shape (m,)
        Initial states u v w p q r phi theta psi (0 ... 8) that the m unknowns are which come before those that act
        through the inputs.
    rows : IntArray, shape (r,)
        Places in READINGS, one for each row of the result.
    gain : Array, shape (r,)
        Factors on the rows of the result, dimensionless or 1 / (unit of the reading).
    """

    terms: IntArray
    columns: IntArray
    places: IntArray
    states: IntArray
    rows: IntArray
    gain: Array


class InputUnknowns(NamedTuple):
    """The last L unknowns, which act through what drives the simulation: what it becomes where each grows by its step.

    Attributes
    ----------
    commands : Array, shape (L, N, 4), (L, N, 6), (L, N, 9) or (L, N, 9 + named)
        Commands, units as of `DrivingInputs`.
    thrust : Array, shape (L, N)
        Thrust as the sensor reads it, N.
    held : Array, shape (L, N, 9) or (L, 0, 9)
        Imposed states, units as of `DrivingInputs`.
    seen : Array, shape (L, N, 4 + named) or (L, 0, 4)
        Surfaces that sensors see, units as of `DrivingInputs`.
    steps : Array, shape (L,)
        Steps, each in its unknown's unit.
    """

    commands: Array
    thrust: Array
    held: Array
    seen: Array
    steps: Array


class _Changes(NamedTuple):
    """Changes over a step by each of the last L unknowns, see `driven_effects`.

    moved: (L, 3) of the surfaces; pushed: (L,) of the thrust; led: (L, 6) of imposed rates.
    """

    moved: Array
    pushed: Array
    led: Array


class _Work(NamedTuple):
    """Work arrays.

    W: (WORK_SIZE,) as of `derivatives`; scratch: (5, 14) rates of the stages and the state there. flow, D, J, part,
    products, R: as of `force_jacobian`. A: (4, STAGE) Jacobians of the stages; force: (4, blocks, 6 WIDTH) direct
    effects there; by_shear: (3, 7) slopes of sheared wind; lanes: (5, BLOCK) of `advance_lanes`.
    """

    W: Array
    scratch: Array
    flow: Array
    D: Array
    J: Array
    part: Array
    products: Array
    R: Array
    A: Array
    force: Array
    by_shear: Array
    lanes: Array


@jit_fused
def _rate_rows(x: Array, gravity: float, E: Array, R: Array, slopes: Array, by_shear: Array, A: Array) -> None:
    """Rows of u v w p q r of the rates' Jacobian, and what the quaternion's rows follow from, into A (STAGE,).

    Rates that are imposed (finite in `slopes`) follow from nothing: their rows of A and of R become zero.
    by_shear: (3, 7), work.
    """
    u, v, w, p, q, r = x[3], x[4], x[5], x[10], x[11], x[12]
    q0, q1, q2, q3 = x[6], x[7], x[8], x[9]
    for row in range(FORCED):
        for z in range(STATE_COLUMNS):
            A[row * STATE_COLUMNS + z] = R[row, z]
    A[1] += r
    A[2] -= q
    A[4] -= w
    A[5] += v
    A[10] -= r
    A[12] += p
    A[13] += w
    A[15] -= u
    A[20] += q
    A[21] -= p
    A[23] -= v
    A[24] += u
    g = 2.0 * gravity
    A[6], A[7], A[8], A[9] = A[6] - g * q2, A[7] + g * q3, A[8] - g * q0, A[9] + g * q1
    A[16], A[17], A[18], A[19] = A[16] + g * q1, A[17] + g * q0, A[18] + g * q3, A[19] + g * q2
    A[26], A[27], A[28], A[29] = A[26] + g * q0, A[27] - g * q1, A[28] - g * q2, A[29] + g * q3
    if E[_SHEAR] != 0.0:
        shear_slopes(x, E[_SHEAR_G], by_shear)
        for row in range(3):
            for z in range(7):
                A[row * STATE_COLUMNS + (z if z < 3 else z + 3)] += by_shear[row, z]
    for row in range(slopes.size):
        if np.isfinite(slopes[row]):
            for z in range(STATE_COLUMNS):
                A[row * STATE_COLUMNS + z] = 0.0
            for z in range(COLUMNS):
                R[row, z] = 0.0
    n = FORCED * STATE_COLUMNS
    A[n], A[n + 1], A[n + 2], A[n + 3], A[n + 4], A[n + 5], A[n + 6] = q0, q1, q2, q3, p, q, r


@jit_fused
def _tangent_step(
    x: Array, surfaces: Array, thrust: float, still: Array, gust: Array, rho: float, step: float, slopes: Array,
    model: ModelArrays, unknowns: Unknowns, X: Array, work: _Work, changes: _Changes,
) -> None:  # fmt: skip
    """`runge_kutta_step` with its tangents X; slopes: imposed rates, NaN where free."""
    P, E, C, F, K, T = model
    W, scratch, flow, D, J, part, products, R, A, force, by_shear, lanes = work
    moved, pushed, led = changes
    terms, columns = unknowns.terms, unknowns.columns
    for i in range(STATE_SIZE):
        scratch[4, i] = x[i]
    for stage in range(4):
        rate = scratch[stage]
        derivatives(scratch[4], surfaces, thrust, still, gust, rho, P, E, C, F, K, T, W, rate)
        force_jacobian(scratch[4], surfaces, np.isnan(thrust), gust, P, E, C, F, K, T, W, flow, D, J, part, products, R)
        _rate_rows(scratch[4], P[_GRAVITY], E, R, slopes, by_shear, A[stage])
        direct_effects(R, products, terms, columns, force[stage])
        driven_effects(R, D, moved, pushed, led, columns.size - pushed.size, force[stage])
        for i in range(slopes.size):
            if np.isfinite(slopes[i]):
                rate[3 + i if i < 3 else 7 + i] = slopes[i]
        if stage < 3:
            share = step if stage == 2 else 0.5 * step
            for i in range(STATE_SIZE):
                scratch[4, i] = x[i] + share * rate[i]
    for i in range(STATE_SIZE):
        x[i] += step / 6.0 * (scratch[0, i] + 2.0 * (scratch[1, i] + scratch[2, i]) + scratch[3, i])
    length = math.sqrt(x[6] * x[6] + x[7] * x[7] + x[8] * x[8] + x[9] * x[9])
    for i in range(6, 10):
        x[i] /= length
    advance_lanes(X, A, force, step, x, length, lanes)


@jit_fused
def _quaternion_slopes(x: Array, slopes: Array) -> None:
    """Derivatives (4, 3) of the quaternion of `x` by phi, theta, psi."""
    q0, q1, q2, q3 = x[6], x[7], x[8], x[9]
    _, _, psi = euler_angles(q0, q1, q2, q3)
    c, s = 0.5 * math.cos(psi), 0.5 * math.sin(psi)
    # phi turns about the body's x axis, psi about the earth's z axis, theta about the y axis turned by psi.
    slopes[0, 0], slopes[1, 0], slopes[2, 0], slopes[3, 0] = -0.5 * q1, 0.5 * q0, 0.5 * q3, -0.5 * q2
    slopes[0, 1], slopes[1, 1] = s * q1 - c * q2, -s * q0 + c * q3
    slopes[2, 1], slopes[3, 1] = c * q0 + s * q3, -c * q1 - s * q2
    slopes[0, 2], slopes[1, 2], slopes[2, 2], slopes[3, 2] = -0.5 * q3, -0.5 * q2, 0.5 * q1, 0.5 * q0


@jit_fused_arrays
def _impose_tangents(x: Array, held: Array, changes: Array, first: int, X: Array) -> None:
    """Impose `held` (9,) on the state `x`: it follows from no unknown but those of the lanes from `first` on.

    changes: (L, 9) by them, of what is imposed.
    """
    before, after, M = np.empty((3, 4)), np.empty((4, 3)), np.zeros((4, 4))
    euler_slopes(x, before)
    impose(x, held)
    for row in range(6):
        if np.isfinite(held[row]):
            for block in range(X.shape[0]):
                for i in range(WIDTH):
                    X[block, row * WIDTH + i] = 0.0
            for lane in range(first, first + changes.shape[0]):
                X[lane // WIDTH, row * WIDTH + lane % WIDTH] = changes[lane - first, row]
    if not (np.isfinite(held[6]) or np.isfinite(held[7]) or np.isfinite(held[8])):
        return
    _quaternion_slopes(x, after)
    for i in range(4):
        for j in range(4):
            for angle in range(3):
                if not np.isfinite(held[6 + angle]):
                    M[i, j] += after[i, angle] * before[angle, j]
    turn_quaternions(X, M)
    for lane in range(first, first + changes.shape[0]):
        for i in range(4):
            for angle in range(3):
                if np.isfinite(held[6 + angle]):
                    X[lane // WIDTH, (6 + i) * WIDTH + lane % WIDTH] += (
                        after[i, angle] * changes[lane - first, 6 + angle]
                    )


@jit_fused_arrays
def initial_tangents(x: Array, states: IntArray, lanes: IntArray, X: Array) -> None:
    """Put the derivatives of the state `x` by the initial `states` (of u v w p q r phi theta psi) into their lanes."""
    slopes = np.empty((4, 3))
    _quaternion_slopes(x, slopes)
    for j in range(states.size):
        block, i = lanes[j] // WIDTH, lanes[j] % WIDTH
        if states[j] < 6:
            X[block, states[j] * WIDTH + i] = 1.0
        else:
            for k in range(4):
                X[block, (6 + k) * WIDTH + i] = slopes[k, states[j] - 6]


@jit_fused_arrays
def simulate_tangents(
    x0: Array,
    first: int,
    start: int,
    stop: int,
    inputs: DrivingInputs,
    model: ModelArrays,
    unknowns: Unknowns,
    others: InputUnknowns,
    S: Array,
) -> None:
    """Derivatives of what `simulate` gives with the arguments of the same names.

    Beside the motion dx/dt = f(x, theta, t) the tangents dx/dtheta of all unknowns theta are integrated,

        d/dt (dx/dtheta) = A dx/dtheta + df/dtheta,   A = df/dx,

    both through the same steps of classical Runge-Kutta, A and df/dtheta anew at each of the four stages; then the
    quaternion is normalised, and its tangents with it. df/dtheta is in closed form for coefficients and thrust, 0 for
    initial states, which set dx/dtheta at the start, and the effect of what the inputs change by for the last unknowns.
    A reading y = h(x, theta) at a sample has the derivative H dx/dtheta + dh/dtheta, H = dh/dx.

    Lags and delays of sensors, a lift that lags and the ground are left out; the height over which the wind changes is
    an input.

    Parameters
    ----------
    x0 : Array, shape (14,)
        State at sample `start` (`sim_vehicle.physics.layout`), SI units and rad.
    first, start, stop : int
        Sample at which the actuators are at rest, first sample of the simulation, and the one after its last.
    inputs : DrivingInputs
        What drives the simulation, SI units and rad.
    model : ModelArrays
        Vehicle and model, SI units and rad.
    unknowns : Unknowns
        What to differentiate by, and which r readings to differentiate.
    others : InputUnknowns
        What the inputs become by the last of the unknowns, SI units and rad.
    S : Array, shape (stop - start, r, unknowns)
        Result, written over: derivatives of the readings times their gain, SI units and rad per unit of each unknown; 0
        at places that are not named. A diverging motion leaves NaN.

    References
    ----------
    Griewank & Walther, Evaluating Derivatives, chapter 3.
    """
    commands, thrust, rho, held, gusts, dt, sub_steps, command_first, seen = inputs
    P, E, C, F, K, T = model
    terms, columns, places, states, rows, gain = unknowns
    other_commands, other_thrust, other_held, other_seen, steps = others
    known = seen.shape[0] > 0 and not act_late(E)
    x = x0.copy()
    n = columns.size
    blocks = (n + WIDTH - 1) // WIDTH
    X, lanes, reading = np.zeros((blocks, BLOCK)), np.empty((5, BLOCK)), np.empty(WIDTH)
    named = count_named(F)
    actuators, W, scratch = np.zeros(ACTUATOR_SIZE), np.zeros(WORK_SIZE + named), np.zeros((6, STATE_SIZE))
    mean, end, now, still = np.zeros(4 + named), np.zeros(4 + named), np.zeros(4 + named), np.zeros(3)
    flow, D, J, R = np.zeros((3, 3)), np.zeros((6, _REGRESSORS + named)), np.zeros((6, COLUMNS)), np.zeros((6, COLUMNS))
    part, angles, by_shear = np.zeros((4, COLUMNS)), np.zeros((3, 4)), np.empty((3, 7))
    products, H = np.zeros(max(C.size, 1)), np.zeros((_READINGS, COLUMNS))
    A, force = np.zeros((4, STAGE)), np.zeros((4, blocks, FORCED * WIDTH))
    slopes = np.zeros(6 if held.shape[0] > 0 else 0)
    L = steps.size
    driven = n - L
    servos, ends = np.zeros((L, ACTUATOR_SIZE)), np.zeros((L, 4 + named))
    middle_there, there = np.zeros(4 + named), np.zeros(4 + named)
    moved, pushed, led, changes = np.zeros((L, 3 + named)), np.zeros(L), np.zeros((L, 6)), np.zeros((L, 9))
    pushes = np.zeros((L, stop))
    for lane in range(L):
        pushes[lane] = undo_hysteresis(other_thrust[lane], other_commands[lane], E)[:stop]
    thrust = undo_hysteresis(thrust, commands, E)
    for lane in range(L):
        for k in range(stop):
            push = (pushes[lane, k] - thrust[k]) / steps[lane]
            pushes[lane, k] = push if np.isfinite(push) else 0.0
    E = effects_flown(E, thrust[first])
    flown, changes_over = ModelArrays(P, E, C, F, K, T), _Changes(moved, pushed, led)
    work = _Work(W, scratch, flow, D, J, part, products, R, A, force, by_shear, lanes)
    x[13] = 0.0
    initial_tangents(x, states, np.arange(driven - states.size, driven), X)
    start_actuators(commands[first], actuators)
    step = dt / sub_steps
    surfaces_at_rest(commands[first], E, end)
    for lane in range(L):
        start_actuators(other_commands[lane, first], servos[lane])
        surfaces_at_rest(other_commands[lane, first], E, ends[lane])
    for k in range(first, start):
        for i in range(sub_steps):
            advance_actuators(commands, k, i * step, step, dt, P, E, actuators, mean, end)
            for lane in range(L):
                advance_actuators(
                    other_commands[lane], k, i * step, step, dt, P, E, servos[lane], middle_there, ends[lane]
                )
    for k in range(start, stop):
        if held.shape[0] > 0:
            for lane in range(L):
                for row in range(9):
                    changes[lane, row] = (other_held[lane, k, row] - held[k, row]) / steps[lane]
            _impose_tangents(x, held[k], changes, driven, X)
        now[:] = end
        if known:
            take_seen(seen[k], E, now)
        elif command_first > 0.0:
            surfaces_after_command(commands, k, dt, E, now)
            mix_seen(end, command_first, now)
        for lane in range(L):
            there[:] = ends[lane]
            if known:
                take_seen(other_seen[lane, k], E, there)
            elif command_first > 0.0:
                surfaces_after_command(other_commands[lane], k, dt, E, there)
                mix_seen(ends[lane], command_first, there)
            for i in range(moved.shape[1]):
                place = i if i < 3 else i + 1  # the throttle moves nothing but the thrust
                moved[lane, i] = (there[place] - now[place]) / steps[lane]
            pushed[lane] = pushes[lane, k]
        gust = gusts[k] if gusts.shape[0] > 0 else still
        W[_TIME] = E[START_TIME] + (k - start) * dt
        derivatives(x, now, thrust[k], still, gust, rho[k], P, E, C, F, K, T, W, scratch[0])
        force_jacobian(x, now, np.isnan(thrust[k]), gust, P, E, C, F, K, T, W, flow, D, J, part, products, R)
        reading_jacobian(x, W, x[5] - gust[2], P, E, flow, R, angles, H)
        # Row by row, while it is in the cache: a result that was cleared at once would come from memory again.
        for row in range(rows.size):
            for i in range(S.shape[2]):
                S[k - start, row, i] = 0.0
        read_lanes(X, H, rows, gain, products, terms, columns, places, S[k - start], reading)
        read_driven(D, H, rows, gain, moved, pushed, places[driven:], S[k - start])
        if k + 1 < stop:
            middle = 0.5 * (thrust[k] + thrust[k + 1])
            gust = 0.5 * (gusts[k] + gusts[k + 1]) if gusts.shape[0] > 0 else still
            for i in range(slopes.size):
                slopes[i] = (held[k + 1, i] - held[k, i]) / dt
                if np.isfinite(slopes[i]):
                    for lane in range(L):
                        after = (other_held[lane, k + 1, i] - held[k + 1, i]) / steps[lane]
                        led[lane, i] = (after - changes[lane, i]) / dt
            for lane in range(L):
                pushed[lane] = 0.5 * (pushes[lane, k] + pushes[lane, k + 1])
            for i in range(sub_steps):
                advance_actuators(commands, k, i * step, step, dt, P, E, actuators, mean, end)
                for lane in range(L):
                    advance_actuators(
                        other_commands[lane], k, i * step, step, dt, P, E, servos[lane], middle_there, ends[lane]
                    )
                    for j in range(moved.shape[1]):
                        place = j if j < 3 else j + 1
                        moved[lane, j] = (middle_there[place] - mean[place]) / steps[lane]
                W[_TIME] = E[START_TIME] + (k - start) * dt + (i + 0.5) * step
                _tangent_step(
                    x, mean, middle, still, gust, rho[k], step, slopes, flown, unknowns, X, work, changes_over
                )
            if not np.isfinite(x[3]) or abs(x[3]) > 1e4:
                S[k + 1 - start :] = np.nan
                return
