"""Thrust and torque of the propeller from its speed and the airspeed (compiled)."""

import math

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit, jit_arrays
from sim_vehicle.physics.layout import CQ_PLACE, CT_PLACE, CURVE_COEFFICIENTS, Par

Array = NDArray[np.float64]

_TMAX, _ROTOR, _DIA = int(Par.max_thrust), int(Par.max_rotor_rad_s), int(Par.diameter)
_PIECE = 1 + CURVE_COEFFICIENTS
# Revolutions a second below which a propeller counts as turning this slowly: V / (n D) stays finite.
_SLOWEST = 1e-3


@jit
def curve(P: Array, at: int, J: float) -> tuple[float, float]:
    """Value and slope at advance ratio J of the curve packed from P[at] on, straight beyond its ends."""
    count = int(P[at])
    inside: float = min(max(J, P[at + 2]), P[at + 1])
    piece = 0
    while piece + 1 < count and inside >= P[at + 2 + (piece + 1) * _PIECE]:
        piece += 1
    begin = at + 2 + piece * _PIECE
    x = inside - P[begin]
    value: float = 0.0
    slope: float = 0.0
    for i in range(_PIECE - 1, 0, -1):
        slope = slope * x + value
        value = value * x + P[begin + i]
    return value + slope * (J - inside), slope


@jit
def throttle_thrust(throttle: float, V: float, rho: float, P: Array) -> float:
    """Thrust at a throttle and an airspeed.

    By CT over advance ratio where the vehicle has it, else in proportion to the throttle.

    Parameters
    ----------
    throttle : float
        Throttle behind the motor's lag: the share of its full speed at which the propeller turns, 0 to 1.
    V : float
        Airspeed, m/s.
    rho : float
        Air density, kg/m^3.
    P : Array, shape (PAR_SIZE,)
        Vehicle constants (`sim_vehicle.physics.layout`), SI units.

    Returns
    -------
    float
        Thrust, N.
    """
    if P[CT_PLACE] == 0.0:
        proportional: float = P[_TMAX] * throttle
        return proportional
    n: float = max(throttle * P[_ROTOR] / (2.0 * math.pi), _SLOWEST)
    D: float = P[_DIA]
    return rho * n * n * D * D * D * D * curve(P, CT_PLACE, V / (n * D))[0]


@jit
def throttle_torque(throttle: float, V: float, rho: float, P: Array) -> float:
    """Torque [N m] that the propeller takes, 0 where CQ is unknown."""
    if P[CQ_PLACE] == 0.0:
        return 0.0
    n: float = max(throttle * P[_ROTOR] / (2.0 * math.pi), _SLOWEST)
    D: float = P[_DIA]
    return rho * n * n * D * D * D * D * D * curve(P, CQ_PLACE, V / (n * D))[0]


@jit
def speed_slopes(throttle: float, V: float, rho: float, P: Array) -> tuple[float, float]:
    """Derivatives of `throttle_thrust` and `throttle_torque` by the airspeed.

    Parameters
    ----------
    throttle : float
        Throttle behind the motor's lag: the share of its full speed at which the propeller turns, 0 to 1.
    V : float
        Airspeed, m/s.
    rho : float
        Air density, kg/m^3.
    P : Array, shape (PAR_SIZE,)
        Vehicle constants (`sim_vehicle.physics.layout`), SI units.

    Returns
    -------
    by_thrust : float
        Derivative of the thrust, N s/m; 0 where CT is unknown.
    by_torque : float
        Derivative of the torque, N s; 0 where CQ is unknown.
    """
    n: float = max(throttle * P[_ROTOR] / (2.0 * math.pi), _SLOWEST)
    D: float = P[_DIA]
    by_thrust, by_torque = 0.0, 0.0
    if P[CT_PLACE] != 0.0:
        by_thrust = rho * n * D * D * D * curve(P, CT_PLACE, V / (n * D))[1]
    if P[CQ_PLACE] != 0.0:
        by_torque = rho * n * D * D * D * D * curve(P, CQ_PLACE, V / (n * D))[1]
    return by_thrust, by_torque


@jit
def rotor_speed(throttle: float, thrust: float, P: Array) -> float:
    """Speed of the propeller: by the throttle where CT or CQ is known, else thrust goes with its square.

    Parameters
    ----------
    throttle : float
        Throttle behind the motor's lag, 0 to 1.
    thrust : float
        Thrust, N.
    P : Array, shape (PAR_SIZE,)
        Vehicle constants (`sim_vehicle.physics.layout`), SI units.

    Returns
    -------
    float
        Speed of the propeller, rad/s.
    """
    if P[CT_PLACE] != 0.0 or P[CQ_PLACE] != 0.0:
        turning: float = P[_ROTOR] * throttle
        return turning
    speed: float = P[_ROTOR] * math.sqrt(max(thrust / max(P[_TMAX], 1e-9), 0.0))
    return speed


@jit_arrays
def along(throttle: Array, V: Array, rho: Array, P: Array) -> tuple[Array, Array]:
    """Thrust and torque at every sample of a flight.

    Parameters
    ----------
    throttle : Array, shape (N,)
        Throttle behind the motor's lag, 0 to 1, as of `throttle_thrust`.
    V : Array, shape (N,)
        Airspeed, m/s.
    rho : Array, shape (N,)
        Air density, kg/m^3.
    P : Array, shape (PAR_SIZE,)
        Vehicle constants (`sim_vehicle.physics.layout`), SI units.

    Returns
    -------
    thrust : Array, shape (N,)
        Thrust, N.
    torque : Array, shape (N,)
        Torque that the propeller takes, N m.
    """
    thrust, torque = np.empty(throttle.size), np.empty(throttle.size)
    for i in range(throttle.size):
        thrust[i] = throttle_thrust(throttle[i], V[i], rho[i], P)
        torque[i] = throttle_torque(throttle[i], V[i], rho[i], P)
    return thrust, torque
