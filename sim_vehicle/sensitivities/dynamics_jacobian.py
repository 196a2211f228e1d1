"""Derivatives of the equations of motion by state, coefficients and thrust, in closed form (compiled).

They follow `sim_vehicle.physics.dynamics` line by line. Columns of every Jacobian: u v w, p q r, the quaternion (10 of
the state), then a change of CL ... Cn themselves (6) and of the thrust put in (1).
"""

import math

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.effects import THRUST_AIRSPEED, THRUST_BEND, THRUST_SLOPE, slot
from sim_vehicle.effects.battery_sag import sagged_share
from sim_vehicle.effects.elastic_tail import elastic_gain
from sim_vehicle.effects.mass_drop import remaining_mass
from sim_vehicle.effects.propwash_elevator import propwash_gain
from sim_vehicle.effects.ramp import switched
from sim_vehicle.effects.reynolds_drag import reynolds_factor
from sim_vehicle.effects.stall import flat_plate_drag, flat_plate_lift, separated_share
from sim_vehicle.jit import jit_fused
from sim_vehicle.model.aerodynamic_terms import AXES, REGRESSORS
from sim_vehicle.physics.layout import CQ_PLACE, CT_PLACE, WORK_SIZE, Aux, Par
from sim_vehicle.physics.propeller import rotor_speed, speed_slopes

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

STATE_COLUMNS = 10  # u v w p q r q0 q1 q2 q3
THRUST_COLUMN = STATE_COLUMNS + len(AXES)
COLUMNS = THRUST_COLUMN + 1
# Column of the slopes by regressors from which on those by controls of other names stand.
_NAMED = len(REGRESSORS)
_V, _RHO, _T, _CL, _TIME = int(Aux.V), int(Aux.rho), int(Aux.thrust), int(Aux.CL), int(Aux.time)
_AX, _AY, _AZ, _VB, _UB = int(Aux.ax), int(Aux.ay), int(Aux.az), int(Aux.v_body), int(Aux.u_body)
_R_ALPHA, _R_ADOT, _R_BETA, _R_P, _R_Q, _R_R, _R_CL = (
    REGRESSORS.index(name) for name in ("alpha", "alphadot", "beta", "p", "q", "r", "CL")
)
_MASS_P, _IXX, _IYY, _IZZ, _IXZ = int(Par.mass), int(Par.Ixx), int(Par.Iyy), int(Par.Izz), int(Par.Ixz)
_S, _B, _C, _G, _VREF = int(Par.S), int(Par.b), int(Par.c), int(Par.gravity), int(Par.reference_speed)
_ROT, _DIA = int(Par.rotation), int(Par.diameter)
_PX, _PY, _PZ, _PI = int(Par.propeller_x), int(Par.propeller_y), int(Par.propeller_z), int(Par.inclination)
_HAS_ADOT = int(Par.has_alphadot)
_STALL, _STALL_A, _STALL_M = slot("stall"), slot("stall", "alpha_stall"), slot("stall", "sharpness")
_WASH, _WASH_K = slot("propwash_elevator"), slot("propwash_elevator", "k")
_TAIL, _TAIL_K = slot("elastic_tail"), slot("elastic_tail", "k")
_RE, _RE_N = slot("reynolds_drag"), slot("reynolds_drag", "n")
_LINE, _LINE_Z = slot("thrust_line_offset"), slot("thrust_line_offset", "z_T")
_LOSS, _LOSS_K = slot("thrust_speed_loss"), slot("thrust_speed_loss", "dT_dV")
_TSC, _TSC_K = slot("thrust_scale"), slot("thrust_scale", "scale")
_TORQUE, _TORQUE_K = slot("propeller_torque"), slot("propeller_torque", "k_Q")
_PFAC, _PFAC_K = slot("p_factor"), slot("p_factor", "k_P")
_GYRO, _GYRO_I = slot("propeller_gyroscopic"), slot("propeller_gyroscopic", "I_P")
_NORM, _NORM_K = slot("propeller_normal_force"), slot("propeller_normal_force", "k")
_MASS, _MASS_E = slot("mass_error"), slot("mass_error", "scale")
_STEP, _STEP_T, _STEP_D = (slot("configuration_step", name) for name in ("on", "time", "duration"))
_STEP_CL = slot("configuration_step", "dCL")
_DROP, _DROP_M, _DROP_T, _DROP_D = (slot("mass_drop", name) for name in ("on", "fraction", "time", "duration"))
_SAG, _SAG_RATE = slot("battery_sag"), slot("battery_sag", "rate")
_CG, _CG_X = slot("cg_shift"), slot("cg_shift", "x")
_INERTIA, _INERTIA_E = slot("inertia_error"), slot("inertia_error", "scale")


