"""The kinematic equations and their readings about a trajectory, with their gradients in closed form (compiled).

They follow `sysid.compatibility.kinematics` and `true_outputs` of `sysid.compatibility.ekf` line by line; the gradients
of a step are carried through the very Runge-Kutta stages that it makes.
"""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np

from sim_vehicle.jit import jit, jit_arrays
from sysid.arrays import Array
from sysid.compatibility.ekf import sensor_model, true_outputs
from sysid.compatibility.kinematics import derivative, midpoints

# Of a step: by the state and the IMU's six biases. Of readings: by the state and the gust.
_BY, _READINGS, _BY_GUST = 12, 9, 9
_SLOWEST = 0.1  # m/s, as true_outputs has it


@jit
def _rate_slopes(x: Array, imu: Array, gravity: float, T: Array, out: Array) -> None:
    """Gradient `out` (6, 12) of `derivative` where the state (6,) has the gradient T (6, 12); imu: without its bias."""
    sf, cf, st, ct = sin(x[3]), cos(x[3]), sin(x[4]), cos(x[4])
    p, q, r = imu[3], imu[4], imu[5]
    turn, across, lean = q * sf + r * cf, q * cf - r * sf, st / ct
    by_phi, by_theta = across * lean, turn / (ct * ct)
    heading_phi, heading_theta = across / ct, turn * lean / ct
    for c in range(_BY):
        u, v, w, phi, theta = T[0, c], T[1, c], T[2, c], T[3, c], T[4, c]
        out[0, c] = r * v - q * w - gravity * ct * theta
        out[1, c] = p * w - r * u + gravity * (ct * cf * phi - st * sf * theta)
        out[2, c] = q * u - p * v - gravity * (ct * sf * phi + st * cf * theta)
        out[3, c] = by_phi * phi + by_theta * theta
        out[4, c] = -turn * phi
        out[5, c] = heading_phi * phi + heading_theta * theta
    # A bias is taken off what was measured.
    out[0, 6], out[1, 7], out[2, 8] = out[0, 6] - 1.0, out[1, 7] - 1.0, out[2, 8] - 1.0
    out[1, 9], out[2, 9], out[3, 9] = out[1, 9] - x[2], out[2, 9] + x[1], out[3, 9] - 1.0
    out[0, 10], out[2, 10], out[3, 10] = out[0, 10] + x[2], out[2, 10] - x[0], out[3, 10] - lean * sf
    out[4, 10], out[5, 10] = out[4, 10] - cf, out[5, 10] - sf / ct
    out[0, 11], out[1, 11], out[3, 11] = out[0, 11] - x[1], out[1, 11] + x[0], out[3, 11] - lean * cf
    out[4, 11], out[5, 11] = out[4, 11] + sf, out[5, 11] - cf / ct


@jit
def _linearise_step(
    x: Array, imu_now: Array, imu_mid: Array, imu_next: Array, bias: Array, dt: float, gravity: float, work: Array,
    tangents: Array, f: Array, ahead: Array,
) -> None:  # fmt: skip
    """Next state (6,) and its gradient f (6, 12) to the state and the six IMU biases.

    bias: (6,) taken off the readings. work: (3, 6), tangents: (2, 6, 12): work.
    """
    rate, trial, imu = work[0], work[1], work[2]
    T, slopes = tangents[0], tangents[1]
    for i in range(6):
        ahead[i] = trial[i] = x[i]
        for c in range(_BY):
            f[i, c] = T[i, c] = 1.0 if i == c else 0.0
    for stage in range(4):
        for i in range(6):
            measured = imu_now[i] if stage == 0 else imu_next[i] if stage == 3 else imu_mid[i]
            imu[i] = measured - bias[i]
        derivative(trial, imu, gravity, rate)
        _rate_slopes(trial, imu, gravity, T, slopes)
        weight = dt / 6.0 if stage == 0 or stage == 3 else dt / 3.0
        share = dt if stage == 2 else 0.5 * dt
        for i in range(6):
            ahead[i] += weight * rate[i]
            trial[i] = x[i] + share * rate[i]
            for c in range(_BY):
                f[i, c] += weight * slopes[i, c]
                T[i, c] = share * slopes[i, c]
            T[i, i] += 1.0


@jit
def _turn_slopes(angles: Array, R: Array, turned: Array) -> None:
    """Rotation R (3, 3) from body to earth axes, and its gradients turned (3, 3, 3) by phi, theta, psi."""
    sf, cf, st, ct = sin(angles[0]), cos(angles[0]), sin(angles[1]), cos(angles[1])
    sp, cp = sin(angles[2]), cos(angles[2])
    R[0, 0], R[0, 1], R[0, 2] = ct * cp, sf * st * cp - cf * sp, cf * st * cp + sf * sp
    R[1, 0], R[1, 1], R[1, 2] = ct * sp, sf * st * sp + cf * cp, cf * st * sp - sf * cp
    R[2, 0], R[2, 1], R[2, 2] = -st, sf * ct, cf * ct
    turned[1, 0, 0], turned[1, 1, 0], turned[1, 2, 0] = -st * cp, -st * sp, -ct
    for i in range(3):
        turned[0, i, 0], turned[0, i, 1], turned[0, i, 2] = 0.0, R[i, 2], -R[i, 1]
        turned[1, i, 1], turned[1, i, 2] = sf * R[i, 0], cf * R[i, 0]
        turned[2, 0, i], turned[2, 1, i], turned[2, 2, i] = -R[1, i], R[0, i], 0.0


