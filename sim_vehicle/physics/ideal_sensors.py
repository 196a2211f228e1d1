"""What ideal sensors at their mounting places read, sensor effects included (compiled)."""

import math

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.effects import SENSOR_LAGS, slot
from sim_vehicle.effects.actuator import after_backlash
from sim_vehicle.effects.sensor import ramp_lag
from sim_vehicle.effects.wind_shear import sheared_wind
from sim_vehicle.jit import jit
from sim_vehicle.physics.layout import CHANNELS, THRUST_PLAY_PLACE, Aux, Par
from sim_vehicle.physics.rotation import euler_angles, rotation_matrix

Array = NDArray[np.float64]

_UP, _UP_K, _UP_B = slot("vane_upwash"), slot("vane_upwash", "scale"), slot("vane_upwash", "bias")
_ARM, _ARM_X, _ARM_Y = slot("vane_rate_error"), slot("vane_rate_error", "x"), slot("vane_rate_error", "y")
_AIR, _AIR_K, _AIR_B = slot("airspeed_error"), slot("airspeed_error", "scale"), slot("airspeed_error", "bias")
_MIS = slot("accelerometer_misalignment")
_MIS_P, _MIS_R = slot("accelerometer_misalignment", "pitch"), slot("accelerometer_misalignment", "roll")
_OFF, _OFF_X = slot("accelerometer_offset"), slot("accelerometer_offset", "x")
_GYRO, _GYRO_K, _GYRO_B = slot("imu_scale"), slot("imu_scale", "scale"), slot("imu_scale", "bias")
_HYST, _HYST_W = slot("thrust_sensor_hysteresis"), slot("thrust_sensor_hysteresis", "width")
_TSC, _TSC_K = slot("thrust_scale"), slot("thrust_scale", "scale")
# Of every lag: its switch, its time constant, the channel that lags.
_LAGS = np.array(
    [
        (slot(name), slot(name, "tau"), CHANNELS.index(output))
        for name, outputs in SENSOR_LAGS.items()
        for output in outputs
    ]
)
_SHEAR, _SHEAR_G = slot("wind_shear"), slot("wind_shear", "gradient")
_V, _ALPHA, _BETA, _AX, _AY, _AZ = (int(i) for i in (Aux.V, Aux.alpha, Aux.beta, Aux.ax, Aux.ay, Aux.az))
_PD, _QD, _RD, _T, _RHO = (int(i) for i in (Aux.p_dot, Aux.q_dot, Aux.r_dot, Aux.thrust, Aux.rho))
_VB, _UB = int(Aux.v_body), int(Aux.u_body)
_ACC, _AV, _BV = int(Par.accelerometer_x), int(Par.alpha_vane_x), int(Par.beta_vane_x)
_MOVING = int(Par.moving_mass)
_FLANK, _CALIBRATED = int(Par.beta_is_flank), int(Par.airspeed_is_calibrated)


@jit
def _lagged(sensor: Array, index: int, value: float, interval: float, tau: float) -> float:
    """Pass `value` through the lag at `index`; an interval of 0 starts it at rest."""
    if interval > 0.0 and tau > 0.0:
        output = ramp_lag(sensor[2 * index], value, sensor[2 * index + 1], interval, tau)
    else:
        output = value
    sensor[2 * index] = value
    sensor[2 * index + 1] = output
    return output


@jit
def _played(sensor: Array, index: int, value: float, interval: float, width: float) -> float:
    """Pass `value` through the play at `index`; an interval of 0 starts it in the middle of its width."""
    output = after_backlash(sensor[2 * index + 1], value, width) if interval > 0.0 else value
    sensor[2 * index] = value
    sensor[2 * index + 1] = output
    return output


