"""Equations of motion of a rigid aircraft over a flat earth (compiled).

Stevens & Lewis, Aircraft Control and Simulation, ch. 1.7 and 3; moments with Ixz. The aerodynamic model is a table of
terms, so that another model needs no compilation. CL is summed first, then everything that may use it.
"""

import math

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.effects import THRUST_AIRSPEED, THRUST_BEND, THRUST_SLOPE, slot
from sim_vehicle.effects.battery_sag import sagged_share
from sim_vehicle.effects.cg_shift import shift_moment
from sim_vehicle.effects.elastic_tail import elastic_gain
from sim_vehicle.effects.ground_effect import nearness
from sim_vehicle.effects.mass_drop import remaining_mass
from sim_vehicle.effects.propeller import gyroscopic_moment, normal_force, p_factor_moment, torque_roll
from sim_vehicle.effects.propwash_elevator import propwash_gain
from sim_vehicle.effects.ramp import switched
from sim_vehicle.effects.reynolds_drag import reynolds_factor
from sim_vehicle.effects.stall import flat_plate_drag, flat_plate_lift, separated_share
from sim_vehicle.effects.thrust_line_offset import thrust_line_moment
from sim_vehicle.effects.thrust_scale import scaled_thrust
from sim_vehicle.effects.thrust_speed_loss import speed_thrust
from sim_vehicle.effects.unsteady_lift import lag_rate
from sim_vehicle.effects.wind_shear import sheared_wind
from sim_vehicle.jit import jit, jit_inlined
from sim_vehicle.model.aerodynamic_terms import REGRESSORS
from sim_vehicle.physics.layout import WORK_SIZE, Aux, Par
from sim_vehicle.physics.propeller import rotor_speed, throttle_thrust, throttle_torque
from sim_vehicle.physics.rotation import rotation_matrix

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_STALL, _STALL_A, _STALL_M = slot("stall"), slot("stall", "alpha_stall"), slot("stall", "sharpness")
_WASH, _WASH_K = slot("propwash_elevator"), slot("propwash_elevator", "k")
_TAIL, _TAIL_K = slot("elastic_tail"), slot("elastic_tail", "k")
_RE, _RE_N = slot("reynolds_drag"), slot("reynolds_drag", "n")
_SLOW, _SLOW_TAU = slot("unsteady_lift"), slot("unsteady_lift", "tau")
_LINE, _LINE_Z = slot("thrust_line_offset"), slot("thrust_line_offset", "z_T")
_LOSS, _LOSS_K = slot("thrust_speed_loss"), slot("thrust_speed_loss", "dT_dV")
_TSC, _TSC_K = slot("thrust_scale"), slot("thrust_scale", "scale")
_TORQUE, _TORQUE_K = slot("propeller_torque"), slot("propeller_torque", "k_Q")
_PFAC, _PFAC_K = slot("p_factor"), slot("p_factor", "k_P")
_GYRO, _GYRO_I = slot("propeller_gyroscopic"), slot("propeller_gyroscopic", "I_P")
_NORM, _NORM_K = slot("propeller_normal_force"), slot("propeller_normal_force", "k")
_RHO, _RHO_E = slot("density_error"), slot("density_error", "scale")
_MASS, _MASS_E = slot("mass_error"), slot("mass_error", "scale")
_INERTIA, _INERTIA_E = slot("inertia_error"), slot("inertia_error", "scale")
_STEP, _STEP_T, _STEP_D = (slot("configuration_step", name) for name in ("on", "time", "duration"))
_STEP_CL, _STEP_CD, _STEP_CM = (slot("configuration_step", name) for name in ("dCL", "dCD", "dCm"))
_DROP, _DROP_M, _DROP_T, _DROP_D = (slot("mass_drop", name) for name in ("on", "fraction", "time", "duration"))
_SAG, _SAG_RATE = slot("battery_sag"), slot("battery_sag", "rate")
_NEAR, _NEAR_CL, _NEAR_CD = (slot("ground_effect", name) for name in ("on", "lift_gain", "drag_reduction"))
_CG, _CG_X = slot("cg_shift"), slot("cg_shift", "x")
_SHEAR, _SHEAR_G = slot("wind_shear"), slot("wind_shear", "gradient")