@jit
def _flow_slopes(rates: Array, layout: Array, flow: Array, by_flow: Array) -> None:
    """Gradients by_flow (3, 3) of airspeed, alpha and beta, as they are read, by the velocity against the air (3,)."""
    u, v, w = flow[0], flow[1], flow[2]
    speed = sqrt(u * u + v * v + w * w)
    moves = 1.0 if speed > _SLOWEST else 0.0
    speed = max(speed, _SLOWEST)
    plane2 = max(u * u + w * w, 1e-12)
    plane = sqrt(plane2)
    alpha_arm = (layout[1] * rates[1] - layout[2] * rates[0]) / (speed * speed)
    beta_arm = (layout[4] * rates[0] - layout[3] * rates[2]) / (speed * speed)
    for i in range(3):
        by_flow[0, i] = moves * flow[i] / speed
    by_flow[1, 0], by_flow[1, 1], by_flow[1, 2] = -w / plane2, 0.0, u / plane2
    if layout[5] > 0.5:
        side2 = max(u * u + v * v, 1e-12)
        by_flow[2, 0], by_flow[2, 1], by_flow[2, 2] = -v / side2, u / side2, 0.0
    else:
        turn = v / (speed * speed * plane)
        by_flow[2, 0], by_flow[2, 1], by_flow[2, 2] = -turn * u, plane / (speed * speed), -turn * w
    for i in range(3):
        by_flow[1, i] += alpha_arm * by_flow[0, i]
        by_flow[2, i] += beta_arm * by_flow[0, i]
        by_flow[0, i] /= layout[0]


@jit
def _linearise_outputs(
    x: Array, gust: Array, rates: Array, layout: Array, theta: Array, work: Array, turned: Array, predicted: Array,
    h: Array,
) -> None:  # fmt: skip
    """Predicted readings (9,) and their gradient h (9, 9) to state and gust at a nominal point.

    work: (9, 9), turned: (3, 3, 3): work.
    """
    y, flow = work[8], work[6]
    R, by_flow = work[:3, :3], work[3:6, :3]
    true_outputs(x, gust, rates, layout, y)
    sensor_model(y, theta, predicted)
    _turn_slopes(x[3:], R, turned)
    for i in range(3):
        flow[i] = x[i] - (R[0, i] * gust[0] + R[1, i] * gust[1] + R[2, i] * gust[2])
    _flow_slopes(rates, layout, flow, by_flow)
    for j in range(_READINGS):
        for a in range(_BY_GUST):
            h[j, a] = 0.0
    for j in range(3):
        for i in range(3):
            h[j, i] = by_flow[j, i]
            for k in range(3):
                h[j, 6 + k] -= by_flow[j, i] * R[k, i]
                h[j, 3 + k] -= by_flow[j, i] * (
                    turned[k, 0, i] * gust[0] + turned[k, 1, i] * gust[1] + turned[k, 2, i] * gust[2]
                )
    for j in range(3):
        h[3 + j, 3 + j] = 1.0
        for i in range(3):
            h[6 + j, i] = R[j, i]
            h[6 + j, 3 + i] = turned[i, j, 0] * x[0] + turned[i, j, 1] * x[1] + turned[i, j, 2] * x[2]
    for a in range(_BY_GUST):
        h[0, a] *= 1.0 + theta[10]
        h[1, a] *= 1.0 + theta[6]
        h[2, a] *= 1.0 + theta[8]
        h[4, a] *= 1.0 + theta[13]


@jit_arrays
def linearise_part(
    nominal: Array, gusts: Array, theta: Array, imu: Array, dt: float, layout: Array
) -> tuple[Array, Array, Array, Array]:
    """The equations about a trajectory of one part, which hold whatever the noise.

    nominal: (N, 6), gusts: (N, 3) trajectory. theta: (18,) sensor errors. imu: (N, 6). dt: s. layout: (7,), see
    true_outputs. Returns predicted readings (N, 9), their gradients H (N, 9, 9) by state and gust, each next state
    (N, 6) and its gradients F (N, 6, 12) by the state and the IMU's biases, the last of both 0.
    """
    n = nominal.shape[0]
    predicted, slopes = np.empty((n, _READINGS)), np.empty((n, _READINGS, _BY_GUST))
    ahead, steps = np.zeros((n, 6)), np.zeros((n, 6, _BY))
    rates, at_outputs, turned = np.empty(3), np.empty((9, _READINGS)), np.empty((3, 3, 3))
    at_step, tangents, middle = np.empty((3, 6)), np.empty((2, 6, _BY)), midpoints(imu)
    for i in range(n):
        for a in range(3):
            rates[a] = imu[i, 3 + a] - theta[3 + a]
        _linearise_outputs(nominal[i], gusts[i], rates, layout, theta, at_outputs, turned, predicted[i], slopes[i])
        if i + 1 < n:
            _linearise_step(
                nominal[i], imu[i], middle[i], imu[i + 1], theta[:6], dt, layout[6], at_step, tangents, steps[i],
                ahead[i],
            )  # fmt: skip
    return predicted, slopes, ahead, steps
