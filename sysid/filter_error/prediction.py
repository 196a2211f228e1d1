"""The filter of the filter-error method: predictions along a path, and one Kalman pass (compiled).

Turbulence is process noise, so what is left over, the innovations, is white, and the estimate of the parameters is a
generalised least squares fit. The step is linearised where the filter stood after a sample, the outputs where it was
expected to be before: a regressor that knew the sample's own noise would bias every derivative. Sources: Jategaonkar,
"Flight Vehicle System Identification", ch. 5; Maine & Iliff, NASA RP-1168, ch. 5.
"""

from __future__ import annotations

from math import asin, atan2, cos, floor, pi, sin

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.effects import START_TIME, slot
from sim_vehicle.jit import jit, jit_arrays
from sim_vehicle.physics.actuation import (
    advance_actuators,
    count_named,
    in_lines,
    mix_seen,
    start_actuators,
    surfaces_after_command,
    surfaces_at_rest,
)
from sim_vehicle.physics.dynamics import derivatives, runge_kutta_along
from sim_vehicle.physics.ideal_sensors import read_sensors
from sim_vehicle.physics.layout import ACTUATOR_SIZE, SENSOR_SIZE, STATE_SIZE, WORK_SIZE, Aux, Par

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_TIME = int(Aux.time)
_LAG, _TAU, _RATE = slot("actuator_lag"), slot("actuator_lag", "tau"), slot("actuator_rate_limit")
_MOTOR, _MOTOR_TAU, _OWN_TAU = slot("motor_lag"), slot("motor_lag", "tau"), int(Par.motor_tau)


@jit_arrays
def run_actuators(
    commands: Array, start: int, length: int, dt: float, sub_steps: int, command_first: float, P: Array, E: Array,
    over: Array, seen: Array,
) -> None:  # fmt: skip
    """Surfaces and throttle along a record, which no state acts on.

    commands: (M, 4), or (M, 9) and more where surfaces go in straight lines from sample to sample. over: (length,
    sub_steps, 3, 4 + named) result, what the motion feels at the begin, in the middle and at the end of every step, its
    mean by Simpson's rule the true one. seen: (length, 4 + named) result, what sensors see at the samples.
    """
    count = seen.shape[1]
    actuators, mean, end, before = np.zeros(ACTUATOR_SIZE), np.zeros(count), np.zeros(count), np.zeros(count)
    servos = (E[_LAG] != 0.0 and E[_TAU] > 0.0) or E[_RATE] != 0.0 or in_lines(commands)
    motor = (E[_MOTOR_TAU] if E[_MOTOR] != 0.0 else P[_OWN_TAU]) > 0.0
    step = dt / sub_steps
    start_actuators(commands[0], actuators)
    surfaces_at_rest(commands[0], E, end)
    for k in range(start + length):
        if k >= start:
            seen[k - start] = end
            if command_first > 0.0:
                surfaces_after_command(commands, k, dt, E, seen[k - start])
                mix_seen(end, command_first, seen[k - start])
        for i in range(sub_steps):
            before[:] = end
            advance_actuators(commands, k, i * step, step, dt, P, E, actuators, mean, end)
            if k >= start:
                for c in range(count):
                    # What neither lags nor is limited in rate jumps, and is its mean all along.
                    moves = motor if c == 3 else servos and c < 3
                    first, last = (before[c], end[c]) if moves else (mean[c], mean[c])
                    over[k - start, i, 0, c], over[k - start, i, 2, c] = first, last
                    over[k - start, i, 1, c] = 1.5 * mean[c] - 0.25 * (first + last)


@jit
def to_simulation(s: Array, x: Array) -> None:
    """State of the simulation (14,) from u v w p q r phi theta psi (9,); its height stays as it is."""
    x[0], x[1] = 0.0, 0.0
    for i in range(3):
        x[3 + i], x[10 + i] = s[i], s[3 + i]
    cr, sr, cp, sp = cos(s[6] / 2), sin(s[6] / 2), cos(s[7] / 2), sin(s[7] / 2)
    cy, sy = cos(s[8] / 2), sin(s[8] / 2)
    x[6] = cr * cp * cy + sr * sp * sy
    x[7] = sr * cp * cy - cr * sp * sy
    x[8] = cr * sp * cy + sr * cp * sy
    x[9] = cr * cp * sy - sr * sp * cy
    x[13] = atan2(s[2], s[0])