_MASS_P, _IXX, _IYY, _IZZ, _IXZ = int(Par.mass), int(Par.Ixx), int(Par.Iyy), int(Par.Izz), int(Par.Ixz)
_S, _B, _C, _G, _VREF = int(Par.S), int(Par.b), int(Par.c), int(Par.gravity), int(Par.reference_speed)
_ROT, _DIA = int(Par.rotation), int(Par.diameter)
_PX, _PY, _PZ, _PI = int(Par.propeller_x), int(Par.propeller_y), int(Par.propeller_z), int(Par.inclination)
_HAS_ADOT = int(Par.has_alphadot)
_R_CL, _R_ADOT = REGRESSORS.index("CL"), REGRESSORS.index("alphadot")
_V, _ALPHA, _BETA, _AX, _AY, _AZ = (int(i) for i in (Aux.V, Aux.alpha, Aux.beta, Aux.ax, Aux.ay, Aux.az))
_PD, _QD, _RD, _AD = int(Aux.p_dot), int(Aux.q_dot), int(Aux.r_dot), int(Aux.alpha_dot)
_T, _RHO_W, _CL_W, _VB, _UB = int(Aux.thrust), int(Aux.rho), int(Aux.CL), int(Aux.v_body), int(Aux.u_body)
_TIME = int(Aux.time)

# Kinds of term that an effect may scale.
PLAIN, ELEVATOR_MOMENT, ZERO_LIFT_DRAG, INDUCED_DRAG = 0, 1, 2, 3


@jit
def _sum_terms(
    C: Array, F: IntArray, K: IntArray, first: int, last: int, W: Array, tail: float, drag: float, induced: float
) -> float:
    total = 0.0
    for i in range(first, last):
        value = C[i]
        for j in range(4):
            factor = F[i, j]
            if factor < 0:
                break
            value *= W[factor]
        if K[i] == 1:
            value *= tail
        elif K[i] == 2:
            value *= drag
        elif K[i] == 3:
            value *= induced
        total += value
    return total


@jit
def _lift(
    E: Array, C: Array, F: IntArray, K: IntArray, T: IntArray, W: Array, alpha: float, lift_alpha: float, near: float
) -> float:
    """CL of the terms, felt at `lift_alpha` where lift lags, as the configuration and the ground change it, faded by
    the stall; near: see `nearness`."""
    W[0] = lift_alpha
    CL = _sum_terms(C, F, K, T[0], T[1], W, 1.0, 1.0, 1.0)
    W[0] = alpha
    if E[_STEP] != 0.0:
        CL += E[_STEP_CL] * switched(W[_TIME], E[_STEP_T], E[_STEP_D])
    if near != 0.0:
        CL *= 1.0 + E[_NEAR_CL] * near
    if E[_STALL] != 0.0:
        share = separated_share(alpha, E[_STALL_A], E[_STALL_M])
        CL = (1.0 - share) * CL + share * flat_plate_lift(alpha)
    return CL


@jit_inlined
def _thrust(thrust: float, throttle: float, V: float, rho: float, time: float, P: Array, E: Array) -> float:
    """Thrust, N, as measured or by the throttle where `thrust` is NaN, after what effects make of it."""
    if np.isnan(thrust):
        thrust = throttle_thrust(throttle, V, rho, P)
        if E[_SAG] != 0.0:
            thrust *= sagged_share(time, E[_SAG_RATE])
    elif E[THRUST_SLOPE] != 0.0 or E[THRUST_BEND] != 0.0:
        faster = V - E[THRUST_AIRSPEED]
        thrust += (E[THRUST_SLOPE] + E[THRUST_BEND] * faster) * faster
    if E[_LOSS] != 0.0:
        thrust += speed_thrust(throttle, V, P[_VREF], E[_LOSS_K])
    if E[_TSC] != 0.0:
        thrust = scaled_thrust(thrust, E[_TSC_K])
    return thrust