@jit_fused
def flow_slopes(W: Array, wa: float, flow: Array) -> None:
    """Derivatives of V, alpha and beta by the velocity in body axes, into rows 0, 1 and 2 of `flow` (3, 3).

    W: work array that `derivatives` left; wa: downward component of the velocity against the air, m/s.
    """
    V, ua, va = W[_V], W[_UB], W[_VB]
    plane2 = ua * ua + wa * wa
    plane = math.sqrt(plane2)
    flow[0, 0], flow[0, 1], flow[0, 2] = ua / V, va / V, wa / V
    flow[1, 0], flow[1, 1], flow[1, 2] = -wa / plane2, 0.0, ua / plane2
    flow[2, 0], flow[2, 1], flow[2, 2] = -va * ua / (V * V * plane), plane / (V * V), -va * wa / (V * V * plane)


@jit_fused
def _slope_column(factor: int) -> int:
    """Column of D in which a factor stands: controls of other names follow the regressors."""
    return factor if factor < WORK_SIZE else factor - WORK_SIZE + _NAMED


@jit_fused
def _term_slopes(C: Array, F: IntArray, K: IntArray, T: IntArray, W: Array, tail: float, drag: float, D: Array,
                 products: Array, sums: Array) -> None:  # fmt: skip
    """Derivatives D (6, regressors + named) of the sums of terms by their regressors, products (n,) of each term's
    regressors.

    sums: (3,) results: CL of all terms, and the parts of Cm and CD that `tail` and `drag` scale, without them.
    """
    D[:] = 0.0
    sums[:] = 0.0
    for axis in range(6):
        for i in range(T[axis], T[axis + 1]):
            scale = 1.0
            if K[i] == 1:
                scale = tail
            elif K[i] == 2:
                scale = drag
            product, weight = 1.0, C[i] * scale
            one, two = F[i, 0], F[i, 1]
            if one >= 0 and two < 0:
                product = W[one]
                D[axis, _slope_column(one)] += weight
            elif two >= 0 and F[i, 2] < 0:
                product = W[one] * W[two]
                D[axis, _slope_column(one)] += weight * W[two]
                D[axis, _slope_column(two)] += weight * W[one]
            else:
                for j in range(4):
                    if F[i, j] < 0:
                        break
                    rest = 1.0
                    for other in range(4):
                        if F[i, other] < 0:
                            break
                        if other != j:
                            rest *= W[F[i, other]]
                    D[axis, _slope_column(F[i, j])] += weight * rest
                    product *= W[F[i, j]]
            products[i] = scale * product
            if axis == 0:
                sums[0] += C[i] * product
            elif K[i] == 1:
                sums[1] += C[i] * product
            elif K[i] == 2:
                sums[2] += C[i] * product


@jit_fused
def _separate(alpha: float, alpha_stall: float, sharpness: float, T: IntArray, CL: float, D: Array,
              products: Array) -> None:  # fmt: skip
    """Let the stall fade the slopes of lift and add those of the flat plate; CL: of the attached flow."""
    share = separated_share(alpha, alpha_stall, sharpness)
    above = math.exp(-sharpness * (alpha - alpha_stall))
    below = math.exp(sharpness * (alpha + alpha_stall))
    slope = sharpness * (
        (below - above) / ((1.0 + above) * (1.0 + below)) - share * (below / (1.0 + below) - above / (1.0 + above))
    )
    sa, ca = math.sin(alpha), math.cos(alpha)
    for j in range(D.shape[1]):
        D[0, j] *= 1.0 - share
    for i in range(T[0], T[1]):
        products[i] *= 1.0 - share
    plate = math.copysign(2.0, alpha) * (2.0 * sa * ca * ca - sa * sa * sa)
    D[0, _R_ALPHA] += slope * (flat_plate_lift(alpha) - CL) + share * plate
    D[1, _R_ALPHA] += slope * flat_plate_drag(alpha) + share * 6.0 * abs(sa) * sa * ca


