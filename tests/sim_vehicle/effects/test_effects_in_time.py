"""Effects of the flight's time, of the ground and of the centre of gravity, against hand-worked values."""

from __future__ import annotations

import math

import hand_flight as hf
import numpy as np
import pytest
from numpy.typing import NDArray

from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.manoeuvres.plan import plan_of

Array = NDArray[np.float64]

ACCELERATIONS = ("ax", "ay", "az", "p_dot", "q_dot", "r_dot")
SWITCHING = [(1.9, 0.0), (2.0, 0.0), (2.1, 0.25), (2.3, 0.75), (2.4, 1.0), (9.0, 1.0)]


def accelerations(effects: dict[str, dict[str, float]], time_s: float = 0.0, height: float = 100.0) -> dict[str, float]:
    """Of the aircraft in its general state at that time and height."""
    plant = hf.plant_with(effects)
    x = hf.body_state()
    x[2] = -height
    state = hf.state_of(plant, x)
    state.time_s = time_s
    plant.evaluate(state, hf.STILL, hf.STILL, 0.0)
    found = hf.outputs(plant, state)
    return {name: found[name] for name in ACCELERATIONS}


def assert_same(found: dict[str, float], wanted: dict[str, float]) -> None:
    for name in ACCELERATIONS:
        assert found[name] == pytest.approx(wanted[name], rel=1e-10, abs=1e-12), name


@pytest.mark.parametrize(("time_s", "share"), SWITCHING)
def test_a_change_of_configuration_is_a_ramp_of_lift_drag_and_pitching_moment(time_s: float, share: float) -> None:
    values = {"dCL": 0.2, "dCD": 0.03, "dCm": -0.05, "time": 2.0, "duration": 0.4}
    hand = hf.Hand(extra_CL=0.2 * share, extra_CD=0.03 * share)
    hand.moments = np.array([0.0, hand.qbar * hf.S * hf.C * -0.05 * share, 0.0])
    assert_same(accelerations({"configuration_step": values}, time_s), hand.accelerations())


@pytest.mark.parametrize(("time_s", "share"), SWITCHING)
def test_mass_that_falls_off_leaves_the_forces_and_moves_less(time_s: float, share: float) -> None:
    values = {"fraction": 0.2, "time": 2.0, "duration": 0.4}
    wanted = hf.Hand(mass=hf.MASS * (1.0 - 0.2 * share)).accelerations()
    assert_same(accelerations({"mass_drop": values}, time_s), wanted)


@pytest.mark.parametrize("time_s", [0.0, 30.0, 300.0])
def test_thrust_of_a_sagging_battery_falls_exponentially(time_s: float) -> None:
    wanted = hf.Hand(thrust=hf.MAX_THRUST * hf.THROTTLE * math.exp(-0.002 * time_s)).accelerations()
    assert_same(accelerations({"battery_sag": {"rate": 0.002}}, time_s), wanted)


@pytest.mark.parametrize(("height", "phi"), [(0.0, 0.0), (1.0 / 16.0, 0.5), (0.2, 10.24 / 11.24), (50.0, 1.0)])
def test_the_ground_adds_lift_and_takes_induced_drag(height: float, phi: float) -> None:
    """A span of 1 m: half of the effect is left at a sixteenth of it."""
    hand = hf.Hand(attached=1.0 + 0.2 * (1.0 - phi))
    hand.coefficients["CD_k"] *= 1.0 - 0.4 * (1.0 - phi)
    found = accelerations({"ground_effect": {"lift_gain": 0.2, "drag_reduction": 0.4}}, height=height)
    for name, wanted in hand.accelerations().items():
        assert found[name] == pytest.approx(wanted, rel=1e-5), name


def test_a_shifted_centre_of_gravity_gives_all_forces_but_gravity_an_arm() -> None:
    x, hand = 0.03, hf.Hand()
    force = hand.accelerations()
    # About a point 3 cm ahead the forces act 3 cm behind: r x F.
    hand.moments = np.cross([-x, 0.0, 0.0], hf.MASS * np.array([force["ax"], force["ay"], force["az"]]))
    assert_same(accelerations({"cg_shift": {"x": x}}), hand.accelerations())


def test_a_centre_of_gravity_ahead_takes_lift_slope_times_its_arm_from_the_pitching_slope() -> None:
    """dCm_alpha = -CL_alpha x / c: what a flight shows of it is another Cm_alpha."""
    x, moments = 0.01, []
    for alpha in (0.04, 0.06):
        plant = hf.plant_with({"cg_shift": {"x": x}})
        state = hf.body_state()
        state[3:6] = hf.V * np.array([math.cos(alpha), 0.0, math.sin(alpha)])
        state[10:13] = 0.0
        flying = hf.state_of(plant, state, np.zeros(4))
        moments.append(hf.outputs(plant, flying)["q_dot"] * hf.IYY / (0.5 * hf.RHO * hf.V**2 * hf.S * hf.C))
    model = hf.model_with({}).values()
    assert (moments[1] - moments[0]) / 0.02 == pytest.approx(
        model["Cm_alpha"] - model["CL_alpha"] * x / hf.C, abs=0.1 * model["CL_alpha"] * x / hf.C
    )


def test_the_time_of_a_flight_goes_on_with_its_ticks() -> None:
    plant = hf.plant_with({})
    state = hf.state_of(plant)
    for _ in range(50):
        plant.step(state, hf.SURFACES, 0.02)
    assert state.time_s == pytest.approx(1.0, abs=1e-12)
    assert state.copy().time_s == state.time_s


@pytest.mark.parametrize("max_step", [0.02, 0.007, 0.001])
def test_what_a_step_does_to_the_motion_does_not_depend_on_the_integration(max_step: float) -> None:
    """Speed lost to drag that comes at 0.53 s, against its own differential equation solved very finely."""
    effects = {"configuration_step": {"dCL": 0.0, "dCD": 0.05, "dCm": 0.0, "time": 0.53, "duration": 0.1}}
    ends = []
    for step in (max_step, 0.0002):
        plant = Plant(hf.vehicle(), hf.model_with(effects), max_step=step)
        state = hf.state_of(plant)
        for _ in range(50):
            plant.step(state, hf.SURFACES, 0.02)
        ends.append(state.x[3:6].copy())
    np.testing.assert_allclose(ends[0], ends[1], atol=3e-5)


@pytest.mark.whole_flight
def test_times_are_counted_from_the_flights_first_stamp_also_when_it_stands_first() -> None:
    """With two seconds and more on the ground before, thrust has sagged by the time of the manoeuvre."""
    for taxi in (False, True):
        plant = Plant(hf.vehicle(), hf.model_with({"battery_sag": {"rate": 0.01}}))
        plan = plan_of(["cruise"])
        generator = np.random.default_rng(1)
        suite = SensorSuite(plant.vehicle, noise="none", generator=generator)
        flown = fly(plant, plan, suite=suite, generator=generator, duration=2.0, taxi=taxi)
        flying = np.flatnonzero(flown.airborne)[5:-5]
        share = flown.truth["thrust"][flying] / (hf.MAX_THRUST * flown.truth["throttle"][flying])
        np.testing.assert_allclose(share, np.exp(-0.01 * flown.time_s[flying]), rtol=1e-9)
