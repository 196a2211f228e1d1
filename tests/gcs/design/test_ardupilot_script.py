"""A plan as PWM schedule and as ArduPilot script, the script run by a Lua 5.3 interpreter as ArduPilot has one."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from ardupilot_stand_in import StandIn

from gcs.design.ardupilot import lua_script
from gcs.design.pulses import PulseSchedule, pulse_schedule
from gcs.errors import SettingsError
from sim_vehicle.manoeuvres.plan import Plan, plan_of
from sim_vehicle.manoeuvres.shapes import manoeuvre
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle

ULTRASTICK = load_vehicle("ultrastick25e")
ULTRASTICK_MODEL = read_model("ultrastick25e")
RATE = 50.0
ELEVONS = """
name = "wing"
[mass]
mass = 1.0
Ixx = 0.02
Iyy = 0.03
Izz = 0.045
[geometry]
S = 0.2
b = 1.0
c = 0.2
[flight]
airspeed = 15.0
[controls.elevator]
servo = [1, 2]
pwm = [[1000, 1500, 2000], [1000, 1400, 2000]]
deflection = [[-0.4, 0.0, 0.4], [0.5, 0.0, -0.5]]
mix = [0.5, 0.5]
[controls.aileron]
servo = [1, 2]
pwm = [[1000, 1500, 2000], [1000, 1400, 2000]]
deflection = [[-0.4, 0.0, 0.4], [0.5, 0.0, -0.5]]
mix = [0.5, -0.5]
[controls.throttle]
servo = 3
pwm = [1000, 2000]
deflection = [0.0, 1.0]
[propulsion]
max_thrust = 8.0
"""


@pytest.fixture(scope="module")
def wing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Vehicle, Model]:
    path = tmp_path_factory.mktemp("wing") / "wing.toml"
    path.write_text(ELEVONS)
    return load_vehicle(path), read_model("iitb-mav")


def test_the_csv_gives_the_deflections_of_the_plan_through_curves_and_mixes(
    wing: tuple[Vehicle, Model], tmp_path: Path
) -> None:
    vehicle, model = wing
    plan = plan_of(["elevator-3211", "aileron-doublet"])
    pulse_schedule(vehicle, model, plan, RATE).write_csv(tmp_path / "pulses.csv")
    with (tmp_path / "pulses.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["time_s", "servo1_us", "servo2_us", "servo3_us"]
    table = np.array(rows[1:], dtype=np.float64)
    assert table[:, 0] == pytest.approx(np.arange(table.shape[0]) / RATE)
    # Read the way a recording's servo outputs are read.
    pitch = vehicle.controls["elevator"].deflection_from_pwm(table[:, 1], table[:, 2])
    roll = vehicle.controls["aileron"].deflection_from_pwm(table[:, 1], table[:, 2])
    asked = np.concatenate([segment.increments(np.arange(round(segment.duration * 50)) / RATE)
                            for segment in plan.segments])  # fmt: skip
    assert pitch[:-1] - pitch[0] == pytest.approx(asked[:, 0], abs=0.0015)
    assert roll[:-1] - roll[0] == pytest.approx(asked[:, 1], abs=0.0015)
    assert np.ptp(roll) > 0.06
    assert not np.ptp(table[:, 3])


def armed_script(vehicle: Vehicle, model: Model, plan: Plan, **options: bool) -> tuple[StandIn, PulseSchedule]:
    """The script on its autopilot, trimmed for two seconds with the switch low."""
    schedule = pulse_schedule(vehicle, model, plan, RATE)
    autopilot = StandIn(dict(schedule.trim), **options)
    autopilot.load(lua_script(vehicle, model, plan, RATE))
    for _ in range(100):
        assert autopilot.tick() == {}
    autopilot.state.switch = 2
    return autopilot, schedule


@pytest.mark.parametrize("named_by_unit", [True, False])
def test_the_script_plays_the_schedule_on_the_trim_it_finds(named_by_unit: bool) -> None:
    plan = plan_of(["multisine", "rudder-3211"])
    autopilot, schedule = armed_script(ULTRASTICK, ULTRASTICK_MODEL, plan, named_by_unit=named_by_unit)
    played = [autopilot.tick()]
    assert autopilot.messages[-1].endswith("begins")
    played += [autopilot.tick() for _ in range(round(plan.duration * 50))]
    assert autopilot.messages[-1].endswith("done")
    assert autopilot.tick() == {}
    for k in range(schedule.time_s.size - 1):
        longitudinal, lateral = schedule.freed[k]
        freed = {*((2, 3) if longitudinal else ()), *((1, 4, 5) if lateral else ())}
        assert set(played[k]) == freed, k
        for servo, pwm in played[k].items():
            assert abs(pwm - schedule.pulses[servo][k]) <= 1, (servo, k)
    assert autopilot.timeouts == {100}
    # Elevator and throttle stay the autopilot's while the rudder alone is excited.
    assert any(schedule.freed[k].tolist() == [False, True] for k in range(1250, 1800))


def test_another_trim_shifts_the_pulses_and_ends_of_travel_hold() -> None:
    plan = Plan((manoeuvre("elevator-doublet", amplitude=0.3),))
    schedule = pulse_schedule(ULTRASTICK, ULTRASTICK_MODEL, plan, RATE)
    autopilot = StandIn({**schedule.trim, 2: 1900})
    autopilot.load(lua_script(ULTRASTICK, ULTRASTICK_MODEL, plan, RATE))
    for _ in range(500):
        autopilot.tick()
    autopilot.state.switch = 2
    played = [autopilot.tick().get(2) for _ in range(150)]
    values = {pwm for pwm in played if pwm is not None}
    travel = round(0.3 / 0.436 * 500)
    assert max(values) == 2000
    assert abs(min(values) - (1900 - travel)) <= 1


def test_bank_is_held_weakly_against_the_roll() -> None:
    autopilot, schedule = armed_script(ULTRASTICK, ULTRASTICK_MODEL, plan_of(["rudder-doublet"]))
    autopilot.state.roll = 0.2
    played = [autopilot.tick() for _ in range(60)][-1]
    aileron = ULTRASTICK.controls["aileron"]
    moved = float(aileron.deflection_from_pwm(played[1], played[5]))
    rest = float(aileron.deflection_from_pwm(schedule.trim[1], schedule.trim[5]))
    # To the left for a bank to the right, whatever the sign of the aileron is.
    assert (moved - rest) * ULTRASTICK_MODEL.values()["Cl_da"] < 0.0
    assert 0.001 < abs(moved - rest) < 0.1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"switch": 1}, "switched off"),
        ({"armed": False}, "not armed"),
        ({"mode": 0}, "not in its mode"),
        ({"roll": -1.2}, "bank or pitch"),
        ({"pitch": 0.9}, "bank or pitch"),
        ({"height": 30.0}, "too low"),
    ],
)
def test_the_script_lets_go_and_waits_for_the_switch(change: dict[str, float], words: str) -> None:
    autopilot, _ = armed_script(ULTRASTICK, ULTRASTICK_MODEL, plan_of(["elevator-3211"]))
    for _ in range(70):
        autopilot.tick()
    assert autopilot.taken
    before = {key: autopilot.state[key] for key in change}
    for key, value in change.items():
        autopilot.state[key] = value
    assert autopilot.tick() == {}
    assert words in autopilot.messages[-1]
    for key, value in before.items():
        autopilot.state[key] = value
    autopilot.state.switch = 2
    for _ in range(100):
        assert autopilot.tick() == {}, "it must not begin again by itself"
    autopilot.state.switch = 0
    autopilot.tick()
    autopilot.state.switch = 2
    assert [taken for taken in (autopilot.tick() for _ in range(70)) if taken]


def test_a_late_call_leaves_samples_out_and_stays_in_time() -> None:
    autopilot, schedule = armed_script(ULTRASTICK, ULTRASTICK_MODEL, plan_of(["elevator-multisine"]))
    autopilot.tick()
    k = 0
    for wait in (20, 20, 60, 20, 400, 20, 1000, 20, 40):
        played = autopilot.tick(wait)
        k += wait // 20
        for servo, pwm in played.items():
            assert abs(pwm - schedule.pulses[servo][k]) <= 1
    assert k > 75
    assert 2 in played


def test_plans_that_no_script_can_fly_are_refused() -> None:
    with pytest.raises(SettingsError, match="deceleration"):
        lua_script(ULTRASTICK, ULTRASTICK_MODEL, plan_of(["deceleration"]), RATE)
    with pytest.raises(SettingsError, match="shorter --duration"):
        lua_script(ULTRASTICK, ULTRASTICK_MODEL, plan_of(["multisine"]).fitted(500.0), RATE)
