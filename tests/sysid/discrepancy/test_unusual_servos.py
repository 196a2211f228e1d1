"""Servos beyond what servos do, in gusts: the effect, and not something that every aircraft has."""

from __future__ import annotations

import pytest
from discrepancy_cases import Case, baseline_model, fly_case, gust_for, kind_for, the_vehicle

from sysid.discrepancy import discrepancy

SEED = 20_101


@pytest.mark.parametrize("name", ["actuator_lag", "actuator_backlash"])
def test_a_servo_beyond_its_kind_is_named(name: str) -> None:
    case = Case(((name, 1.0),), SEED, gust_for(SEED), kind_for(name))
    assert case.gust > 0.0
    vehicle = the_vehicle()
    found = discrepancy([fly_case(case, vehicle)[0]], vehicle, baseline_model(case))
    assert found["verdict"] == "missing_effect"
    (effect,) = found["effects"]
    assert effect["name"] == name
    assert effect["probability"] > 0.9
    for key, size in case.values()[name].items():
        one = effect["parameters"][key]
        assert abs(one["value"] - size) < 3.0 * one["std"]
