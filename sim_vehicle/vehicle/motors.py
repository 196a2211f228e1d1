"""Several motors: the thrust of all together, and the moments that they make beyond those of the sum on its own line.

The moments are nondimensional, as if they were of the air: inputs of the simulation that the model has a term of 1 of.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.physics.propeller import along
from sim_vehicle.vehicle.packed_model import flatten_vehicle
from sim_vehicle.vehicle.vehicle_file import Vehicle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MotorLoads:
    """What the motors of a vehicle do at N moments. thrust: (N,) N, of all. moments: (N, 3) coefficients of roll, pitch
    and yaw that the sum of the thrust on the vehicle's own line does not make.
    """

    thrust: Array
    moments: Array


def motor_loads(vehicle: Vehicle, throttle: Mapping[str, Array], airspeed: Array, rho: Array) -> MotorLoads:
    """Thrust and moments of all motors of a vehicle.

    Parameters
    ----------
    vehicle : Vehicle
        With motors, each with its own law and line.
    throttle : Mapping of str to Array, shape (N,) each
        Motor -> its throttle behind its lag, 0 to 1.
    airspeed : Array, shape (N,)
        True airspeed, m/s.
    rho : Array, shape (N,)
        Air density, kg/m^3.

    Returns
    -------
    MotorLoads
        At the N moments.
    """
    assert vehicle.propulsion is not None
    thrust, turning = np.zeros(airspeed.size), np.zeros((airspeed.size, 3))
    line = np.array(vehicle.propulsion.line)
    for name, motor in vehicle.motors.items():
        P = flatten_vehicle(replace(vehicle, propulsion=motor))
        pull, torque = along(np.ascontiguousarray(throttle[name]), airspeed, rho, P)
        axis = np.array([np.cos(motor.inclination), 0.0, -np.sin(motor.inclination)])
        turning += np.outer(pull, np.cross(np.array(motor.line) - line, axis))
        turning += np.outer(torque, axis if motor.rotation == "ccw" else -axis)
        thrust += pull
    size = vehicle.geometry
    pressure = np.maximum(0.5 * rho * airspeed**2, 1e-6)[:, None] * size.S
    return MotorLoads(thrust, turning / (pressure * np.array([size.b, size.c, size.b])))
