"""The paper's aircraft described as well as its suite is known: what a user who calibrated everything would write."""

from __future__ import annotations

import math
from dataclasses import replace

from sim_vehicle.flight.sensor_suite import TABLE_II
from sim_vehicle.vehicle.controls import DEFLECTION_SIGNALS
from sim_vehicle.vehicle.strict_toml import Known
from sim_vehicle.vehicle.vehicle_file import Vehicle

AT_ONCE = Known(0.0, 0.0)
# What a bench leaves of zeros that Table II has none of: angles, rad, and gains.
_ZERO, _GAIN = math.radians(0.03), 0.001


def with_table_two(vehicle: Vehicle) -> Vehicle:
    """The vehicle with servos and sensors that neither lag nor come late, and Table II's errors for their sizes."""
    controls = {
        name: replace(one, delay=AT_ONCE, lag=AT_ONCE, backlash=AT_ONCE) if name in DEFLECTION_SIGNALS else one
        for name, one in vehicle.controls.items()
    }
    told = vehicle.sensors
    vane = {"scale_std": TABLE_II["alpha"].scale, "bias_std": _ZERO, "delay": AT_ONCE, "lag": AT_ONCE}
    air = {"scale_std": _GAIN, "bias_std": 0.0, "position_error_std": 0.0, "delay": AT_ONCE, "lag": AT_ONCE}
    sensors = replace(
        told,
        alpha_vane=replace(told.alpha_vane, **vane),
        beta_vane=replace(told.beta_vane, **vane),
        airspeed=replace(told.airspeed, **air),
        accelerometer=replace(told.accelerometer, bias_std=TABLE_II["ax"].bias),
        gyro=replace(told.gyro, bias_std=TABLE_II["q"].bias),
        attitude=replace(told.attitude, bias_std=_ZERO),
        thrust=replace(told.thrust, scale_std=_GAIN),
    )
    return replace(vehicle, controls=controls, sensors=sensors)
