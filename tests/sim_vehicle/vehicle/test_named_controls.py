"""Controls beyond elevator, aileron, rudder and throttle: read from the file, mixed, and flown."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim_vehicle.errors import ModelFileError, PlanError
from sim_vehicle.flight.plant import Plant
from sim_vehicle.manoeuvres.plan import plan_of
from sim_vehicle.manoeuvres.plan_ticks import Schedule
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.servo_mixing import ServoOutputs
from sim_vehicle.vehicle.vehicle_file import VEHICLES, Vehicle, vehicle_from_text

FLAPERONS = """
[controls.aileron]
servo = [1, 5]
pwm = [[1000, 2000], [1000, 2000]]
deflection = [[-0.5, 0.5], [-0.5, 0.5]]
mix = [0.5, -0.5]
[controls.flap]
servo = [1, 5]
pwm = [[1000, 2000], [1000, 2000]]
deflection = [[-0.5, 0.5], [-0.5, 0.5]]
mix = [0.5, 0.5]
"""


def craft(more: str) -> Vehicle:
    """The packaged aircraft with other controls beside its elevator, rudder and throttle."""
    text = (VEHICLES / "iitb-mav.toml").read_text(encoding="utf-8")
    kept, _, rest = text.partition("[controls.aileron]")
    if "[controls.aileron]" in more:
        text = kept + "[" + rest.partition("\n[")[2]
    return vehicle_from_text(text + more, Path("craft.toml"), tables_in=VEHICLES)


FLAP = "\n[controls.flap]\nservo = 6\npwm = [1000, 2000]\ndeflection = [0.0, 0.6]\n"


def test_flaperons_are_ailerons_and_a_flap_of_two_servos() -> None:
    vehicle = craft(FLAPERONS)
    assert vehicle.named_controls == ("flap",)
    outputs = ServoOutputs(vehicle)
    asked = np.array([0.01, 0.05, -0.02, 0.5, 0.1])
    pulses = outputs.pulses(asked)
    assert (pulses[1], pulses[5]) == (1650, 1550)  # 0.1 + 0.05 and 0.1 - 0.05 rad at 1000 us a radian
    np.testing.assert_allclose(outputs.command(pulses, asked), asked, atol=1e-3)
    np.testing.assert_allclose(outputs.limits[4], (-0.5, 0.5))


def test_a_flap_that_is_set_flies_as_another_lift_and_moment_would() -> None:
    """CL_flap times its deflection is a change of CL_0, and so for drag and moment."""
    vehicle, model, set_to = craft(FLAP), read_model("iitb-mav"), 0.2
    effects = {"CL": 0.8, "CD": 0.05, "Cm": -0.1}
    flapped, other = model, model
    for axis, value in effects.items():
        flapped = flapped.with_coefficient(f"{axis}_flap", value)
        other = other.with_coefficient(f"{axis}_0", model.values()[f"{axis}_0"] + set_to * value)
    plants = [Plant(vehicle, flapped), Plant(vehicle, other)]
    trim = plants[1].trim()
    states = [plant.state_at(trim.state.x, trim.command, trim.state.surfaces) for plant in plants]
    for tick in range(200):
        command = trim.command + np.array([0.03 * np.sin(0.1 * tick), 0.02 * np.sin(0.07 * tick), 0.0, 0.0])
        plants[0].step(states[0], np.append(command, set_to), 0.02)
        plants[1].step(states[1], command, 0.02)
    np.testing.assert_allclose(states[0].x, states[1].x, rtol=1e-12, atol=1e-12)
    assert states[0].surfaces[4] == set_to


def test_without_a_term_of_it_a_control_moves_nothing() -> None:
    vehicle, model = craft(FLAP), read_model("iitb-mav")
    plants = Plant(vehicle, model), Plant(replace(vehicle, controls={}), model)
    trim = plants[0].trim()
    states = [plant.state_at(trim.state.x, trim.command, trim.state.surfaces) for plant in plants]
    for _ in range(50):
        plants[0].step(states[0], np.append(trim.command, 0.3), 0.02)
        plants[1].step(states[1], trim.command, 0.02)
    np.testing.assert_array_equal(states[0].x, states[1].x)


def test_a_model_of_a_control_that_the_vehicle_lacks_is_refused_in_one_line() -> None:
    with pytest.raises(ModelFileError, match=r"CL_flap is of flap, .* name it under \[controls.flap\]"):
        Plant(craft(""), read_model("iitb-mav").with_coefficient("CL_flap", 0.5))


def test_manoeuvres_of_a_control_of_its_own_name() -> None:
    schedule = Schedule(plan_of(["flap-step", "elevator-doublet"]), 0.02, ("flap",))
    assert schedule.increments.shape[1] == 5
    assert np.ptp(schedule.increments[:600, 4]) > 0.0
    assert not schedule.increments[:600, :4].any()
    with pytest.raises(PlanError, match="the vehicle has no control flap; it has elevator, aileron, rudder, throttle"):
        Schedule(plan_of(["flap-step"]), 0.02)
    with pytest.raises(PlanError, match=r"no manoeuvre .flap-loop.; there are .* NAME-doublet"):
        plan_of(["flap-loop"])