@jit
def read_sensors(x: Array, W: Array, P: Array, E: Array, interval: float, sensor: Array, y: Array) -> None:
    """Readings from the state and the by-products of the equations of motion.

    Parameters
    ----------
    x : Array, shape (14,)
        State (`sim_vehicle.physics.layout`), SI units and rad.
    W : Array, shape (WORK_SIZE + named,)
        Work array that `derivatives` left there, SI units and rad.
    P, E : Array, shapes (PAR_SIZE,) and (slots,)
        Vehicle constants and effect vector (`sim_vehicle.physics.layout`, `sim_vehicle.effects`), SI units.
    interval : float
        Time since the last reading, s; 0 at the start.
    sensor : Array, shape (SENSOR_SIZE,)
        Memory of lags and of the thrust sensor, in the readings' units; changed in place.
    y : Array, shape (19,)
        Result, written over: readings in the order of CHANNELS, SI units and rad.
    """
    p, q, r = x[10], x[11], x[12]
    V, alpha = W[_V], W[_ALPHA]
    beta = math.atan2(W[_VB], W[_UB]) if P[_FLANK] != 0.0 else W[_BETA]
    ax_arm, ay_arm, bx_arm, bz_arm = P[_AV], P[_AV + 1], P[_BV], P[_BV + 2]
    if E[_ARM] != 0.0:
        ax_arm += E[_ARM_X]
        ay_arm += E[_ARM_Y]
        bx_arm += E[_ARM_X]
    alpha += -ax_arm * q / V + ay_arm * p / V
    beta += bx_arm * r / V - bz_arm * p / V
    if E[_UP] != 0.0:
        alpha = (1.0 + E[_UP_K]) * alpha + E[_UP_B]
    airspeed = V
    if P[_CALIBRATED] != 0.0:
        airspeed *= math.sqrt(W[_RHO] / SEA_LEVEL_DENSITY)
    if E[_AIR] != 0.0:
        airspeed = (1.0 + E[_AIR_K]) * airspeed + E[_AIR_B]

    rx, ry, rz = P[_ACC], P[_ACC + 1], P[_ACC + 2]
    if E[_OFF] != 0.0:
        rx, ry, rz = rx + E[_OFF_X], ry + E[_OFF_X + 1], rz + E[_OFF_X + 2]
    pd, qd, rd = W[_PD], W[_QD], W[_RD]
    ax = W[_AX] - (q * q + r * r) * rx + (p * q - rd) * ry + (p * r + qd) * rz
    ay = W[_AY] + (p * q + rd) * rx - (p * p + r * r) * ry + (q * r - pd) * rz
    az = W[_AZ] + (p * r - qd) * rx + (q * r + pd) * ry - (p * p + q * q) * rz
    if E[_MIS] != 0.0:
        cp, sp = math.cos(E[_MIS_P]), math.sin(E[_MIS_P])
        cr, sr = math.cos(E[_MIS_R]), math.sin(E[_MIS_R])
        ax, az = cp * ax - sp * az, sp * ax + cp * az
        ay, az = cr * ay + sr * az, -sr * ay + cr * az
    if E[_GYRO] != 0.0:
        scale, bias = 1.0 + E[_GYRO_K], E[_GYRO_B]
        p, q, r = scale * p + bias, scale * q + bias, scale * r + bias

    phi, theta, psi = euler_angles(x[6], x[7], x[8], x[9])
    u, v, w = x[3], x[4], x[5]
    y[0], y[1], y[2] = airspeed, alpha, beta
    y[3], y[4], y[5], y[6], y[7], y[8] = p, q, r, phi, theta, psi
    y[9], y[10], y[11] = ax, ay, az
    # The cell carries the propeller's pull less what accelerates the motor that hangs on it.
    thrust = W[_T] / (1.0 + E[_TSC_K]) if E[_TSC] != 0.0 else W[_T]
    y[12] = thrust - P[_MOVING] * W[_AX]
    if E[_HYST] != 0.0:
        y[12] = _played(sensor, THRUST_PLAY_PLACE, y[12], interval, E[_HYST_W])
    y[13] = -x[2]
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation_matrix(x[6], x[7], x[8], x[9])
    y[14] = r11 * u + r21 * v + r31 * w
    if E[_SHEAR] != 0.0:
        y[14] += sheared_wind(E[_SHEAR_G], -x[2])
    y[15] = r12 * u + r22 * v + r32 * w
    y[16] = r13 * u + r23 * v + r33 * w
    y[17], y[18] = x[0], x[1]
    for index in range(_LAGS.shape[0]):
        if E[_LAGS[index, 0]] != 0.0:
            channel = _LAGS[index, 2]
            y[channel] = _lagged(sensor, index, y[channel], interval, E[_LAGS[index, 1]])
