"""Moments at which something happens, heights above the ground, ways of a thrust sensor: from made-up flights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_vehicle.effects import EFFECTS, slot
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.discrepancy.event_times import is_in_flight, likely_events
from sysid.errors import SignalError
from sysid.problem.predictor import Predictor
from sysid.signals.flight import FlightData
from sysid.signals.height import height_above_ground, height_in_flight
from sysid.signals.record import OUTPUTS, Record, effects_at, held_by_dead_band, with_other_inputs
from sysid.signals.thrust.denoising import way_of
from sysid.signals.thrust.source import ThrustSource

Array = NDArray[np.float64]

DT, N = 0.02, 1500
TIME = 5.0 + DT * np.arange(N)
VEHICLE = load_vehicle("iitb-mav")


def record(step_at: float = np.inf, size: float = 1.0, seed: int = 3) -> Record:
    """Lift, drag and pitching that follow from angle of attack, elevator and pitch rate, and jump at one moment."""
    generator = np.random.default_rng(seed)
    t = TIME - TIME[0]
    V, de = 15.0 + 0.8 * np.sin(0.4 * t), 0.03 * np.sin(2.1 * t) + 0.02 * np.sin(5.3 * t + 1.0)
    alpha = 0.07 + 0.03 * np.sin(1.1 * t) + 0.02 * np.sin(2.9 * t)
    after = size * (step_at < TIME)
    z = np.zeros((N, len(OUTPUTS)))
    column = {name: j for j, name in enumerate(OUTPUTS)}
    z[:, column["airspeed"]], z[:, column["alpha"]] = V, alpha
    q = 0.1 * np.cos(1.1 * t)
    z[:, column["q"]] = q + generator.normal(0.0, 5e-4, N)
    z[:, column["az"]] = -(V**2) * (0.004 + 0.1 * alpha + 0.03 * de + 0.002 * after) + generator.normal(0.0, 0.08, N)
    z[:, column["ax"]] = V**2 * (0.002 * alpha - 0.0001 * after) + generator.normal(0.0, 0.08, N)
    commands = np.column_stack((de, np.zeros(N), np.zeros(N), np.full(N, 0.4)))
    return Record("x", DT, TIME, 0, commands, np.full(N, 3.0), np.full(N, 1.2), z, np.zeros((0, 9)))


@pytest.mark.parametrize("moment", [9.1, 17.77, 30.2])
def test_the_moment_of_a_step_is_found_to_a_tenth_of_a_second(moment: float) -> None:
    found = likely_events([record(moment)], VEHICLE, 3)
    assert found[0]["time"] == pytest.approx(moment, abs=0.1)
    # 1 kg and 0.2 m2 in air of 1.2 kg/m3: a force of 0.002 V^2 is 0.0167 of a coefficient.
    assert found[0]["dCL"] == pytest.approx(0.002 / 0.12, rel=0.1)
    assert found[0]["dCD"] == pytest.approx(0.0001 / 0.12 + 0.07 * 0.002 / 0.12, rel=0.3)
    assert abs(found[0]["dCm"]) < 0.002
    assert len(found) == 3
    assert min(abs(a["time"] - b["time"]) for i, a in enumerate(found) for b in found[:i]) >= 1.0


@pytest.mark.parametrize("moment", [5.4, 34.6])
def test_a_moment_has_a_second_of_flight_on_either_side(moment: float) -> None:
    """A step of one sample's length from an end is how the record starts or ends."""
    found = likely_events([record(moment)], VEHICLE, 3)
    assert all(TIME[0] + 1.0 <= one["time"] <= TIME[-1] - 1.0 for one in found)


def test_a_moment_lies_in_the_flight_not_in_each_of_its_records() -> None:
    whole = record(22.2)
    parts = [whole.window(0, 800), whole.window(800, N)]
    assert is_in_flight(parts, float(TIME[800]))
    assert not is_in_flight(parts, float(TIME[0]) + 0.5)
    assert not is_in_flight(parts[:1], float(TIME[799]))


def test_of_two_records_of_one_flight_the_one_that_holds_the_moment_gives_it() -> None:
    whole = record(22.2, 0.3)
    found = likely_events([whole.window(0, 800), whole.window(800, N)], VEHICLE, 2)
    assert found[0]["time"] == pytest.approx(22.2, abs=0.2)


def test_without_an_angle_of_attack_no_moment_is_proposed() -> None:
    blind = record(20.0)
    blind.z[:, OUTPUTS.index("alpha")] = np.nan
    assert likely_events([blind], VEHICLE, 3) == []


def test_starts_for_a_moment_are_the_moments_proposed() -> None:
    events = [{"time": 3.0, "dCL": 0.1, "dCD": 0.5}, {"time": 7.5, "dCL": -0.1, "dCD": 0.0}]
    assert [one["dCD"] for one in EFFECTS["configuration_step"].starts(events)] == [0.2, 0.0]
    assert EFFECTS["configuration_step"].starts(events)[1] == {"dCL": -0.1, "dCD": 0.0, "dCm": 0.0, "time": 7.5}
    starts = EFFECTS["mass_drop"].starts(events)
    assert starts == ({"fraction": 0.02, "time": 3.0}, {"fraction": 0.02, "time": 7.5})
    assert EFFECTS["stall"].starts(events) == ({"alpha_stall": 0.12}, {"alpha_stall": 0.17}, {"alpha_stall": 0.24})


