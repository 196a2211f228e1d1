"""Derivatives of what ideal sensors read, by state, coefficients and thrust (compiled).

They follow `sim_vehicle.physics.ideal_sensors` line by line, but for lags, which are linear in time and left to the
caller, and the wind over a height, which is an input wherever there is shear.
"""

import math

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.effects import slot
from sim_vehicle.jit import jit_fused
from sim_vehicle.physics.layout import CHANNELS, Aux, Par
from sim_vehicle.sensitivities.dynamics_jacobian import COLUMNS

Array = NDArray[np.float64]

# Channels whose derivatives are known, in the order of the rows.
READINGS = (*CHANNELS[:12], "vn", "ve", "vd")
_V, _RHO, _VB, _UB = int(Aux.V), int(Aux.rho), int(Aux.v_body), int(Aux.u_body)
_ACC, _AV, _BV = int(Par.accelerometer_x), int(Par.alpha_vane_x), int(Par.beta_vane_x)
_FLANK, _CALIBRATED = int(Par.beta_is_flank), int(Par.airspeed_is_calibrated)
_UP, _UP_K = slot("vane_upwash"), slot("vane_upwash", "scale")
_ARM, _ARM_X, _ARM_Y = slot("vane_rate_error"), slot("vane_rate_error", "x"), slot("vane_rate_error", "y")
_AIR, _AIR_K = slot("airspeed_error"), slot("airspeed_error", "scale")
_MIS = slot("accelerometer_misalignment")
_MIS_P, _MIS_R = slot("accelerometer_misalignment", "pitch"), slot("accelerometer_misalignment", "roll")
_OFF, _OFF_X = slot("accelerometer_offset"), slot("accelerometer_offset", "x")
_GYRO, _GYRO_K = slot("imu_scale"), slot("imu_scale", "scale")


@jit_fused
def euler_slopes(x: Array, slopes: Array) -> None:
    """Derivatives (3, 4) of phi, theta, psi by the quaternion of the state `x`."""
    q0, q1, q2, q3 = x[6], x[7], x[8], x[9]
    for row in range(3):
        if row == 1:
            s = 1.0 / math.sqrt(max(1.0 - (2.0 * (q0 * q2 - q1 * q3)) ** 2, 1e-12))
            slopes[1, 0], slopes[1, 1] = 2.0 * s * q2, -2.0 * s * q3
            slopes[1, 2], slopes[1, 3] = 2.0 * s * q0, -2.0 * s * q1
            continue
        # atan2(y, x) of phi turns with q1, of psi with q3; the other one of the two changes sign in x.
        sign = 1.0 if row == 0 else -1.0
        up = 2.0 * (q2 * q3 + q0 * q1) if row == 0 else 2.0 * (q1 * q2 + q0 * q3)
        along = q0 * q0 - q2 * q2 - sign * (q1 * q1 - q3 * q3)
        size = up * up + along * along
        up0, up1 = (q1, q0) if row == 0 else (q3, q2)
        up2, up3 = (q3, q2) if row == 0 else (q1, q0)
        slopes[row, 0] = 2.0 * (along * up0 - up * q0) / size
        slopes[row, 1] = 2.0 * (along * up1 + sign * up * q1) / size
        slopes[row, 2] = 2.0 * (along * up2 + up * q2) / size
        slopes[row, 3] = 2.0 * (along * up3 - sign * up * q3) / size


@jit_fused
def _air_data(x: Array, W: Array, P: Array, E: Array, wa: float, flow: Array, H: Array) -> None:
    """Rows of airspeed, alpha and beta; wa as in `flow_slopes`, flow: its result."""
    V, ua, va, p, q, r = W[_V], W[_UB], W[_VB], x[10], x[11], x[12]
    ax_arm, ay_arm, bx_arm, bz_arm = P[_AV], P[_AV + 1], P[_BV], P[_BV + 2]
    if E[_ARM] != 0.0:
        ax_arm += E[_ARM_X]
        ay_arm += E[_ARM_Y]
        bx_arm += E[_ARM_X]
    for z in range(3):
        H[0, z] = flow[0, z]
        H[1, z] = flow[1, z] + (ax_arm * q - ay_arm * p) / (V * V) * flow[0, z]
        slip = flow[2, z]
        if P[_FLANK] != 0.0:
            slip = (-va if z == 0 else ua if z == 1 else 0.0) / (ua * ua + va * va)
        H[2, z] = slip + (bz_arm * p - bx_arm * r) / (V * V) * flow[0, z]
    H[1, 3], H[1, 4] = ay_arm / V, -ax_arm / V
    H[2, 3], H[2, 5] = -bz_arm / V, bx_arm / V
    gain = math.sqrt(W[_RHO] / SEA_LEVEL_DENSITY) if P[_CALIBRATED] != 0.0 else 1.0
    if E[_AIR] != 0.0:
        gain *= 1.0 + E[_AIR_K]
    up = 1.0 + E[_UP_K] if E[_UP] != 0.0 else 1.0
    for z in range(6):
        H[0, z] *= gain
        H[1, z] *= up