@jit_fused
def _factors(W: Array, P: Array, E: Array, qS: float) -> tuple[float, float, float, float, float]:
    """Factor on the elevator's moment and its slopes by V and thrust; factor on CD_0 and its slope by V."""
    V = W[_V]
    wash, elastic, drag = 1.0, 1.0, 1.0
    wash_V, wash_T, elastic_V, drag_V = 0.0, 0.0, 0.0, 0.0
    if E[_WASH] != 0.0:
        wash = propwash_gain(W[_T], qS, E[_WASH_K])
        wash_V, wash_T = -2.0 * (wash - 1.0) / V, E[_WASH_K] / qS
    if E[_TAIL] != 0.0:
        qbar, reference = qS / P[_S], 0.5 * SEA_LEVEL_DENSITY * P[_VREF] * P[_VREF]
        elastic = elastic_gain(qbar, reference, E[_TAIL_K])
        elastic_V = -2.0 * E[_TAIL_K] * qbar / (reference * V)
    if E[_RE] != 0.0:
        drag = reynolds_factor(V, P[_VREF], E[_RE_N])
        drag_V = -E[_RE_N] * drag / V
    return wash * elastic, wash_V * elastic + wash * elastic_V, wash_T * elastic, drag, drag_V


@jit_fused
def _thrust_slopes(x: Array, throttle: float, W: Array, P: Array, E: Array, by_T: Array, by_flow: Array) -> None:
    """Slopes of the propeller's forces and moments.

    by_T: (5,) of X, Z, L, M, N by thrust. by_flow: (7,) of Z by alpha, M by beta, N by alpha, M by r, N by q, L by V,
    N by V.
    """
    thrust, alpha, beta = W[_T], W[0], W[2]
    by_flow[:] = 0.0
    along, across = (math.cos(P[_PI]), math.sin(P[_PI])) if P[_PI] != 0.0 else (1.0, 0.0)
    by_T[0], by_T[1] = along, -across
    by_T[2] = -P[_PY] * across
    by_T[3] = P[_PZ] * by_T[0] - P[_PX] * by_T[1]
    by_T[4] = -P[_PY] * by_T[0]
    if E[_NORM] != 0.0:
        by_T[1] -= E[_NORM_K] * alpha
        by_flow[0] = -E[_NORM_K] * thrust
    if E[_LINE] != 0.0:
        by_T[3] += E[_LINE_Z]
    if E[_TORQUE] != 0.0:
        by_T[2] -= P[_ROT] * E[_TORQUE_K]
    if E[_PFAC] != 0.0:
        arm = -P[_ROT] * E[_PFAC_K] * P[_DIA]
        by_T[3] += arm * beta
        by_T[4] += arm * alpha
        by_flow[1] = by_flow[2] = arm * thrust
    torque_V = P[_ROT] * speed_slopes(throttle, W[_V], W[_RHO], P)[1]
    by_flow[5], by_flow[6] = -torque_V * along, torque_V * across
    if E[_GYRO] != 0.0:
        momentum = E[_GYRO_I] * P[_ROT] * rotor_speed(throttle, thrust, P)
        by_flow[3], by_flow[4] = -momentum, momentum
        if P[CT_PLACE] == 0.0 and P[CQ_PLACE] == 0.0 and thrust > 0.0:
            # The speed follows from the thrust, by its square root.
            by_T[3] -= 0.5 * momentum / thrust * x[12]
            by_T[4] += 0.5 * momentum / thrust * x[11]


