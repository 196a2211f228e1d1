"""The model that flights are held against is the one that flies."""

from dataclasses import replace

import numpy as np

from sim_vehicle.model.model_file import Coefficient, read_model
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.validation.held_out import comparison


def test_a_coefficient_that_is_refused_counts_by_its_mean_and_one_without_as_zero() -> None:
    vehicle, told = load_vehicle("iitb-mav"), read_model("iitb-mav")
    refused = {
        **told.coefficients,
        "Cm_0": Coefficient(None, refused="says nothing", mean=told.values()["Cm_0"], mean_std=0.1),
        "CY_p": Coefficient(None, refused="nothing rolled"),
    }
    flown = comparison([], vehicle, replace(told, coefficients=refused), {}, 0.0).model
    zero = {name: entry for name, entry in told.coefficients.items() if name != "CY_p"}
    np.testing.assert_array_equal(flown.flat.C, flatten(vehicle, replace(told, coefficients=zero)).C)