@jit_inlined
def _propeller_loads(
    throttle: float, thrust: float, alpha: float, beta: float, V: float, q: float, r: float, rho: float, P: Array,
    E: Array,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """Forces x and z, N, and moments about the centre of gravity, N m, of the propeller in body axes."""
    # Mostly the propeller's axis is that of the body, and a sine takes as long as all the rest.
    along, across = (math.cos(P[_PI]), math.sin(P[_PI])) if P[_PI] != 0.0 else (1.0, 0.0)
    fx, fz = thrust * along, -thrust * across
    ly = -P[_PY] * thrust * across
    my = P[_PZ] * fx - P[_PX] * fz
    nz = -P[_PY] * fx
    torque = P[_ROT] * throttle_torque(throttle, V, rho, P)
    ly -= torque * along
    nz += torque * across
    if E[_NORM] != 0.0:
        fz -= normal_force(thrust, alpha, E[_NORM_K])
    if E[_LINE] != 0.0:
        my += thrust_line_moment(thrust, E[_LINE_Z])
    if E[_TORQUE] != 0.0:
        ly += torque_roll(thrust, P[_ROT], E[_TORQUE_K])
    if E[_PFAC] != 0.0:
        nz += p_factor_moment(thrust, P[_DIA], alpha, P[_ROT], E[_PFAC_K])
        my += p_factor_moment(thrust, P[_DIA], beta, P[_ROT], E[_PFAC_K])
    if E[_GYRO] != 0.0:
        rotor = P[_ROT] * rotor_speed(throttle, thrust, P)
        my -= gyroscopic_moment(rotor, r, E[_GYRO_I])
        nz += gyroscopic_moment(rotor, q, E[_GYRO_I])
    return fx, fz, ly, my, nz


@jit_inlined
def _add_alpha_rate(
    CL: float, E: Array, C: Array, F: IntArray, K: IntArray, T: IntArray, W: Array, lift_alpha: float, near: float,
    x: Array, flow: tuple[float, float, float], force: tuple[float, float], weight: tuple[float, float],
    mass: float, qS: float, half_chord: float, ca: float, sa: float,
) -> float:  # fmt: skip
    """CL with the rate of the angle of attack, into W, where a term asks for it: it depends on lift itself, linearly.

    CL: without that rate. flow: velocity against the air, m/s. force, weight: propeller's force, N, and gravity, m/s^2,
    along x and z. qS: dynamic pressure times area, N. half_chord: c / 2V, s. ca, sa: of alpha.
    """
    ua, va, wa = flow
    fx, fz = force
    gx, gz = weight
    alpha, p, q, r = W[0], x[10], x[11], x[12]
    flow2 = max(ua * ua + wa * wa, 0.01)
    ud = fx / mass + qS * CL * sa / mass + gx + r * va - q * wa
    wd = fz / mass - qS * CL * ca / mass + gz + q * ua - p * va
    W[_R_ADOT] = 1.0
    slope = _lift(E, C, F, K, T, W, alpha, lift_alpha, near) - CL
    free = (ua * wd - wa * ud) / flow2
    alpha_dot = free / (1.0 + qS / mass * slope * half_chord / math.sqrt(flow2))
    W[_R_ADOT] = alpha_dot * half_chord
    W[_AD] = alpha_dot
    CL += slope * W[_R_ADOT]
    return CL


@jit_inlined
def _coefficients(
    alpha: float, V: float, thrust: float, qS: float, qbar: float, near: float, P: Array, E: Array, C: Array,
    F: IntArray, K: IntArray, T: IntArray, W: Array,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """CD, CY, Cl, Cm and Cn."""
    drag_factor = 1.0
    if E[_RE] != 0.0:
        drag_factor = reynolds_factor(V, P[_VREF], E[_RE_N])
    tail_factor = 1.0
    if E[_WASH] != 0.0:
        tail_factor *= propwash_gain(thrust, qS, E[_WASH_K])
    if E[_TAIL] != 0.0:
        tail_factor *= elastic_gain(qbar, 0.5 * SEA_LEVEL_DENSITY * P[_VREF] * P[_VREF], E[_TAIL_K])
    CD = _sum_terms(C, F, K, T[1], T[2], W, 1.0, drag_factor, 1.0 - E[_NEAR_CD] * near)
    if E[_STALL] != 0.0:
        CD += separated_share(alpha, E[_STALL_A], E[_STALL_M]) * flat_plate_drag(alpha)
    CY = _sum_terms(C, F, K, T[2], T[3], W, 1.0, 1.0, 1.0)
    Cl = _sum_terms(C, F, K, T[3], T[4], W, 1.0, 1.0, 1.0)
    Cm = _sum_terms(C, F, K, T[4], T[5], W, tail_factor, 1.0, 1.0)
    Cn = _sum_terms(C, F, K, T[5], T[6], W, 1.0, 1.0, 1.0)
    if E[_STEP] != 0.0:
        share = switched(W[_TIME], E[_STEP_T], E[_STEP_D])
        CD += E[_STEP_CD] * share
        Cm += E[_STEP_CM] * share
    return CD, CY, Cl, Cm, Cn


@jit_inlined
def _rigid_body_rates(
    x: Array, R: tuple[float, float, float, float, float, float, float, float, float], P: Array, E: Array,
    specific_force: tuple[float, float, float], moments: tuple[float, float, float], rate: Array,
) -> None:  # fmt: skip
    """Rates of position, velocity, quaternion and angular velocity from the specific force, m/s^2, and moments, N m.

    R: rotation from earth to body axes, row by row.
    """
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = R
    ax, ay, az = specific_force
    L, M, N = moments
    u, v, w, p, q, r = x[3], x[4], x[5], x[10], x[11], x[12]
    q0, q1, q2, q3 = x[6], x[7], x[8], x[9]
    gravity = P[_G]
    Ixx, Iyy, Izz, Ixz = P[_IXX], P[_IYY], P[_IZZ], P[_IXZ]
    if E[_INERTIA] != 0.0:
        scale = 1.0 + E[_INERTIA_E]
        Ixx, Iyy, Izz, Ixz = Ixx * scale, Iyy * scale, Izz * scale, Ixz * scale
    left = L + Ixz * p * q - (Izz - Iyy) * q * r
    right = N - Ixz * q * r - (Iyy - Ixx) * p * q
    determinant = Ixx * Izz - Ixz * Ixz

    rate[0] = r11 * u + r21 * v + r31 * w
    rate[1] = r12 * u + r22 * v + r32 * w
    rate[2] = r13 * u + r23 * v + r33 * w
    rate[3] = ax + gravity * r13 + r * v - q * w
    rate[4] = ay + gravity * r23 + p * w - r * u
    rate[5] = az + gravity * r33 + q * u - p * v
    if E[_SHEAR] != 0.0:
        rate[0] += sheared_wind(E[_SHEAR_G], -x[2])
        gained = sheared_wind(E[_SHEAR_G], -rate[2])
        rate[3], rate[4], rate[5] = rate[3] - gained * r11, rate[4] - gained * r21, rate[5] - gained * r31
    rate[6] = 0.5 * (-q1 * p - q2 * q - q3 * r)
    rate[7] = 0.5 * (q0 * p + q2 * r - q3 * q)
    rate[8] = 0.5 * (q0 * q - q1 * r + q3 * p)
    rate[9] = 0.5 * (q0 * r + q1 * q - q2 * p)
    rate[10] = (Izz * left + Ixz * right) / determinant
    rate[11] = (M - (Ixx - Izz) * p * r - Ixz * (p * p - r * r)) / Iyy
    rate[12] = (Ixz * left + Ixx * right) / determinant


@jit
def derivatives(
    x: Array, surfaces: Array, thrust: float, wind: Array, gust: Array, rho: float, P: Array, E: Array,
    C: Array, F: IntArray, K: IntArray, T: IntArray, W: Array, rate: Array,
) -> None:  # fmt: skip
    """Rates of the state.

    Where the effect vector has a wind shear, u v w are against the air that it moves, which is at rest at a height of
    0, and `wind` does not hold it.

    Parameters
    ----------
    x : Array, shape (14,)
        State (`sim_vehicle.physics.layout`), SI units and rad.
    surfaces : Array, shape (4 + named,) or longer
        de, da, dr [rad], throttle (0 to 1) and the controls of other names that the model has terms of.
    thrust : float
        Thrust as measured, N, NaN where it follows from the throttle; before propulsion effects.
    wind : Array, shape (3,)
        Velocity of the air, north east down, m/s.
    gust : Array, shape (3,)
        Velocity of the air in body axes on top, m/s.
    rho : float
        Air density, kg/m^3.
    P, E : Array, shapes (PAR_SIZE,) and (slots,)
        Vehicle constants and effect vector (`sim_vehicle.physics.layout`, `sim_vehicle.effects`), SI units.
    C : Array, shape (n,)
        Values of the aerodynamic terms, dimensionless.
    F, K, T : IntArray, shapes (n, 4), (n,) and (7,)
        Factor indices, kinds and axis bounds of the aerodynamic terms.
    W : Array, shape (WORK_SIZE + named,)
        Work array, holds the by-products (`Aux`) afterwards, SI units and rad; its `time` [s] stays as it came.
    rate : Array, shape (14,)
        Result, written over: rate of the state, its units per second.

    References
    ----------
    Stevens & Lewis, Aircraft Control and Simulation, chapters 1.7 and 3.
    """
    R = rotation_matrix(x[6], x[7], x[8], x[9])
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = R
    p, q, r = x[10], x[11], x[12]
    ua = x[3] - (r11 * wind[0] + r12 * wind[1] + r13 * wind[2]) - gust[0]
    va = x[4] - (r21 * wind[0] + r22 * wind[1] + r23 * wind[2]) - gust[1]
    wa = x[5] - (r31 * wind[0] + r32 * wind[1] + r33 * wind[2]) - gust[2]
    V = max(math.sqrt(ua * ua + va * va + wa * wa), 0.1)
    alpha = math.atan2(wa, ua)
    beta = math.asin(min(max(va / V, -1.0), 1.0))
    if E[_RHO] != 0.0:
        rho = rho * (1.0 + E[_RHO_E])
    mass, S, b, c = P[_MASS_P], P[_S], P[_B], P[_C]
    if E[_MASS] != 0.0:
        mass *= 1.0 + E[_MASS_E]
    if E[_DROP] != 0.0:
        mass = remaining_mass(mass, E[_DROP_M], switched(W[_TIME], E[_DROP_T], E[_DROP_D]))
    near = nearness(-x[2], b) if E[_NEAR] != 0.0 else 0.0
    qbar = 0.5 * rho * V * V
    qS = qbar * S
    thrust = _thrust(thrust, surfaces[3], V, rho, W[_TIME], P, E)

    W[0], W[1], W[2] = alpha, 0.0, beta
    W[3], W[4], W[5] = p * b / (2.0 * V), q * c / (2.0 * V), r * b / (2.0 * V)
    W[6], W[7], W[8], W[10] = surfaces[0], surfaces[1], surfaces[2], surfaces[3]
    for j in range(W.size - WORK_SIZE):
        W[WORK_SIZE + j] = surfaces[4 + j]
    lift_alpha = alpha
    rate[13] = 0.0
    if E[_SLOW] != 0.0:
        lift_alpha = x[13]
        rate[13] = lag_rate(alpha, x[13], E[_SLOW_TAU])
    fx, fz, ly, my, nz = _propeller_loads(surfaces[3], thrust, alpha, beta, V, q, r, rho, P, E)

    plane = math.sqrt(ua * ua + wa * wa)
    ca, sa = (ua / plane, wa / plane) if plane > 0.0 else (1.0, 0.0)
    CL = _lift(E, C, F, K, T, W, alpha, lift_alpha, near)
    W[_AD] = 0.0
    if P[_HAS_ADOT] != 0.0:
        weight = (P[_G] * r13, P[_G] * r33)
        flow, half_chord = (ua, va, wa), c / (2.0 * V)
        CL = _add_alpha_rate(
            CL, E, C, F, K, T, W, lift_alpha, near, x, flow, (fx, fz), weight, mass, qS, half_chord, ca, sa
        )  # fmt: skip
    W[_R_CL] = CL
    CD, CY, Cl, Cm, Cn = _coefficients(alpha, V, thrust, qS, qbar, near, P, E, C, F, K, T, W)
    ax = (fx + qS * (-CD * ca + CL * sa)) / mass
    ay = qS * CY / mass
    az = (fz + qS * (-CD * sa - CL * ca)) / mass
    if E[_CG] != 0.0:
        my += shift_moment(E[_CG_X], mass, az)
        nz -= shift_moment(E[_CG_X], mass, ay)
    _rigid_body_rates(x, R, P, E, (ax, ay, az), (ly + qS * b * Cl, my + qS * c * Cm, nz + qS * b * Cn), rate)

    W[_V], W[_ALPHA], W[_BETA], W[_AX], W[_AY], W[_AZ] = V, alpha, beta, ax, ay, az
    W[_PD], W[_QD], W[_RD], W[_T], W[_RHO_W] = rate[10], rate[11], rate[12], thrust, rho
    W[_CL_W], W[_CL_W + 1], W[_CL_W + 2] = CL, CD, CY
    W[_CL_W + 3], W[_CL_W + 4], W[_CL_W + 5] = Cl, Cm, Cn
    W[_VB], W[_UB] = va, ua


@jit
def _lead(slopes: Array, rate: Array) -> None:
    """Put the finite ones of `slopes` (6,), or none of (0,), in the place of the rates of u v w p q r."""
    for i in range(slopes.size):
        if np.isfinite(slopes[i]):
            rate[3 + i if i < 3 else 7 + i] = slopes[i]


@jit
def runge_kutta_step(
    x: Array, surfaces: Array, thrust: float, wind: Array, gust: Array, rho: float, step: float, slopes: Array,
    P: Array, E: Array, C: Array, F: IntArray, K: IntArray, T: IntArray, W: Array, scratch: Array,
) -> None:  # fmt: skip
    """Advance `x` in place by `step` seconds, classical fourth-order Runge-Kutta; scratch: (5, 14).

    slopes: (6,) rates of u v w p q r that are imposed, NaN where they follow from the equations; (0,) where all do.
    """
    runge_kutta_along(x, surfaces, surfaces, surfaces, thrust, wind, gust, rho, step, slopes, P, E, C, F, K, T, W,
                      scratch)  # fmt: skip


@jit
def runge_kutta_along(
    x: Array, first: Array, middle: Array, last: Array, thrust: float, wind: Array, gust: Array, rho: float,
    step: float, slopes: Array, P: Array, E: Array, C: Array, F: IntArray, K: IntArray, T: IntArray, W: Array,
    scratch: Array,
) -> None:  # fmt: skip
    """Advance the state by one step as `runge_kutta_step` does, with surfaces that move.

    Parameters
    ----------
    x : Array, shape (14,)
        State (`sim_vehicle.physics.layout`), SI units and rad; changed in place.
    first, middle, last : Array, shape (4 + named,) or longer
        de, da, dr [rad], throttle (0 to 1) and controls of other names at the step's begin, in its middle and at its
        end.
    thrust : float
        Thrust as measured, N, NaN where it follows from the throttle.
    wind : Array, shape (3,)
        Velocity of the air, north east down, m/s.
    gust : Array, shape (3,)
        Velocity of the air in body axes on top, m/s.
    rho : float
        Air density, kg/m^3.
    step : float
        Length of the step, s.
    slopes : Array, shape (6,) or (0,)
        Rates of u v w [m/s^2] and p q r [rad/s^2] that are imposed, NaN where they follow from the equations; (0,)
        where all do.
    P, E : Array, shapes (PAR_SIZE,) and (slots,)
        Vehicle constants and effect vector (`sim_vehicle.physics.layout`, `sim_vehicle.effects`), SI units.
    C : Array, shape (n,)
        Values of the aerodynamic terms, dimensionless.
    F, K, T : IntArray, shapes (n, 4), (n,) and (7,)
        Factor indices, kinds and axis bounds of the aerodynamic terms.
    W : Array, shape (WORK_SIZE + named,)
        Work array as of `derivatives`, SI units and rad.
    scratch : Array, shape (5, 14)
        Work, written over.
    """
    k1, k2, k3, k4, y = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
    n = x.size
    derivatives(x, first, thrust, wind, gust, rho, P, E, C, F, K, T, W, k1)
    _lead(slopes, k1)
    for i in range(n):
        y[i] = x[i] + 0.5 * step * k1[i]
    derivatives(y, middle, thrust, wind, gust, rho, P, E, C, F, K, T, W, k2)
    _lead(slopes, k2)
    for i in range(n):
        y[i] = x[i] + 0.5 * step * k2[i]
    derivatives(y, middle, thrust, wind, gust, rho, P, E, C, F, K, T, W, k3)
    _lead(slopes, k3)
    for i in range(n):
        y[i] = x[i] + step * k3[i]
    derivatives(y, last, thrust, wind, gust, rho, P, E, C, F, K, T, W, k4)
    _lead(slopes, k4)
    for i in range(n):
        x[i] += step / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
    norm = math.sqrt(x[6] * x[6] + x[7] * x[7] + x[8] * x[8] + x[9] * x[9])
    for i in range(6, 10):
        x[i] /= norm