@jit_fused
def _coefficient_slopes(W: Array, P: Array, flow: Array, D: Array, J: Array) -> None:
    """Jacobian J (6, COLUMNS) of CL ... Cn at a fixed CL regressor and alphadot."""
    V = W[_V]
    span, chord = P[_B] / (2.0 * V), P[_C] / (2.0 * V)
    J[:] = 0.0
    for axis in range(6):
        fading = (D[axis, _R_P] * W[_R_P] + D[axis, _R_Q] * W[_R_Q] + D[axis, _R_R] * W[_R_R]) / V
        for z in range(3):
            J[axis, z] = D[axis, _R_ALPHA] * flow[1, z] + D[axis, _R_BETA] * flow[2, z] - fading * flow[0, z]
        J[axis, 3], J[axis, 4], J[axis, 5] = D[axis, _R_P] * span, D[axis, _R_Q] * chord, D[axis, _R_R] * span
        J[axis, STATE_COLUMNS + axis] = 1.0


@jit_fused
def _alphadot_slopes(x: Array, W: Array, P: Array, mass: float, fx: float, fz: float, wa: float, qS: float,
                     flow: Array, by_T: Array, normal_slope: float, D: Array, J: Array,
                     row: Array) -> None:  # fmt: skip
    """Derivatives `row` (COLUMNS,) of the nondimensional angle-of-attack rate, from the implicit equation

    alpha' (ua^2 + wa^2) = ua w' - wa u', in which w' and u' hold the lift that alpha' itself changes.
    """
    V, ua, va, CL = W[_V], W[_UB], W[_VB], W[_CL]
    p, q, r = x[10], x[11], x[12]
    q0, q1, q2, q3 = x[6], x[7], x[8], x[9]
    g = P[_G]
    plane2 = ua * ua + wa * wa
    plane = math.sqrt(plane2)
    chord = P[_C] / (2.0 * V)
    rate = W[_R_ADOT] / chord
    ahead = fx / mass + g * 2.0 * (q1 * q3 - q0 * q2) + r * va - q * wa
    down = fz / mass + g * (q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3) + q * ua - p * va
    lift = qS * CL / mass
    row[:] = 0.0
    # ua w' - wa u' without what follows from a change of CL, by u v w ...
    row[0] = down + ua * q - lift * ua / plane - rate * 2.0 * ua
    row[1] = -ua * p - wa * r
    row[2] = -ahead + wa * q - lift * wa / plane - rate * 2.0 * wa
    for z in range(3):
        row[z] += ua * normal_slope / mass * flow[1, z] - 2.0 * lift * plane / V * flow[0, z]
    # ... p q r, the quaternion (gravity) and thrust.
    row[3], row[4], row[5] = -ua * va, plane2, -wa * va
    row[6], row[7] = 2.0 * g * (ua * q0 + wa * q2), 2.0 * g * (-ua * q1 - wa * q3)
    row[8], row[9] = 2.0 * g * (-ua * q2 + wa * q0), 2.0 * g * (ua * q3 - wa * q1)
    row[THRUST_COLUMN] = (ua * by_T[1] - wa * by_T[0]) / mass
    back = chord * qS / (mass * plane)
    for z in range(COLUMNS):
        row[z] = chord / plane2 * row[z] - back * J[0, z]
    for z in range(3):
        row[z] -= W[_R_ADOT] / V * flow[0, z]
    for z in range(COLUMNS):
        row[z] /= 1.0 + back * D[0, _R_ADOT]


