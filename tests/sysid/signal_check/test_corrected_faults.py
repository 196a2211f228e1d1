"""Mistakes that no owner would doubt: mended in the signals themselves, and nothing else."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from field_flight import FieldFlight, fly_plan, plan_of
from signal_mistakes import Injection, injections
from simulated import fly_mav

from sim_vehicle.errors import VehicleFileError
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import VEHICLES, Vehicle, load_vehicle
from sysid.errors import SignalError
from sysid.signal_check.corrected_faults import Correction, decisive_corrections, repaired
from sysid.signals.flight import FlightData, FlightSignals
from sysid.signals.preparation import prepare

pytestmark = pytest.mark.whole_flight

KINDS = {one.name: one for one in injections()}
UNMISTAKABLE = (
    "unit:q:mrad/s",
    "unit:p+q+r:deg/s", "unit:p+q+r:mrad/s", "unit:ax+ay+az:g", "unit:ax+ay+az:ft/s^2", "unit:phi+theta+psi:degrees",
    "unit:alpha+beta:degrees", "sign:p:-1", "sign:theta:-1", "sign:q+r:-1", "sign:ax+ay+az:-1", "sign:alpha:-1",
    "axis:p+q:exchanged", "axis:phi+theta:exchanged", "axis:ax+az:exchanged", "axis:ax+ay+az:no gravity",
    "axis:p+q+r:cycled",
)  # fmt: skip


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return load_vehicle("iitb-mav")


@pytest.fixture(scope="module")
def flight() -> FlightSignals:
    return fly_mav("multisine", 1, effects=("turbulence:sigma=0.3,length=30",))[0]


def mended(flight: FlightSignals, vehicle: Vehicle, *as_recorded: str) -> tuple[FlightSignals, list[str]]:
    found, mistakes = repaired(flight, prepare(flight, vehicle), vehicle, as_recorded)
    return found, [one.sentence for one in mistakes]


def alike(found: FlightSignals, true: FlightSignals, one: Injection, tolerance: float) -> bool:
    """Whether the signals of a mistake read again what they did before it."""
    return all(
        np.nanmax(np.abs(found.signals[name].values - true.signals[name].values))
        <= tolerance * np.nanmax(np.abs(true.signals[name].values))
        for name in one.signals
    )


@pytest.mark.parametrize("name", UNMISTAKABLE)
def test_what_no_owner_would_doubt_is_mended_and_told(name: str, flight: FlightSignals, vehicle: Vehicle) -> None:
    one = KINDS[name]
    found, told = mended(one.apply(flight), vehicle)
    # Accelerations without gravity get it back by the attitude as measured.
    assert alike(found, flight, one, 0.05 if "gravity" in name else 1e-9)
    assert len(told) == 1
    assert "it was read so here" in told[0]
    assert f"--as-recorded {one.signals[0]}" in told[0]


def test_a_flight_without_mistakes_stays_as_it_is(flight: FlightSignals, vehicle: Vehicle) -> None:
    found, told = mended(flight, vehicle)
    assert told == []
    assert found is flight


@pytest.fixture(scope="module")
def field_flights(tmp_path_factory: pytest.TempPathFactory) -> list[FieldFlight]:
    folder = tmp_path_factory.mktemp("field")
    return [fly_plan(plan_of("mild", seed), seed, folder, f"flight{seed}") for seed in (1, 2)]


@pytest.mark.parametrize(("family", "seed"), [("mild", 1), ("rough", 2), ("slow", 0), ("short", 14)])
def test_lags_gusts_and_vibration_are_no_mistake(family: str, seed: int, tmp_path: Path) -> None:
    flown = fly_plan(plan_of(family, seed), seed, tmp_path, "flight")
    assert mended(flown.signals, flown.vehicle) == (flown.signals, [])


@pytest.mark.parametrize(
    "name",
    [
        "unit:p+q+r:deg/s", "unit:vn+ve+vd:cm/s", "unit:vn+ve+vd:km/h", "axis:vn+ve:exchanged", "sign:ay:-1",
    ],
)  # fmt: skip
def test_mistakes_are_found_behind_the_sensors_of_the_field(name: str, field_flights: list[FieldFlight]) -> None:
    for flown in field_flights:
        one = KINDS[name]
        found, told = mended(one.apply(flown.signals), flown.vehicle)
        assert alike(found, flown.signals, one, 1e-9)
        assert len(told) == 1


@pytest.mark.parametrize("seed", [21, 23])
def test_an_angle_of_attack_upside_down_is_found_by_the_lift_that_falls_with_it(seed: int, tmp_path: Path) -> None:
    """In gusts that no relation of the motion holds in, as recorded or as corrected."""
    flown, one = fly_plan(plan_of("mild", seed), seed, tmp_path, "flight"), KINDS["sign:alpha:-1"]
    found, told = mended(one.apply(flown.signals), flown.vehicle)
    assert alike(found, flown.signals, one, 1e-9)
    assert len(told) == 1


@pytest.mark.parametrize("name", ["scale:p:0.9", "scale:q:1.1", "scale:phi:1.1", "scale:theta:1.1"])
def test_a_small_gain_of_a_gyro_or_of_an_angle_is_said_and_left(
    name: str, flight: FlightSignals, vehicle: Vehicle
) -> None:
    one = KINDS[name]
    wrong = one.apply(flight)
    found, told = mended(wrong, vehicle)
    assert found is wrong
    assert len(told) == 1
    assert one.signals[0] in told[0]
    assert "both are taken as recorded" in told[0]
    assert mended(wrong, vehicle, one.signals[0]) == (wrong, [])


@pytest.mark.parametrize("name", ["delay:phi+theta+psi:50 ms", "delay:p+q+r:200 ms", "delay:q:50 ms"])
def test_angles_and_rates_of_different_times_are_said_and_left(
    name: str, flight: FlightSignals, vehicle: Vehicle
) -> None:
    one = KINDS[name]
    wrong = one.apply(flight)
    found, mistakes = repaired(wrong, prepare(wrong, vehicle), vehicle)
    assert found is wrong
    (said,) = mistakes
    assert said.kind == "delay"
    assert {"theta", "q"} <= set(said.signals) <= {"phi", "theta", "psi", "p", "q", "r"}
    assert ("phi" in said.signals) == (len(one.signals) > 1)
    late = one.delay_s if one.signals[0] in ("phi", "theta") else -one.delay_s
    assert said.found == pytest.approx(late, abs=0.01)
    assert f"{abs(said.found) * 1e3:.0f} ms {'after' if late > 0 else 'before'}" in said.sentence


def test_a_rate_that_is_late_is_not_read_as_another_unit() -> None:
    # A yaw rate 200 ms late spoils the pitch angle's relation, which holds better without any yaw rate.
    other = load_vehicle("ultrastick25e")
    effects = ("steady_wind:north=-2,east=1,down=0",)
    flight = fly_mav("multisine", 500, effects=effects, vehicle=other, model=read_model("ultrastick25e"))[0]
    wrong = KINDS["delay:r:200 ms"].apply(flight)
    found, mistakes = repaired(wrong, prepare(wrong, other), other)
    assert found is wrong
    (said,) = mistakes
    assert (said.kind, said.signals) == ("delay", ("psi", "r"))
    assert said.found == pytest.approx(-0.2, abs=0.01)


def test_a_log_of_one_sample_a_second_is_read_without_looking_for_delays(vehicle: Vehicle) -> None:
    time_s = np.arange(0.0, 600.0, 1.0)
    slow = np.sin(0.2 * time_s)
    columns = dict.fromkeys(("phi", "theta", "psi", "p", "q", "r", "ax", "ay"), 0.1 * slow)
    part = FlightData("slow", 1.0, time_s, {**columns, "az": slow - 9.8, "airspeed": 15.0 + slow})
    found, said = decisive_corrections([part], prepare(fly_mav("multisine", 1)[0], vehicle).layout)
    assert [one.kind for one in said if one.kind == "delay"] == []
    assert all(isinstance(one, Correction) for one in found)


def test_a_scale_of_az_is_said_and_left(flight: FlightSignals, vehicle: Vehicle) -> None:
    gains = []
    for name in ("scale:az:0.9", "scale:az:1.3"):
        wrong = KINDS[name].apply(flight)
        found, mistakes = repaired(wrong, prepare(wrong, vehicle), vehicle)
        assert found is wrong
        (said,) = mistakes
        assert f"reads {said.found:.2f} of true" in said.sentence
        assert mended(wrong, vehicle, "az") == (wrong, [])
        gains.append(said.found)
    assert gains[0] / gains[1] == pytest.approx(0.9 / 1.3, rel=0.01)  # this flight's az has an error of its own
    assert gains[0] == pytest.approx(0.9, abs=0.05)


def named_units(wrong: FlightSignals, flown: FieldFlight) -> tuple[FlightSignals | None, str]:
    """The flight as mended, None where it is not, and what is said."""
    try:
        found, told = mended(wrong, flown.vehicle)
    except SignalError as error:
        return None, str(error)
    return found, "; ".join(told)


@pytest.mark.parametrize("vanes", [True, False])
@pytest.mark.parametrize("unit", ["knots", "mph", "km/h", "ft/s"])
def test_an_airspeed_in_another_unit_is_mended_or_asked_for(
    unit: str, vanes: bool, field_flights: list[FieldFlight]
) -> None:
    flown, one = field_flights[1], KINDS[f"unit:airspeed:{unit}"]
    kept = {name: s for name, s in flown.signals.signals.items() if vanes or name not in ("alpha", "beta")}
    right = replace(flown.signals, signals=kept)
    found, said = named_units(one.apply(right), flown)
    assert unit in said
    assert "in [signals] of the vehicle file" in said
    assert "--as-recorded airspeed" in said
    assert found is None or alike(found, right, one, 1e-9)
    assert mended(right, flown.vehicle) == (right, [])


def test_a_signal_that_is_said_to_be_right_is_left_alone(flight: FlightSignals, vehicle: Vehicle) -> None:
    one = KINDS["sign:alpha:-1"]
    wrong = one.apply(flight)
    assert mended(wrong, vehicle)[1]
    for found, told in (mended(wrong, vehicle, "alpha"), mended(wrong, replace(vehicle, as_recorded=("alpha",)))):
        assert not any("alpha" in sentence.split(":")[0] for sentence in told)
        np.testing.assert_array_equal(found.signals["alpha"].values, wrong.signals["alpha"].values)


def test_a_name_of_no_signal_is_told_and_not_passed_over(flight: FlightSignals, vehicle: Vehicle) -> None:
    with pytest.raises(SignalError, match=r"as recorded: alfa is no signal searched for mistakes; those are ax, ay"):
        mended(flight, vehicle, "alfa")


def test_thrust_in_gram_force_is_read_in_newton_and_one_beyond_any_unit_left_out(
    flight: FlightSignals, vehicle: Vehicle
) -> None:
    def times(factor: float) -> FlightSignals:
        one = flight.signals["thrust"]
        return replace(flight, signals={**flight.signals, "thrust": replace(one, values=factor * one.values)})

    found, told = mended(times(1000.0 / 9.80665), vehicle)
    np.testing.assert_allclose(found.signals["thrust"].values, flight.signals["thrust"].values, rtol=1e-3)
    assert "gram-force" in told[0]
    found, told = mended(times(1e6), vehicle)
    assert "thrust" not in found.signals
    assert told[0].endswith("it is left out")


def test_air_that_no_air_is_ends_the_job_with_the_reason(flight: FlightSignals, vehicle: Vehicle) -> None:
    wrong = prepare(flight, vehicle)
    stretches = [replace(s, record=replace(s.record, rho=np.full(s.record.length, 0.01))) for s in wrong.stretches]
    with pytest.raises(SignalError, match=r"air density is 0\.01"):
        repaired(flight, replace(wrong, stretches=stretches), vehicle)


def test_the_vehicle_file_names_signals_that_are_right(tmp_path: Path) -> None:
    text = (VEHICLES / "ultrastick25e.toml").read_text(encoding="utf-8")
    good, bad = tmp_path / "good.toml", tmp_path / "bad.toml"
    good.write_text(f'{text}\n[signals]\nas_recorded = ["ax"]\n', encoding="utf-8")
    assert load_vehicle(good).as_recorded == ("ax",)
    bad.write_text(f'{text}\n[signals]\nas_recorded = "ax"\n', encoding="utf-8")
    with pytest.raises(VehicleFileError, match=r"signals\.as_recorded is 'ax'; it must be a list of names"):
        load_vehicle(bad)
