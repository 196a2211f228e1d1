"""What breaks in flight, held against forces, moments and readings worked by hand."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from sim_vehicle.cli.main import main
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.flight.failures import KINDS, Failures, parse_failure
from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import OUTPUTS, Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.manoeuvres.plan import plan_of
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle

VEHICLE = load_vehicle("iitb-mav")
STILL = np.zeros(3)


def broken(*texts: str) -> tuple[Plant, Plant]:
    """The aircraft whole, and broken from the start."""
    model = Failures.flyable(read_model("iitb-mav"))
    plants = Plant(VEHICLE, model), Plant(VEHICLE, model)
    Failures([parse_failure(f"{text}@0") for text in texts]).begin(0.0, plants[1])
    return plants


def outputs(plant: Plant, surfaces: tuple[float, float, float, float], **changes: float) -> dict[str, float]:
    """By-products at one state: straight flight at 15 m/s and 4 deg with these rates and surfaces."""
    x = np.zeros(14)
    x[3], x[5], x[6], x[13] = 15.0 * math.cos(0.07), 15.0 * math.sin(0.07), 1.0, 0.07
    x[4] = changes.get("v", 0.0)
    x[10:13] = changes.get("p", 0.0), changes.get("q", 0.0), changes.get("r", 0.0)
    state = plant.state_at(x, np.array(surfaces), np.array(surfaces))
    return dict(zip(OUTPUTS, plant.outputs(state).tolist(), strict=True))


def test_half_an_elevator_makes_half_the_moment() -> None:
    whole, half = broken("elevator=0.5")
    rest, moved = outputs(whole, (0.0, 0.0, 0.0, 0.3)), outputs(whole, (0.1, 0.0, 0.0, 0.3))
    less = outputs(half, (0.1, 0.0, 0.0, 0.3))
    assert less["Cm"] - rest["Cm"] == pytest.approx(0.5 * (moved["Cm"] - rest["Cm"]), rel=1e-9)
    assert outputs(half, (0.0, 0.0, 0.0, 0.3))["Cm"] == pytest.approx(rest["Cm"], abs=1e-12)


def test_one_aileron_off_its_horn_leaves_half_the_control_and_a_moment() -> None:
    whole, one = broken("one-aileron=10")
    full = outputs(whole, (0.0, 0.2, 0.0, 0.3))["Cl"] - outputs(whole, (0.0, 0.0, 0.0, 0.3))["Cl"]
    still = outputs(one, (0.0, 0.0, 0.0, 0.3))["Cl"] - outputs(whole, (0.0, 0.0, 0.0, 0.3))["Cl"]
    assert still == pytest.approx(0.5 * math.radians(10.0) / 0.2 * full, rel=1e-6)
    left = outputs(one, (0.0, 0.2, 0.0, 0.3))["Cl"] - outputs(one, (0.0, 0.0, 0.0, 0.3))["Cl"]
    assert left == pytest.approx(0.5 * full, rel=1e-6)


def test_a_centre_of_gravity_moved_back_pitches_up_by_lift_times_its_arm() -> None:
    whole, moved = broken("cg=0.1")
    a, b = outputs(whole, (0.0, 0.0, 0.0, 0.3)), outputs(moved, (0.0, 0.0, 0.0, 0.3))
    # Iyy dq' = -x m az, x = -0.1 chords of 0.2 m
    assert b["q_dot"] - a["q_dot"] == pytest.approx(-0.02 * VEHICLE.mass.mass * a["az"] / VEHICLE.mass.Iyy, rel=1e-6)


def test_a_lighter_aircraft_feels_the_same_forces_more_and_a_worn_propeller_pulls_less() -> None:
    whole, light = broken("mass=0.8")
    assert outputs(light, (0.0,) * 4)["az"] == pytest.approx(outputs(whole, (0.0,) * 4)["az"] / 0.8, rel=1e-9)
    whole, worn = broken("propeller=0.6")
    full = outputs(whole, (0.0, 0.0, 0.0, 0.5))["thrust"]
    assert full > 1.0
    assert outputs(worn, (0.0, 0.0, 0.0, 0.5))["thrust"] == pytest.approx(0.6 * full, rel=1e-9)


def test_half_a_tailplane_damps_and_holds_half_as_much() -> None:
    vehicle, model = load_vehicle("ultrastick25e"), read_model("ultrastick25e")
    plants = Plant(vehicle, model), Plant(vehicle, model)
    Failures([parse_failure("tail=0.5@0")]).begin(0.0, plants[1])
    whole, half = (dict(zip(plant.flat.names, plant.flat.C.tolist(), strict=True)) for plant in plants)
    assert half["Cm_q"] == pytest.approx(0.5 * whole["Cm_q"])
    assert half["Cm_de"] == pytest.approx(0.5 * whole["Cm_de"])
    # A tailplane of a lever of three chords, in a downwash of 0.4: (1 - 0.4) / (2 * 3) of its damping.
    assert half["Cm_alpha"] - whole["Cm_alpha"] == pytest.approx(-0.1 * 0.5 * whole["Cm_q"])
    assert half["Cm_alpha"] > whole["Cm_alpha"]


@pytest.mark.parametrize(
    ("text", "better", "name", "state"),
    [
        ("ice=1", -1.0, "CL", {}),
        ("ice=1", 1.0, "CD", {}),
        ("flap=0.2", 1.0, "CL", {}),
        ("gear=0.02", 1.0, "CD", {}),
        ("fin=0.5", 1.0, "Cn", {"v": -2.0}),
        ("wing-tip=0.01", 1.0, "Cl", {}),
    ],
)
def test_what_breaks_works_to_its_own_side(text: str, better: float, name: str, state: dict[str, float]) -> None:
    whole, after = broken(text)
    a, b = outputs(whole, (0.0, 0.0, 0.0, 0.3), **state), outputs(after, (0.0, 0.0, 0.0, 0.3), **state)
    assert better * (b[name] - a[name]) > 1e-4
    assert math.isfinite(b[name])


def flown(*texts: str, seconds: float = 8.0, noise: str = "none") -> FlownFlight:
    failures = Failures([parse_failure(text) for text in texts])
    plant = Plant(VEHICLE, Failures.flyable(read_model("iitb-mav")))
    suite = SensorSuite(VEHICLE, noise=noise, generator=3, failures=failures)
    plan = plan_of(["multisine"]).fitted(seconds)
    return fly(plant, plan, suite=suite, generator=np.random.default_rng(3), failures=failures)


def test_a_stuck_elevator_stands_where_it_was_while_its_command_goes_on() -> None:
    found = flown("elevator-stuck@4")
    later = found.time_s > 4.03
    assert np.ptp(found.truth["de"][later]) < 1e-12
    assert np.ptp(found.command[later, 0]) > 0.02
    at = int(np.searchsorted(found.time_s, 4.0))
    assert found.truth["de"][later][0] == pytest.approx(found.command[at, 0], abs=1e-9)
    told = flown("elevator-stuck=5@4").truth["de"]
    assert told[-1] == pytest.approx(math.radians(5.0))


def test_an_elevator_that_floats_goes_with_the_angle_of_attack() -> None:
    found = flown("elevator-floats=0.5@4", seconds=6.0)
    later = np.flatnonzero(found.time_s > 4.05)
    assert found.truth["de"][later] == pytest.approx(-0.5 * found.truth["alpha"][later - 1], abs=1e-9)


READINGS = {
    "pitot-blocked@4": ("airspeed", lambda true, age: np.full(true.size, true[0])),
    "pitot-leak=0.64@4": ("airspeed", lambda true, age: 0.8 * true),
    "pitot-drift=0.3@4": ("airspeed", lambda true, age: true + 0.3 * age),
    "pitot-ice=5@4": ("airspeed", lambda true, age: true * np.exp(-age / 5.0)),
    "alpha-stuck@4": ("alpha", lambda true, age: np.full(true.size, true[0])),
    "beta-bent=3@4": ("beta", lambda true, age: true + math.radians(3.0)),
    "gyro-q=0.026@4": ("q", lambda true, age: true + 0.026),
    "accelerometer-z=0.5@4": ("az", lambda true, age: true + 0.5),
}


@pytest.mark.parametrize("text", READINGS)
def test_broken_sensors_read_what_they_would(text: str) -> None:
    name, law = READINGS[text]
    failures = Failures([parse_failure(text)])
    time_s = np.arange(0.0, 8.0, 0.02)
    true = 12.0 + np.sin(time_s)
    read = np.empty_like(true)
    for k, at in enumerate(time_s):
        readings = {name: float(true[k])}
        failures.read(float(at), readings)
        read[k] = readings[name]
    after = time_s >= 4.0
    assert np.array_equal(read[~after], true[~after])
    assert read[after] == pytest.approx(law(true[after], time_s[after] - 4.0), rel=1e-9)


def test_a_vane_that_lags_is_a_filter_of_the_first_order() -> None:
    failures = Failures([parse_failure("alpha-slow=0.2@1")])
    read = []
    for k in range(151):
        readings = {"alpha": 0.0 if k <= 50 else 1.0}
        failures.read(0.02 * k, readings)
        read.append(readings["alpha"])
    assert read[50] == 0.0
    assert read[50 + 25] == pytest.approx(1.0 - math.exp(-0.5 / 0.2), rel=1e-6)


def test_a_lost_gps_tells_nothing_more_and_a_dead_channel_the_same_pulse() -> None:
    found = flown("gps=lost@4", "servo-elevator=dead@4")
    assert found.measured["vn"][0][-1] < 4.0 < found.measured["az"][0][-1]
    times, pulses = found.measured["servo2"]
    assert np.ptp(pulses[times > 4.05]) == 0.0
    assert np.ptp(found.truth["de"][found.time_s > 4.05]) > 0.02
    assert found.to_json()["failures"] == [
        {"name": "gps-lost", "size": None, "time_s": 4.0}, {"name": "servo-elevator-dead", "size": None, "time_s": 4.0}
    ]  # fmt: skip


def test_a_blocked_pitot_tube_misleads_the_autopilot_and_a_gps_jump_is_one(tmp_path: Path) -> None:
    path = tmp_path / "truth.json"
    command = ["fly", "--manoeuvre", "cruise", "--duration", "12", "--fail", "pitot-drift=0.5@2", "--fail",
               "gps-jump=40@6", "--record", str(tmp_path / "f.tlog"), "--truth", str(path)]  # fmt: skip
    assert main(command) == 0
    truth = json.loads(path.read_text(encoding="utf-8"))
    # It reads ever faster, and so is flown ever slower.
    assert truth["truth"]["V"][-1] < truth["truth"]["V"][90] - 1.0
    assert [one["name"] for one in truth["failures"]] == ["pitot-drift", "gps-jump"]


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_flies_with_the_size_that_is_usual(name: str) -> None:
    found = flown(f"{name}@2", seconds=4.0, noise="table2")
    assert np.isfinite(found.truth["V"]).all()
    assert [one["name"] for one in found.failures] == [name]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("elevetor=0.5@40", "there are accelerometer-x"),
        ("elevator=0.5", "NAME[=SIZE]@SECONDS"),
        ("elevator=half@40", "NAME[=SIZE]@SECONDS"),
        ("elevator=2@40", "from 0 to 1 (share that is left)"),
        ("elevator=0.5@-1", "NAME[=SIZE]@SECONDS"),
        ("elevator=nan@4", "NAME[=SIZE]@SECONDS"),
        ("pitot-blocked=1@40", "has no size"),
        ("pitot=frozen@40", "there are"),
        ("elevator=bent@40", "elevator=stuck|floats@SECONDS"),
    ],
)
def test_a_failure_that_cannot_be_is_one_line(
    text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SimVehicleError):
        parse_failure(text)
    assert main(["fly", "--fail", text, "--record", str(tmp_path / "f.tlog")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"sim-vehicle: --fail {text}")
    assert words in line