@jit_fused
def _accelerations(x: Array, W: Array, P: Array, E: Array, mass: float, fx: float, fz: float, wa: float, qS: float,
                   flow: Array, by_T: Array, by_flow: Array, J: Array, R: Array) -> None:  # fmt: skip
    """Jacobian R (6, COLUMNS) of ax ay az p' q' r' from that of the coefficients, J."""
    V, b, c = W[_V], P[_B], P[_C]
    p, q, r = x[10], x[11], x[12]
    plane = math.sqrt(W[_UB] * W[_UB] + wa * wa)
    ca, sa = W[_UB] / plane, wa / plane
    scale = 1.0 + E[_INERTIA_E] if E[_INERTIA] != 0.0 else 1.0
    Ixx, Iyy, Izz, Ixz = P[_IXX] * scale, P[_IYY] * scale, P[_IZZ] * scale, P[_IXZ] * scale
    CL, CD = W[_CL], W[_CL + 1]
    for z in range(COLUMNS):
        R[0, z] = qS / mass * (-ca * J[1, z] + sa * J[0, z])
        R[1, z] = qS / mass * J[2, z]
        R[2, z] = qS / mass * (-sa * J[1, z] - ca * J[0, z])
        R[3, z], R[4, z], R[5, z] = qS * b * J[3, z], qS * c * J[4, z], qS * b * J[5, z]
    for z in range(3):
        pressure, turn, slip = 2.0 / V * flow[0, z], flow[1, z], flow[2, z]
        R[0, z] += (W[_AX] - fx / mass) * pressure + qS / mass * (CD * sa + CL * ca) * turn
        R[1, z] += W[_AY] * pressure
        R[2, z] += (W[_AZ] - fz / mass) * pressure + (qS * (-CD * ca + CL * sa) + by_flow[0]) / mass * turn
        R[3, z] += qS * b * W[_CL + 3] * pressure + by_flow[5] * flow[0, z]
        R[4, z] += qS * c * W[_CL + 4] * pressure + by_flow[1] * slip
        R[5, z] += qS * b * W[_CL + 5] * pressure + by_flow[2] * turn + by_flow[6] * flow[0, z]
    R[0, THRUST_COLUMN] += by_T[0] / mass
    R[2, THRUST_COLUMN] += by_T[1] / mass
    for j in range(3):
        R[3 + j, THRUST_COLUMN] += by_T[2 + j]
    if E[_CG] != 0.0:
        for z in range(COLUMNS):
            R[4, z] += mass * E[_CG_X] * R[2, z]
            R[5, z] -= mass * E[_CG_X] * R[1, z]
    R[3, 3] += Ixz * q
    R[3, 4] += Ixz * p - (Izz - Iyy) * r
    R[3, 5] -= (Izz - Iyy) * q
    R[4, 3] -= (Ixx - Izz) * r + 2.0 * Ixz * p
    R[4, 5] += by_flow[3] - (Ixx - Izz) * p + 2.0 * Ixz * r
    R[5, 3] -= (Iyy - Ixx) * q
    R[5, 4] += by_flow[4] - Ixz * r - (Iyy - Ixx) * p
    R[5, 5] -= Ixz * q
    determinant = Ixx * Izz - Ixz * Ixz
    by_roll, by_pitch, by_yaw, crossed = Izz / determinant, 1.0 / Iyy, Ixx / determinant, Ixz / determinant
    for z in range(COLUMNS):
        left, right = R[3, z], R[5, z]
        R[3, z] = by_roll * left + crossed * right
        R[4, z] *= by_pitch
        R[5, z] = crossed * left + by_yaw * right