def test_a_choice_gives_one_variant_for_each_name_and_the_variant_needs_no_more_choice() -> None:
    variants = EFFECTS["sensor_time_skew"].variants()
    assert [one.complete({"delay": 0.01})["group"] for one in variants] == [0.0, 1.0, 2.0, 3.0]
    assert len({one.title for one in variants}) == 4
    assert EFFECTS["stall"].variants() == (EFFECTS["stall"],)


def test_what_a_dead_band_holds_may_be_older_than_the_record_and_any_window_of_it() -> None:
    """Worked out by hand: 0.02 is accepted, 0.016 is not, and so the record begins with 0.02 held."""
    model = read_model("iitb-mav").with_effect(EFFECTS["servo_deadband"], {"width": 0.01})
    flat = flatten(VEHICLE, model)
    commands = np.zeros((N, 4))
    commands[:100, 0], commands[100:, 0] = 0.02, 0.016
    whole = replace(record(), commands=commands, command_history=np.zeros((0, 3)))
    part = whole.window(1000, N)
    assert part.start == 75
    effects = effects_at(flat, part)
    begun = held_by_dead_band(part.commands, part, effects)
    assert begun[0].tolist() == [0.02, 0.0, 0.0, 0.0]
    np.testing.assert_array_equal(begun[1:], part.commands[1:])
    assert part.commands[0, 0] == 0.016
    again = part.window(300, 400)
    assert held_by_dead_band(again.commands, again, effects)[0, 0] == 0.02
    plain = flatten(VEHICLE, read_model("iitb-mav"))
    assert held_by_dead_band(part.commands, part, effects_at(plain, part)) is part.commands


# --- height ---


def flight(**columns: Array) -> FlightData:
    return FlightData("f", DT, DT * np.arange(N), columns)


CLIMB = np.concatenate((np.zeros(300), 0.02 * np.arange(N - 300.0)))


def test_height_is_that_of_the_rangefinder_without_its_noise() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.02, N)
    found = height_above_ground(flight(height=1.0 + 0.5 * np.sin(0.02 * np.arange(N)) + noise))
    wanted = 1.0 + 0.5 * np.sin(0.02 * np.arange(N))
    assert float(np.sqrt(np.mean((found - wanted)[50:-50] ** 2))) < 0.012


def test_height_is_altitude_above_where_the_aircraft_stood() -> None:
    speed = np.where(np.arange(N) < 300, 0.3, 15.0)
    found = height_above_ground(flight(altitude=412.0 + CLIMB, airspeed=speed))
    np.testing.assert_allclose(found[350:-50], CLIMB[350:-50], atol=0.02)


def test_altitude_of_a_flight_that_begins_in_the_air_tells_no_height() -> None:
    assert height_above_ground(flight(altitude=412.0 + CLIMB, airspeed=np.full(N, 15.0))).size == 0
    assert height_above_ground(flight(airspeed=np.zeros(N))).size == 0


def test_height_in_flight_is_about_its_middle_by_altitude_or_by_the_velocity_over_ground() -> None:
    """A GPS that comes five times a second tells it to the rounding of what it leaves out."""
    velocity = np.where(np.arange(N) % 10 == 0, -np.gradient(CLIMB, DT), np.nan)
    wanted = CLIMB - np.median(CLIMB)
    for columns in ({"altitude": 412.0 + CLIMB}, {"vd": velocity}, {"altitude": 412.0 + CLIMB, "vd": np.zeros(N)}):
        np.testing.assert_allclose(height_in_flight(flight(**columns))[50:-50], wanted[50:-50], atol=0.2)
    assert height_in_flight(flight(airspeed=np.zeros(N))).size == 0


def test_parts_of_a_flight_in_sheared_wind_share_one_steady_wind() -> None:
    """The velocity over ground north goes up by gradient times height between them, whatever each starts at."""
    model = read_model("iitb-mav").with_effect(EFFECTS["wind_shear"], {"gradient": 0.1})
    flat = flatten(load_vehicle("iitb-mav"), model)
    start = np.array([15.0, 0, 1, 0, 0, 0, 0, 0.07, 0])
    whole = replace(record(), relative_height=CLIMB)
    first = [
        Predictor(flat, (), [part]).outputs(0, flat, {}, start)[0, OUTPUTS.index("vn")]
        for part in (whole.window(100, N), whole.window(600, N))
    ]
    assert first[1] - first[0] == pytest.approx(0.1 * (CLIMB[600] - CLIMB[100]), abs=1e-9)