@jit
def _from_simulation(x: Array, s: Array) -> None:
    for i in range(3):
        s[i], s[3 + i] = x[3 + i], x[10 + i]
    q0, q1, q2, q3 = x[6], x[7], x[8], x[9]
    s[6] = atan2(2.0 * (q2 * q3 + q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3)
    s[7] = asin(min(max(-2.0 * (q1 * q3 - q0 * q2), -1.0), 1.0))
    s[8] = atan2(2.0 * (q1 * q2 + q0 * q3), q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3)


@jit
def _step(
    s: Array, still: Array, gust: Array, over: Array, thrust: float, rho: float, dt: float, slopes: Array, P: Array,
    E: Array, C: Array, F: IntArray, K: IntArray, T: IntArray, x: Array, W: Array, scratch: Array, out: Array,
) -> None:  # fmt: skip
    """Nine states one sample later.

    still: (3,) zeros. over: (sub_steps, 3, 4 + named). thrust: N, NaN where it follows from the throttle.
    x: state of the simulation, of which the angle that a lagging lift feels, x[13], is carried on.
    """
    felt = x[13]
    to_simulation(s, x)
    x[13] = felt
    sub_steps = over.shape[0]
    for i in range(sub_steps):
        runge_kutta_along(x, over[i, 0], over[i, 1], over[i, 2], thrust, still, gust, rho, dt / sub_steps, slopes, P, E,
                          C, F, K, T, W, scratch)  # fmt: skip
    _from_simulation(x, out)


@jit
def _glance(
    s: Array, still: Array, gust: Array, over: Array, thrust: float, rho: float, time: float, share: float,
    slopes: Array, P: Array, E: Array, C: Array, F: IntArray, K: IntArray, T: IntArray, x: Array, W: Array,
    scratch: Array, middle: Array, seen: Array, out: Array,
) -> None:  # fmt: skip
    """Nine states `time` s and so a `share` of a step later, and the surfaces `seen` there; arguments of `_step`.

    x: the angle that a lagging lift feels, x[13], is there then as well. middle: as `seen`, to work in.
    """
    felt = x[13]
    to_simulation(s, x)
    x[13] = felt
    sub_steps = over.shape[0]
    whole = time / share / sub_steps
    last = min(int(share * sub_steps), sub_steps - 1)
    for i in range(last):
        runge_kutta_along(x, over[i, 0], over[i, 1], over[i, 2], thrust, still, gust, rho, whole, slopes, P, E, C, F, K,
                          T, W, scratch)  # fmt: skip
    part = share * sub_steps - last
    first, half, end = over[last, 0], over[last, 1], over[last, 2]
    for c in range(seen.size):
        # The parabola through begin, middle and end of the last sub-step.
        slope, bend = 4.0 * half[c] - 3.0 * first[c] - end[c], 2.0 * (first[c] - 2.0 * half[c] + end[c])
        middle[c] = first[c] + 0.5 * part * (slope + 0.5 * part * bend)
        seen[c] = first[c] + part * (slope + part * bend)
    if part > 0.0:
        runge_kutta_along(x, first, middle, seen, thrust, still, gust, rho, part * whole, slopes, P, E, C, F, K, T, W,
                          scratch)  # fmt: skip
    _from_simulation(x, out)


@jit
def _read(
    s: Array, still: Array, gust: Array, seen: Array, thrust: float, rho: float, interval: float, P: Array, E: Array,
    C: Array, F: IntArray, K: IntArray, T: IntArray, places: IntArray, x: Array, W: Array, rate: Array, sensor: Array,
    full: Array, out: Array,
) -> None:  # fmt: skip
    """What perfect sensors read: the channels at `places`.

    still: (3,) zeros. interval: s since the last reading, 0 for the first one.
    x: as for `_step`; sensor: memory of the sensors that lag.
    """
    felt = x[13]
    to_simulation(s, x)
    if interval > 0.0:
        x[13] = felt
    derivatives(x, seen, thrust, still, gust, rho, P, E, C, F, K, T, W, rate)
    read_sensors(x, W, P, E, interval, sensor, full)
    for j in range(places.size):
        out[j] = full[places[j]]


@jit_arrays
def predict_path(
    before: Array, gust_before: Array, after: Array, gust_after: Array, gust_over: Array, free: IntArray, over: Array,
    seen: Array, thrust: Array, rho: Array, heights: Array, dt: float, held: bool, lagging: bool, part: float, P: Array,
    E: Array, C: Array, F: IntArray, K: IntArray, T: IntArray, places: IntArray,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """One step from every sample, and what perfect sensors read there, and a part of a sample before.

    before, after: (N, 9) u v w p q r phi theta psi expected before and known after each sample. gust_before,
    gust_after: (N, 3) body-axis gusts there, gust_over: (N - 1, 3) between samples. free: states that are integrated;
    the others are imposed if `held`. over: (N, sub, 3, 4 + named), seen: (N, 4 + named) surfaces; thrust: (N,) N, NaN
    where it follows from the throttle. heights: (N,) m, 0 where no effect asks for one. lagging: whether some sensor
    lags. A lift or a sensor that lags remembers the path itself: what it feels of the past is then a function of past
    readings, as a prediction may be, though not of the filter's state. part: of a sample, above 0 where some sensors
    are delayed. Returns ahead (N - 1, 9), the channels at `places` (N, m), and the same `part` of a sample before each
    sample, on the way there from the sample before; (0, m) where `part` is 0.
    """
    n = before.shape[0]
    shown = np.empty((n if part > 0.0 else 0, places.size))
    named = count_named(F)
    glanced, middle, then, between = np.empty(9), np.empty(4 + named), np.empty(4 + named), np.empty(places.size)
    past_sensor, aside = np.zeros(SENSOR_SIZE), np.zeros(SENSOR_SIZE)
    ahead, y = np.empty((n - 1, 9)), np.empty((n, places.size))
    x, W, rate = np.zeros(STATE_SIZE), np.zeros(WORK_SIZE + named), np.zeros(STATE_SIZE)
    scratch = np.zeros((5, STATE_SIZE))
    sensor, full, still = np.zeros(SENSOR_SIZE), np.empty(19), np.zeros(3)
    slopes = np.full(6, np.nan) if held else np.zeros(0)
    remembered, unused = np.zeros(SENSOR_SIZE), np.empty(places.size)
    for k in range(n):
        interval = dt if k > 0 else 0.0
        x[2] = -heights[k]
        W[_TIME] = E[START_TIME] + k * dt
        if lagging or part > 0.0:
            remembered[:] = sensor
        _read(before[k], still, gust_before[k], seen[k], thrust[k], rho[k], interval, P, E, C, F, K, T, places, x, W,
              rate, sensor, full, y[k])  # fmt: skip
        if part > 0.0 and k > 0:
            # Where the path expects something else than a step from the sample before leads to, so it does on the way.
            aside[:] = remembered
            _read(ahead[k - 1], still, gust_before[k], seen[k], thrust[k], rho[k], interval, P, E, C, F, K, T, places,
                  x, W, rate, aside, full, between)  # fmt: skip
            for j in range(places.size):
                apart = y[k, j] - between[j]
                if 6 <= places[j] < 9:
                    apart -= 2.0 * pi * floor(apart / (2.0 * pi) + 0.5)
                shown[k, j] += (1.0 - part) * apart
        if lagging:
            # What is remembered is what was known after the sample.
            sensor[:] = remembered
            _read(after[k], still, gust_after[k], seen[k], thrust[k], rho[k], interval, P, E, C, F, K, T, places, x, W,
                  rate, sensor, full, unused)  # fmt: skip
        if part > 0.0 and k == 0:
            past_sensor[:], shown[0] = sensor, y[0]
        if k + 1 == n:
            break
        if held:
            for i in range(6):
                slopes[i] = (before[k + 1, i] - before[k, i]) / dt
            for i in free:
                if i < 6:
                    slopes[i] = np.nan
        if part > 0.0:
            share, felt = 1.0 - part, x[13]
            W[_TIME] = E[START_TIME] + (k + 0.5 * share) * dt
            _glance(after[k], still, gust_over[k], over[k], 0.5 * (thrust[k] + thrust[k + 1]), rho[k], share * dt,
                    share, slopes, P, E, C, F, K, T, x, W, scratch, middle, then, glanced)  # fmt: skip
            W[_TIME] = E[START_TIME] + (k + share) * dt
            _read(glanced, still, gust_after[k] + share * (gust_before[k + 1] - gust_after[k]), then,
                  thrust[k] + share * (thrust[k + 1] - thrust[k]), rho[k], dt, P, E, C, F, K, T, places, x, W, rate,
                  past_sensor, full, shown[k + 1])  # fmt: skip
            x[13] = felt
        W[_TIME] = E[START_TIME] + (k + 0.5) * dt
        _step(after[k], still, gust_over[k], over[k], 0.5 * (thrust[k] + thrust[k + 1]), rho[k], dt, slopes, P, E, C, F,
              K, T, x, W, scratch, ahead[k])  # fmt: skip
    return ahead, y, shown