@jit_fused
def force_jacobian(x: Array, surfaces: Array, by_throttle: bool, gust: Array, P: Array, E: Array, C: Array,
                   F: IntArray, K: IntArray, T: IntArray, W: Array, flow: Array, D: Array, J: Array, work: Array,
                   products: Array, R: Array) -> None:  # fmt: skip
    """Jacobian of ax ay az and p' q' r' where `derivatives` has just been evaluated.

    The wind is nil, no lift lags and no ground is near.

    Parameters
    ----------
    x : Array, shape (14,)
        State as `derivatives` had it (`sim_vehicle.physics.layout`), SI units and rad.
    surfaces : Array, shape (4 + named,)
        de, da, dr [rad], throttle (0 to 1) and controls of other names, as `derivatives` had them.
    by_throttle : bool
        Whether thrust followed from the throttle.
    gust : Array, shape (3,)
        Velocity of the air in body axes, m/s, as `derivatives` had it.
    P, E : Array, shapes (PAR_SIZE,) and (slots,)
        Vehicle constants and effect vector (`sim_vehicle.physics.layout`, `sim_vehicle.effects`), SI units.
    C : Array, shape (n,)
        Values of the aerodynamic terms, dimensionless.
    F, K, T : IntArray, shapes (n, 4), (n,) and (7,)
        Factor indices, kinds and axis bounds of the aerodynamic terms.
    W : Array, shape (WORK_SIZE + named,)
        Work array as `derivatives` left it, SI units and rad.
    flow : Array, shape (3, 3)
        Result of `flow_slopes`, written over: derivatives of V, alpha and beta by the velocity, dimensionless and
        rad s/m.
    D : Array, shape (6, regressors + named)
        Work, written over.
    J : Array, shape (6, COLUMNS)
        Work, written over.
    work : Array, shape (4, COLUMNS)
        Work, written over.
    products : Array, shape (n,)
        Result, written over: what a term's coefficient is multiplied by, dimensionless, so that dR/dC_i is products[i]
        times the column of the term's axis.
    R : Array, shape (6, COLUMNS)
        Result, written over: derivatives of ax ay az [m/s^2] and p' q' r' [rad/s^2] per unit of each column.
    """
    V, wa = W[_V], x[5] - gust[2]
    mass = P[_MASS_P] * (1.0 + E[_MASS_E]) if E[_MASS] != 0.0 else P[_MASS_P]
    if E[_DROP] != 0.0:
        mass = remaining_mass(mass, E[_DROP_M], switched(W[_TIME], E[_DROP_T], E[_DROP_D]))
    qS = 0.5 * W[_RHO] * V * V * P[_S]
    by_T, by_flow, sums, row = work[0], work[1], work[2], work[3]
    flow_slopes(W, wa, flow)
    tail, tail_V, tail_T, drag, drag_V = _factors(W, P, E, qS)
    _term_slopes(C, F, K, T, W, tail, drag, D, products, sums)
    if E[_STALL] != 0.0:
        if E[_STEP] != 0.0:
            sums[0] += E[_STEP_CL] * switched(W[_TIME], E[_STEP_T], E[_STEP_D])
        _separate(W[0], E[_STALL_A], E[_STALL_M], T, sums[0], D, products)
    _thrust_slopes(x, surfaces[3], W, P, E, by_T, by_flow)
    fx, fz = by_T[0] * W[_T], by_T[1] * W[_T]
    _coefficient_slopes(W, P, flow, D, J)
    for z in range(3):
        J[1, z] += sums[2] * drag_V * flow[0, z]
        J[4, z] += sums[1] * tail_V * flow[0, z]
    J[4, THRUST_COLUMN] = sums[1] * tail_T
    if P[_HAS_ADOT] != 0.0:
        _alphadot_slopes(x, W, P, mass, fx, fz, wa, qS, flow, by_T, by_flow[0], D, J, row)
        for axis in range(6):
            for z in range(COLUMNS):
                J[axis, z] += D[axis, _R_ADOT] * row[z]
    for axis in range(1, 6):
        if D[axis, _R_CL] != 0.0:
            for z in range(COLUMNS):
                J[axis, z] += D[axis, _R_CL] * J[0, z]
    _accelerations(x, W, P, E, mass, fx, fz, wa, qS, flow, by_T, by_flow, J, R)
    gain = 1.0 + E[_TSC_K] if E[_TSC] != 0.0 else 1.0
    loss = gain * surfaces[3] * E[_LOSS_K] if E[_LOSS] != 0.0 else 0.0
    if by_throttle:
        left = sagged_share(W[_TIME], E[_SAG_RATE]) if E[_SAG] != 0.0 else 1.0
        loss += gain * left * speed_slopes(surfaces[3], V, W[_RHO], P)[0]
    else:
        loss += gain * (E[THRUST_SLOPE] + 2.0 * E[THRUST_BEND] * (V - E[THRUST_AIRSPEED]))
    if loss != 0.0 or gain != 1.0:
        for j in range(6):
            for z in range(3):
                R[j, z] += R[j, THRUST_COLUMN] * loss * flow[0, z]
            R[j, THRUST_COLUMN] *= gain
