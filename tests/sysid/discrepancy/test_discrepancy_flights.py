"""Several flights in one comparison, of which each tells what its sensors can."""

from __future__ import annotations

from dataclasses import replace

import pytest
from simulated import fly_mav

from sim_vehicle.errors import ModelFileError
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.discrepancy import discrepancy

pytestmark = pytest.mark.whole_flight


def test_lagging_vanes_are_named_where_another_flight_has_none() -> None:
    vehicle = load_vehicle("iitb-mav")
    flown = [fly_mav("multisine", seed, duration=7.0, effects=("vane_lag:tau=0.1",))[0] for seed in (5, 6)]
    kept = {name: signal for name, signal in flown[1].signals.items() if name not in ("alpha", "beta")}
    found = discrepancy([flown[0], replace(flown[1], signals=kept)], vehicle, read_model("iitb-mav"))
    assert [one["name"] for one in found["effects"]] == ["vane_lag"], found["reasons"]
    tau = found["effects"][0]["parameters"]["tau"]
    assert abs(tau["value"] - 0.1) < 4.0 * tau["std"]
    assert tau["std"] < 0.005


def test_what_weighing_has_cleared_is_no_alternative() -> None:
    vehicle = load_vehicle("iitb-mav")
    flight = fly_mav("multisine", 8, duration=8.0, effects=("thrust_scale:scale=0.06",))[0]
    together = discrepancy([flight], vehicle, read_model("iitb-mav"))
    (named,) = together["effects"]
    assert {named["name"], *(one["name"] for one in named["alternatives"])} == {"thrust_scale", "mass_error"}
    assert named["separating_manoeuvre"].startswith("weigh")
    alone = discrepancy([flight], vehicle, read_model("iitb-mav"), ruled_out=["mass_error"])
    (named,) = alone["effects"]
    assert (named["name"], named["alternatives"]) == ("thrust_scale", []), alone["reasons"]
    assert alone["ruled_out"] == ["mass_error"]
    # A flight of the textbooks, seen as such though something is missing.
    assert alone["method"] == "fe"
    assert abs(named["parameters"]["scale"]["value"] - 0.06) < 4.0 * named["parameters"]["scale"]["std"]


def test_no_unknown_effect_is_ruled_out() -> None:
    with pytest.raises(ModelFileError, match="unknown effect 'mass'; known are"):
        discrepancy([], load_vehicle("iitb-mav"), read_model("iitb-mav"), ruled_out=["mass"])


def test_beside_sensors_that_are_late_smooth_terms_gain_nothing() -> None:
    """They are read ahead, as the filter reads them: by the delay alone every axis would seem to lack something."""
    flight = fly_mav("multisine", 3, effects=("sensor_time_skew:delay=0.06,group=vanes",))[0]
    found = discrepancy([flight], load_vehicle("iitb-mav"), read_model("iitb-mav"))
    assert [one["name"] for one in found["effects"]] == ["sensor_time_skew"]
    assert found["effects"][0]["parameters"]["delay"]["value"] == pytest.approx(0.06, abs=5e-4)
    assert found["left"] == []
    assert found["complete"]


def test_an_airspeed_that_is_wrong_by_a_scale_is_no_other_density() -> None:
    """Both are the same to the motion of an aircraft whose coefficients are free; an airspeed so wrong is usual."""
    flight = fly_mav("multisine", 4, effects=("airspeed_error:scale=0.08,bias=0",))[0]
    found = discrepancy([flight], load_vehicle("iitb-mav"), read_model("iitb-mav"))
    first = found["effects"][0]
    assert first["name"] == "airspeed_error"
    assert list(first["parameters"]) == ["scale"]
    assert first["parameters"]["scale"]["value"] == pytest.approx(0.08, abs=0.01)
