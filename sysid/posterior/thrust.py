"""Thrust by the propeller's speed, where no sensor measures it."""

from __future__ import annotations

import numpy as np

from sim_vehicle.model.model_file import Model
from sim_vehicle.physics.propeller import throttle_thrust
from sim_vehicle.vehicle.flat_model import flatten
from sim_vehicle.vehicle.propulsion import rotor_scale
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array


def thrust_by_speed(rpm: Array, airspeed: Array, rho: Array, vehicle: Vehicle) -> Array:
    """(N,) N, of a propeller that turns at rpm, 1/min, in an airspeed, m/s, and air of density rho, kg/m3.

    By CT(J) of [propulsion], else by max_thrust (rpm / max_rpm)^2.
    """
    propulsion = vehicle.propulsion
    assert propulsion is not None
    share = rpm * 2.0 * np.pi / 60.0 / rotor_scale(propulsion)
    if not propulsion.CT:
        assert propulsion.max_thrust is not None
        return np.asarray(propulsion.max_thrust * share * np.abs(share))
    packed = flatten(vehicle, Model(vehicle.name, {})).P
    rows = zip(share.tolist(), airspeed.tolist(), rho.tolist(), strict=True)
    return np.array([throttle_thrust(turning, speed, density, packed) for turning, speed, density in rows])