@jit_fused
def _inertial(x: Array, P: Array, E: Array, R: Array, H: Array) -> None:
    """Rows of the rates and the specific forces; R: result of `force_jacobian`."""
    p, q, r = x[10], x[11], x[12]
    gyro = 1.0 + E[_GYRO_K] if E[_GYRO] != 0.0 else 1.0
    H[3, 3], H[4, 4], H[5, 5] = gyro, gyro, gyro
    rx, ry, rz = P[_ACC], P[_ACC + 1], P[_ACC + 2]
    if E[_OFF] != 0.0:
        rx, ry, rz = rx + E[_OFF_X], ry + E[_OFF_X + 1], rz + E[_OFF_X + 2]
    for z in range(COLUMNS):
        pd, qd, rd = R[3, z], R[4, z], R[5, z]
        H[9, z] = R[0, z] - rd * ry + qd * rz
        H[10, z] = R[1, z] + rd * rx - pd * rz
        H[11, z] = R[2, z] - qd * rx + pd * ry
    H[9, 3] += q * ry + r * rz
    H[9, 4] += -2.0 * q * rx + p * ry
    H[9, 5] += -2.0 * r * rx + p * rz
    H[10, 3] += q * rx - 2.0 * p * ry
    H[10, 4] += p * rx + r * rz
    H[10, 5] += -2.0 * r * ry + q * rz
    H[11, 3] += r * rx - 2.0 * p * rz
    H[11, 4] += r * ry - 2.0 * q * rz
    H[11, 5] += p * rx + q * ry
    if E[_MIS] != 0.0:
        cp, sp = math.cos(E[_MIS_P]), math.sin(E[_MIS_P])
        cr, sr = math.cos(E[_MIS_R]), math.sin(E[_MIS_R])
        for z in range(COLUMNS):
            ax, az = cp * H[9, z] - sp * H[11, z], sp * H[9, z] + cp * H[11, z]
            H[9, z] = ax
            H[10, z], H[11, z] = cr * H[10, z] + sr * az, -sr * H[10, z] + cr * az


@jit_fused
def reading_jacobian(x: Array, W: Array, wa: float, P: Array, E: Array, flow: Array, R: Array, angles: Array,
                     H: Array) -> None:  # fmt: skip
    """Jacobian of READINGS by state, coefficients and thrust.

    Parameters
    ----------
    x : Array, shape (14,)
        State (`sim_vehicle.physics.layout`), SI units and rad, as `force_jacobian` had it.
    W : Array, shape (WORK_SIZE + named,)
        Work array as `force_jacobian` left it, SI units and rad.
    wa : float
        Downward component, body axes, of the velocity against the air, m/s, as in `flow_slopes`.
    P, E : Array, shapes (PAR_SIZE,) and (slots,)
        Vehicle constants and effect vector (`sim_vehicle.physics.layout`, `sim_vehicle.effects`), SI units.
    flow : Array, shape (3, 3)
        Result of `flow_slopes`: derivatives of V, alpha and beta by the velocity, dimensionless and rad s/m.
    R : Array, shape (6, COLUMNS)
        Result of `force_jacobian`: derivatives of ax ay az [m/s^2] and p' q' r' [rad/s^2] per unit of each column.
    angles : Array, shape (3, 4)
        Result of `euler_slopes`, written over: derivatives of phi, theta, psi [rad] by the quaternion.
    H : Array, shape (15, COLUMNS)
        Result, written over: derivatives of READINGS, SI units and rad per unit of each column.
    """
    H[:] = 0.0
    _air_data(x, W, P, E, wa, flow, H)
    _inertial(x, P, E, R, H)
    euler_slopes(x, angles)
    for i in range(3):
        for j in range(4):
            H[6 + i, 6 + j] = angles[i, j]
    u, v, w = x[3], x[4], x[5]
    q0, q1, q2, q3 = x[6], x[7], x[8], x[9]
    n = 12
    H[n, 0], H[n, 1] = q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3, 2.0 * (q1 * q2 - q0 * q3)
    H[n, 2] = 2.0 * (q1 * q3 + q0 * q2)
    H[n + 1, 0], H[n + 1, 1] = 2.0 * (q1 * q2 + q0 * q3), q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3
    H[n + 1, 2], H[n + 2, 0] = 2.0 * (q2 * q3 - q0 * q1), 2.0 * (q1 * q3 - q0 * q2)
    H[n + 2, 1], H[n + 2, 2] = 2.0 * (q2 * q3 + q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3
    H[n, 6], H[n, 7] = 2.0 * (q0 * u - q3 * v + q2 * w), 2.0 * (q1 * u + q2 * v + q3 * w)
    H[n, 8], H[n, 9] = 2.0 * (-q2 * u + q1 * v + q0 * w), 2.0 * (-q3 * u - q0 * v + q1 * w)
    H[n + 1, 6], H[n + 1, 7] = 2.0 * (q3 * u + q0 * v - q1 * w), 2.0 * (q2 * u - q1 * v - q0 * w)
    H[n + 1, 8], H[n + 1, 9] = 2.0 * (q1 * u + q2 * v + q3 * w), 2.0 * (q0 * u - q3 * v + q2 * w)
    H[n + 2, 6], H[n + 2, 7] = 2.0 * (-q2 * u + q1 * v + q0 * w), 2.0 * (q3 * u + q0 * v - q1 * w)
    H[n + 2, 8], H[n + 2, 9] = 2.0 * (-q0 * u + q3 * v - q2 * w), 2.0 * (q1 * u + q2 * v + q3 * w)
