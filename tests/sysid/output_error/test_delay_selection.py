"""Delays that the whole motion tells: hidden in the simulator or in the stamps, they come back with their bars."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from signal_mistakes import GROUPS, Injection
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.compatibility.reconstruction import check_compatibility
from sysid.identify import Identification, identify
from sysid.output_error.fit import build
from sysid.problem.delay_parameters import COMMAND_DELAY, late_readings
from sysid.problem.formulation import make_problem
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import prepare
from sysid.signals.record import OUTPUTS

pytestmark = pytest.mark.whole_flight

VEHICLE = load_vehicle("iitb-mav")
TRUE = {"Cl_da": 0.15, "Cm_de": 1.5894, "Cn_dr": -0.08, "Cl_p": -0.45}


def told(flight: FlightSignals, method: str = "oe") -> Identification:
    return identify([flight], VEHICLE, method=method, systematic=False)


@pytest.mark.parametrize(("method", "delay", "worst"), [("oe", 0.055, 1e-4), ("oe", 0.013, 1e-4), ("ee", 0.07, 1e-3)])
def test_a_delay_of_the_commands_is_found_without_being_told(method: str, delay: float, worst: float) -> None:
    """An ignored 40 ms would change Cl_da by hundreds of per cent; the simulator delays exactly, at 2 ms steps."""
    found = told(fly_mav("multisine", 41, effects=(f"actuator_delay:delay={delay}",))[0], method)
    (late,) = found.check.delays
    assert late.name == "commands"
    assert late.value == pytest.approx(delay, abs=worst)
    assert 0.0 < late.std < worst
    for name, value in TRUE.items():
        assert found.model.values()[name] == pytest.approx(value, rel=0.02)
    assert any("the aircraft follows its commands" in text for text in found.warnings)


def test_commands_stamped_late_are_put_back_and_a_flight_in_time_has_no_delay() -> None:
    flight = fly_mav("multisine", 42)[0]
    assert told(flight).check.delays == ()
    # Whole samples: a command is held from its stamp on, and stamps are those of the sensors.
    late = Injection(GROUPS["commands"], "delay", "", None, 0.04).apply(flight)
    found = told(late)
    assert [round(one.value, 4) for one in found.check.delays] == [-0.04]
    assert found.model.values()["Cl_da"] == pytest.approx(0.15, rel=0.005)


def test_a_lag_of_the_servos_is_not_taken_for_a_delay_in_silence() -> None:
    found = told(fly_mav("multisine", 43, effects=("actuator_lag:tau=0.05",))[0])
    (text,) = (text for text in found.warnings if "lag of the servos" in text)
    assert "50.0 ±" in text
    assert "actuator_lag" in text


def test_readings_come_late_by_any_part_of_a_sample_and_angles_turn_through_pi() -> None:
    time = 0.02 * np.arange(300)
    y = np.zeros((300, len(OUTPUTS)))
    alpha, psi = OUTPUTS.index("alpha"), OUTPUTS.index("psi")
    y[:, alpha] = np.sin(6.0 * time)
    y[:, psi] = (time + 2.0) % (2.0 * np.pi)
    late = late_readings(y, {"delay_vanes": 0.013, "delay_attitude": -0.031}, 0.02)
    assert late[5:-5, alpha] == pytest.approx(np.sin(6.0 * (time - 0.013))[5:-5], abs=1e-5)
    assert np.angle(np.exp(1j * (late[5:-5, psi] - time[5:-5] - 2.031))) == pytest.approx(0.0, abs=1e-9)
    assert np.array_equal(late[:, OUTPUTS.index("q")], y[:, OUTPUTS.index("q")])


def test_slopes_by_delays_are_those_of_what_is_predicted() -> None:
    prepared = [prepare(fly_mav("multisine", 44, duration=8.0)[0], VEHICLE)]
    compatible = check_compatibility(prepared)
    problem = make_problem(prepared, VEHICLE, compatible, ["alpha_bias"])
    delays = {COMMAND_DELAY: 0.031, "delay_vanes": 0.007, "delay_air_data": -0.012, "delay_attitude": 0.004}
    model = read_model("iitb-mav")
    estimation = build(replace(problem, delays=delays), model, ["Cl_da", "Cm_de"])
    theta = estimation.start(model.values() | delays)
    predicted = estimation.predict(theta)
    (S, *_) = estimation.sensitivities(theta, predicted)
    columns = estimation.columns
    for i, parameter in enumerate(estimation.predictor.parameters):
        step = np.zeros(theta.size)
        step[i] = 1e-5
        up, down = estimation.predict(theta + step)[0], estimation.predict(theta - step)[0]
        slope = ((up - down) / 2e-5)[:, columns]
        assert np.abs(S[:, columns, i] - slope)[2:-2].max() < 0.02 * np.abs(slope).max(), parameter.name


def test_a_surface_that_is_frozen_in_the_recording_is_named_with_the_cure() -> None:
    flight = fly_mav("multisine", 45)[0]
    still = replace(flight.signals["dr"], values=np.full_like(flight.signals["dr"].values, 0.01))
    found = told(replace(flight, signals={**flight.signals, "dr": still}), "ee")
    assert any("dr: repeats one value, yet" in text and "controls.rudder" in text for text in found.warnings)
    assert not any("repeats one value" in text for text in told(flight, "ee").warnings)


def test_thrust_that_stands_still_while_the_throttle_moves_is_named() -> None:
    flight = fly_mav("throttle-multisine,elevator-3211", 46)[0]
    dead = replace(flight.signals["thrust"], values=np.full_like(flight.signals["thrust"].values, 2.0))
    (text,) = prepare(replace(flight, signals={**flight.signals, "thrust": dead}), VEHICLE).warnings[-1:]
    assert "while the throttle moves: the sensor is dead" in text
