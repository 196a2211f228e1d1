"""Residuals of coefficients in times of the sensors' noise, which is on both sides of the comparison."""

import pytest
from simulated import fly_mav

from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identify import Identification, identify
from sysid.validation.held_out import comparison, validation_of


@pytest.fixture(scope="module")
def judged() -> Identification:
    first, second = (fly_mav("multisine", seed, duration=24.0)[0] for seed in (71, 72))
    vehicle = load_vehicle("iitb-mav")
    return identify([first], vehicle, validate_on=[second], systematic=False, method="oe")


def test_a_good_model_leaves_the_sensors_noise(judged: Identification) -> None:
    assert judged.validation is not None
    for axis, output in judged.validation.outputs.items():
        assert output.rms_over_noise == pytest.approx(1.0, abs=0.2), axis
    assert max(one.over_noise for one in judged.validation.largest.values()) < 6.0


@pytest.mark.parametrize(("name", "axis"), [("Cm_alpha", "Cm"), ("Cl_p", "Cl"), ("Cn_beta", "Cn"), ("CL_alpha", "CL")])
def test_a_wrong_derivative_leaves_more(judged: Identification, name: str, axis: str) -> None:
    assert judged.compared is not None
    value = judged.model.values()[name]
    wrong = judged.model.with_coefficient(name, 1.2 * value)
    known = judged.compared.model
    errors = {error: (value, 0.0, "") for error, value in known.errors.items()}
    compared = comparison(judged.compared.flights, load_vehicle("iitb-mav"), wrong, errors, known.command_first)
    found = validation_of(compared).outputs[axis]
    assert found.rms_over_noise is not None
    assert found.rms_over_noise > 1.5