def test_a_model_with_ground_effect_demands_a_height_in_one_line() -> None:
    model = read_model("iitb-mav").with_effect(EFFECTS["ground_effect"], {"lift_gain": 0.1})
    flat = flatten(load_vehicle("iitb-mav"), model)
    with pytest.raises(SignalError, match="DISTANCE_SENSOR") as caught:
        Predictor(flat, (), [record()]).outputs(0, flat, {}, np.array([15.0, 0, 1, 0, 0, 0, 0, 0.07, 0]))
    assert "\n" not in str(caught.value)


def test_the_measured_height_flies_not_the_integrated_one() -> None:
    """Close to the ground all the time there is more lift than far from it, whatever the motion does."""
    model = read_model("iitb-mav").with_effect(EFFECTS["ground_effect"], {"lift_gain": 0.3})
    flat = flatten(load_vehicle("iitb-mav"), model)
    start = np.array([15.0, 0, 1, 0, 0, 0, 0, 0.07, 0])
    lift = []
    for height in (0.0, 100.0):
        one = replace(record(), heights=np.full(N, height))
        lift.append(Predictor(flat, (), [one]).outputs(0, flat, {}, start)[:, OUTPUTS.index("az")])
    plain = flatten(load_vehicle("iitb-mav"), read_model("iitb-mav"))
    free = Predictor(plain, (), [record()]).outputs(0, plain, {}, start)[:, OUTPUTS.index("az")]
    np.testing.assert_allclose(lift[1], free, atol=1e-3)
    assert lift[0][0] < 1.25 * free[0]


def test_a_battery_sags_at_the_records_own_time_and_not_behind_a_measured_propeller_speed() -> None:
    model = read_model("iitb-mav").with_effect(EFFECTS["battery_sag"], {"rate": 0.002})
    flat = flatten(load_vehicle("iitb-mav"), model)
    throttled = replace(record(), thrust=np.full(N, np.nan), thrust_source=ThrustSource("throttle", "max_thrust"))
    late = throttled.window(500, N)
    start = np.array([15.0, 0, 1, 0, 0, 0, 0, 0.07, 0])
    ax = [Predictor(flat, (), [one]).outputs(0, flat, {}, start)[0, OUTPUTS.index("ax")] for one in (throttled, late)]
    lost = 8.0 * 0.4 * (np.exp(-0.002 * 5.0) - np.exp(-0.002 * 15.0))
    assert late.time_s[0] == pytest.approx(15.0)
    plain = flatten(load_vehicle("iitb-mav"), read_model("iitb-mav"))
    same = [
        Predictor(plain, (), [one]).outputs(0, plain, {}, start)[0, OUTPUTS.index("ax")] for one in (throttled, late)
    ]
    assert (ax[0] - ax[1]) - (same[0] - same[1]) == pytest.approx(lost, rel=1e-6)
    measured = replace(throttled, thrust_source=ThrustSource("rpm", "CT(J)"))
    assert effects_at(flat, measured)[slot("battery_sag")] == 0.0
    assert effects_at(flat, throttled)[slot("battery_sag")] == 1.0


# --- hysteresis of the thrust sensor ---


def played(load: Array, width: float) -> Array:
    """Free play, sample by sample."""
    reading, last = np.empty(load.size), load[0]
    for k, value in enumerate(load):
        last = min(max(last, value - 0.5 * width), value + 0.5 * width)
        reading[k] = last
    return reading


def test_the_way_of_a_reading_is_up_where_the_load_rises_and_down_where_it_falls() -> None:
    load = 3.0 + np.interp(DT * np.arange(N), [0.0, 8.0, 16.0, 24.0, 30.0], [0.0, 2.0, -1.0, 2.0, 0.5])
    noise = np.random.default_rng(5).normal(0.0, 0.02, N)
    width = 0.2
    way = way_of(played(load, width) + noise, DT)
    for begin, end, wanted in ((1.0, 7.8, 1.0), (9.0, 15.8, -1.0), (17.0, 23.8, 1.0), (25.5, 29.5, -1.0)):
        part = slice(round(begin / DT), round(end / DT))
        assert np.min(wanted * way[part]) > 0.9
        assert np.mean(wanted * way[part]) > 0.99


def test_the_load_behind_a_reading_is_right_wherever_it_moves() -> None:
    load = 3.0 + 0.8 * np.sin(2.0 * np.pi * 0.2 * DT * np.arange(N))
    width = 0.3
    reading = played(load, width)
    model = read_model("iitb-mav").with_effect(EFFECTS["thrust_sensor_hysteresis"], {"width": width})
    flat = flatten(load_vehicle("iitb-mav"), model)
    way = way_of(reading + np.random.default_rng(6).normal(0.0, 0.01, N), DT)
    inputs = with_other_inputs(
        record().commands, replace(record(), hysteresis_direction=way), effects_at(flat, record())
    )
    found = reading + 0.5 * width * inputs[:, 5]
    before, after = float(np.std(reading - load)), float(np.std(found - load))
    assert after < 0.35 * before


def test_a_constant_reading_goes_no_way() -> None:
    np.testing.assert_array_equal(way_of(np.full(100, 3.0), DT), np.zeros(100))
