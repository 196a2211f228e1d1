"""Commands that the aircraft follows late: what each method makes of them."""

from dataclasses import replace

import pytest
from own_bars import own_bar
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.strict_toml import Known
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.identification.result_file import result_json
from sysid.identify import Identification, identify
from sysid.signals.flight import FlightSignals

pytestmark = pytest.mark.whole_flight

VEHICLE = load_vehicle("iitb-mav")
TRUE = read_model("iitb-mav").values()
MAIN = ("CL_alpha", "Cm_alpha", "Cm_de", "Cl_p", "Cl_da", "Cn_beta", "Cn_dr")
SURFACES = ("elevator", "aileron", "rudder")
LATE_S = 0.04


@pytest.fixture(scope="module")
def late() -> FlightSignals:
    flight = fly_mav("multisine", 3)[0]
    commands = {n: replace(flight.signals[n], time_s=flight.signals[n].time_s - LATE_S) for n in ("de", "da", "dr")}
    return replace(flight, signals={**flight.signals, **commands})


def stating(delay_s: float) -> Vehicle:
    controls = {
        name: replace(one, delay=Known(delay_s, 0.0)) if name in SURFACES else one
        for name, one in VEHICLE.controls.items()
    }
    return replace(VEHICLE, controls=controls)


def worst(found: Identification) -> float:
    """Largest error of a main derivative, of its size."""
    entries = found.model.coefficients
    return max(abs((entries[name].value or 0.0) / TRUE[name] - 1.0) for name in MAIN)


def test_output_error_says_that_it_has_not_explained_the_flight(late: FlightSignals) -> None:
    found = identify([late], VEHICLE, method="oe", systematic=False)
    assert any("no noise of a sensor" in warning for warning in found.warnings)
    on_time = identify([fly_mav("multisine", 3)[0]], VEHICLE, method="oe", systematic=False)
    assert not any("no noise of a sensor" in warning for warning in on_time.warnings)


def test_without_an_option_the_delay_is_estimated_and_spoils_nothing(late: FlightSignals) -> None:
    found = identify([late], VEHICLE, systematic=False)
    result = result_json(found)
    assert result["method"] == "map"
    assert worst(found) < 0.05
    for name in MAIN:
        entry = found.model.coefficients[name]
        assert abs((entry.value or 0.0) - TRUE[name]) < 4.0 * own_bar(entry), name
    delays = [one["value"] for one in result["nuisances"] if one["name"] == "servo_delay"]
    # They stay from stamp to stamp; a curve through them would be half a sample of 20 ms later.
    assert delays == pytest.approx([LATE_S] * 2, abs=0.004)


@pytest.mark.parametrize("method", ["ee", "oe"])
def test_a_delay_that_the_vehicle_file_states_is_known_to_the_methods_of_the_books(
    method: str, late: FlightSignals
) -> None:
    found = identify([late], stating(LATE_S), method=method, systematic=False)
    assert worst(found) < {"ee": 0.05, "oe": 0.005}[method]
    assert not any("no noise of a sensor" in warning for warning in found.warnings)


def test_a_right_model_predicts_another_flight_though_its_commands_come_late(late: FlightSignals) -> None:
    other = fly_mav("multisine", 4)[0]
    commands = {n: replace(other.signals[n], time_s=other.signals[n].time_s - LATE_S) for n in ("de", "da", "dr")}
    judge = replace(other, signals={**other.signals, **commands})
    found = result_json(identify([late], VEHICLE, validate_on=[judge], systematic=False))
    assert (found["method"], found["validation"]["acceptable"]) == ("map", True)
    for axis in ("Cl", "Cm", "Cn"):
        assert found["validation"]["outputs"][axis]["tic"] < 0.1, axis
    assert not any("held out" in reason for reason in found["quality"]["reasons"])


def test_what_follows_before_its_stamp_is_a_late_stamp_and_no_delay() -> None:
    flight = fly_mav("multisine", 3)[0]
    commands = {n: replace(flight.signals[n], time_s=flight.signals[n].time_s + LATE_S) for n in ("de", "da", "dr")}
    early = replace(flight, signals={**flight.signals, **commands})
    found = result_json(identify([early], VEHICLE, method="map", systematic=False))
    assert all(one["value"] >= 0.0 for one in found["nuisances"] if one["name"] in ("servo_delay", "servo_lag"))
    assert any(one["name"] == "command_clock" and one["value"] > 0.01 for one in found["nuisances"])


@pytest.mark.parametrize("method", ["ee", "oe", "fe"])
def test_commands_between_the_samples_of_the_imu_count_from_their_own_stamps(method: str) -> None:
    flight = fly_mav("multisine", 3)[0]
    slow = {
        name: one
        if name in ("de", "da", "dr", "throttle")
        else replace(one, time_s=one.time_s[1::2], values=one.values[1::2])
        for name, one in flight.signals.items()
    }
    found = identify([replace(flight, signals=slow)], VEHICLE, method=method, systematic=False)
    # Taken from the next sample on they are up to 21 % off.
    assert worst(found) < 0.05
