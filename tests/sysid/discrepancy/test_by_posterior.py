"""Missing effects on flights as the field gives them: JSBSim's, behind servos that lag, in gusts, over a link."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from field_effects import hidden_flight
from field_flight import textbook
from field_inputs import inputs_of
from field_plant import Servo, fly_field
from field_sensors import sense
from jsbsim_flight import linear_aircraft
from simulated import fly_mav
from smaller_catalogue import catalogue_without

from sim_vehicle.effects import EFFECTS, parse_effect
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.strict_toml import Known
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.discrepancy import discrepancy
from sysid.discrepancy.candidates import Candidate
from sysid.discrepancy.spectrum.group_fits import fresh_unknown, is_size
from sysid.discrepancy.spectrum.ideal_sensors import with_ideal_sensors
from sysid.errors import EstimationError

pytestmark = pytest.mark.whole_flight


def test_a_stall_is_named_behind_servos_and_gusts_that_no_model_holds(tmp_path: Path) -> None:
    """Filter error names a servo's dead band, a vane's lag and a stall here, and takes all back."""
    flown = hidden_flight("stall", "mild", 0, tmp_path, off=0.05)
    found = discrepancy([flown.signals], flown.vehicle, flown.model)
    assert (found["method"], found["verdict"]) == ("map", "missing_effect")
    assert [one["name"] for one in found["effects"]] == ["stall"]
    angle = found["effects"][0]["parameters"]["alpha_stall"]
    assert abs(angle["value"] - flown.parameters["alpha_stall"]) < 2.5 * angle["std"]
    assert angle["std"] < 0.03
    before, after = found["gap"]["estimation"]["before"], found["gap"]["estimation"]["after"]
    assert all(after[name] < 0.7 * before[name] for name in ("q", "az", "V"))
    assert found["effects"][0]["alternatives"] == []


def test_a_roll_damping_that_the_model_lacks_is_named_though_its_slopes_tell_nothing(tmp_path: Path) -> None:
    """Without damping the simulated roll is so far from the flown that no score test sees the way back."""
    flown = hidden_flight("roll_damping", "mild", 1, tmp_path)
    found = discrepancy([flown.signals], flown.vehicle, flown.model)
    assert [one["name"] for one in found["effects"]] == ["roll_damping"]
    damping = found["effects"][0]["parameters"]["Cl_p"]
    assert abs(damping["value"] - flown.parameters["Cl_p"]) < 2.5 * damping["std"]


def test_a_thrust_line_that_nobody_gave_is_named_and_no_unknown_of_the_baseline(tmp_path: Path) -> None:
    flown = hidden_flight("thrust_line_offset", "typical", 3, tmp_path, size=3.0)
    propulsion = flown.vehicle.propulsion
    assert propulsion is not None
    vehicle = replace(flown.vehicle, propulsion=replace(propulsion, line_known=False))
    found = discrepancy([flown.signals], vehicle, flown.model)
    assert [one["name"] for one in found["effects"]] == ["thrust_line_offset"], found["reasons"]
    height = found["effects"][0]["parameters"]["z_T"]
    assert abs(height["value"] - flown.parameters["z_T"]) < 3.0 * height["std"] < 0.03


def test_nothing_is_named_where_nothing_is_missing(tmp_path: Path) -> None:
    flown = hidden_flight("none", "typical", 4, tmp_path)
    found = discrepancy([flown.signals], flown.vehicle, flown.model)
    assert (found["method"], found["verdict"], found["effects"]) == ("map", "none", [])
    # The model's forces go with the air's density, its moments with the surfaces' travel too: by 2 % and 5 %.
    model = found["model"]["coefficients"]
    for name, share in (("CL_alpha", 0.02), ("Cl_da", 0.05)):
        assert model[name]["std"] > 0.98 * share * abs(model[name]["value"])
        assert model[name]["statistical_std"] < model[name]["std"]
    # What the servos do is no missing effect, and is said.
    assert any("servos" in line for line in found["reasons"])


def test_axes_that_a_hold_alone_has_moved_are_taken_by_neither_method(tmp_path: Path) -> None:
    flown = hidden_flight("none", "odd", 2, tmp_path)
    with pytest.raises(EstimationError, match=r"aileron did nothing but follow.*use --method map"):
        discrepancy([flown.signals], flown.vehicle, flown.model, method="fe")
    found = discrepancy([flown.signals], flown.vehicle, flown.model)
    assert (found["method"], found["effects"]) == ("map", [])
    assert found["model"]["coefficients"]["Cl_p"]["value"] == flown.model.values()["Cl_p"]


def test_physics_that_the_catalogue_lacks_gets_no_name(tmp_path: Path) -> None:
    flown = hidden_flight("sideslip_drag", "mild", 1, tmp_path)
    with catalogue_without(["sideslip_drag"]):
        found = discrepancy([flown.signals], flown.vehicle, flown.model)
    assert found["verdict"] == "unexplained"
    assert found["effects"] == []
    assert any(line.startswith("left without a name: CD") for line in found["reasons"])


AIRSPEED = ("airspeed_error", "density_error")


@pytest.mark.parametrize(
    ("flown", "parameter"),
    [
        ("actuator_lag:tau=0.04", "tau"),
        ("pitot_lag:tau=0.15", "tau"),
        ("airspeed_error:scale=0.05", "scale"),
        ("cg_shift:x=0.01", "x"),
    ],
)
def test_what_servos_and_sensors_do_is_an_effect_where_all_else_is_the_textbooks(flown: str, parameter: str) -> None:
    vehicle, (effect, values) = load_vehicle("iitb-mav"), parse_effect(flown)
    flight = fly_mav("multisine", 5, duration=12.0, effects=(flown,))[0]
    found = discrepancy([flight], vehicle, read_model("iitb-mav"), method="map")
    assert (found["method"], found["verdict"]) == ("map", "missing_effect")
    (named,) = found["effects"]
    likely = {named["name"], *(one["name"] for one in named["alternatives"])}
    assert effect.name in likely, found["reasons"]
    # A gain of the airspeed and an air of another density are one thing to a flight.
    assert likely <= {effect.name, *(AIRSPEED if effect.name in AIRSPEED else ())}
    if named["name"] == effect.name:
        told = named["parameters"][parameter]
        assert abs(told["value"] - values[parameter]) < 3.5 * told["std"] < 0.35 * values[parameter]
    gap = found["gap"]["estimation"]
    # What coefficients imitate is closed by them.
    before = gap["given" if effect.alias else "before"]
    worst = max(before[name] / gap["noise_floor"][name] for name in gap["noise_floor"])
    left = max(gap["after"][name] / gap["noise_floor"][name] for name in gap["noise_floor"])
    assert left < 0.7 * worst


def test_what_a_vehicle_file_says_of_its_servos_holds_for_a_textbook_too() -> None:
    vehicle = load_vehicle("iitb-mav")
    late = replace(vehicle.controls["elevator"], delay=Known(0.03, 0.01))
    found = with_ideal_sensors(replace(vehicle, controls={**vehicle.controls, "elevator": late}))
    assert found.controls["elevator"].delay == Known(0.03, 0.01)
    assert found.controls["elevator"].lag == found.controls["aileron"].delay == Known(0.0, 0.0)


@pytest.mark.parametrize(("effect", "name", "size"), [("stall", "alpha_stall", False), ("unsteady_lift", "tau", True)])
def test_priors_of_sizes_are_about_nothing_and_of_limits_over_their_range(effect: str, name: str, size: bool) -> None:
    one = EFFECTS[effect].parameter(name)
    assert is_size(one) == size
    fresh = fresh_unknown(Candidate(EFFECTS[effect], (name,), ({name: one.starts[0]},)), name, one.starts[0])
    assert (fresh.mean == 0.0) == size
    assert fresh.low == one.low
    assert np.isfinite(fresh.std)


def test_a_burst_lost_is_no_reason_to_say_nothing_where_sensors_are_the_textbooks(tmp_path: Path) -> None:
    """Filter error finds no part without gaps in it; commands come 5 ms late and the airspeed at 10 Hz besides."""
    aircraft = linear_aircraft()
    log = fly_field(tmp_path, aircraft, inputs_of("3211", 20.0, np.random.default_rng(0)), 0, servo=Servo())
    field = replace(textbook(), command_offset=0.005, bursts=1.0, airspeed_hz=10.0)
    found = discrepancy([sense(log, aircraft.vehicle, field, 0, "burst")], aircraft.vehicle, aircraft.model)
    assert (found["method"], found["effects"]) == ("map", [])
    assert any("filter error cannot be used" in line for line in found["warnings"])
