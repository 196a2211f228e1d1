"""The paper's MAV as an output-error problem, with the unknowns that published bounds of it count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from one_record import make_record

from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.output_error.estimator import OutputError
from sysid.problem.free_parameters import coefficient, sensor_error
from sysid.problem.predictor import Predictor
from sysid.signals.flight import FlightData
from sysid.signals.record import LONGITUDINAL, Record

Array = NDArray[np.float64]

AERODYNAMIC = ("CL_0", "CL_alpha", "CL_de", "CD_0", "CD_k", "Cm_0", "Cm_alpha", "Cm_de")
SENSORS = ("accel_bias_x", "accel_bias_z", "gyro_bias_q", "alpha_scale", "theta_scale")


def vehicle() -> Vehicle:
    """The packaged aircraft as the independent truth has it: sensors at the centre of gravity, sea-level air."""
    packaged = load_vehicle("iitb-mav")
    assert packaged.propulsion is not None
    sensors = {
        name: replace(packaged.sensors[name], position=(0.0, 0.0, 0.0))
        for name in ("accelerometer", "alpha_vane", "beta_vane")
    }
    return replace(
        packaged,
        sensors=replace(packaged.sensors, **sensors),
        propulsion=replace(packaged.propulsion, moving_mass=0.0, line=(0.0, 0.0, 0.0)),
        environment=replace(packaged.environment, air_density=1.225),
    )


def longitudinal_record(data: FlightData) -> Record:
    """The whole flight with the lateral states held at zero."""
    n = data.time_s.size
    record = make_record(data, vehicle(), 0, n)
    held = np.full((n, 9), np.nan)
    held[:, [1, 3, 5, 6, 8]] = 0.0
    return replace(record, imposed_states=held)


def problem(data: FlightData, start: Array, *, command_first: bool = True) -> OutputError:
    """Eight aerodynamic parameters, five sensor errors, four initial states; start: u w q theta."""
    model = Model("mav", {name: Coefficient(0.0) for name in AERODYNAMIC})
    parameters = [*(coefficient(name) for name in AERODYNAMIC), *(sensor_error(name) for name in SENSORS)]
    predictor = Predictor(
        flatten(vehicle(), model), parameters, [longitudinal_record(data)], command_first=command_first
    )
    guess = np.zeros(9)
    guess[[0, 2, 4, 7]] = start
    return OutputError(predictor, [guess], LONGITUDINAL)
