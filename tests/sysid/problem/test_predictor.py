"""How estimated numbers enter the simulation and the sensors."""

from __future__ import annotations

from dataclasses import replace

import mav_longitudinal as mav
import numpy as np
import pytest
from mav_problem import longitudinal_record, vehicle
from numpy.typing import NDArray
from one_record import make_record

from sim_vehicle.effects import EFFECTS, slot
from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.packed_model import PackedModel, flatten
from sysid.problem.free_parameters import coefficient, effect_parameter, sensor_error
from sysid.problem.predictor import Predictor
from sysid.signals.record import OUTPUTS, Record
from sysid.signals.sensor_errors import SENSOR_ERRORS

Array = NDArray[np.float64]

N = 100
COLUMN = {name: j for j, name in enumerate(OUTPUTS)}


def flat() -> PackedModel:
    return flatten(vehicle(), Model("mav", {name: Coefficient(value) for name, value in mav.COEFFICIENTS.items()}))


@pytest.fixture(scope="module")
def record() -> Record:
    data = mav.measure(mav.fly(mav.pulse(duration=N * 0.02, start=0.2, width=0.5)), np.random.default_rng(0))
    return longitudinal_record(data)


def states() -> Array:
    guess = np.zeros(9)
    guess[[0, 2, 4, 7]] = mav.trim()[0]
    return guess


def test_a_prediction_is_the_flight_of_the_independent_truth(record: Record) -> None:
    """Far below the noise, though the steps are five times as long."""
    truth = mav.fly(mav.pulse(duration=N * 0.02, start=0.2, width=0.5))
    found = Predictor(flat(), (), [record], command_first=True).outputs(0, flat(), {}, states())
    for name in ("airspeed", "alpha", "q", "theta", "ax", "az"):
        np.testing.assert_allclose(found[:, COLUMN[name]], truth[name], atol=2e-5, err_msg=name)


@pytest.mark.parametrize("name", sorted(SENSOR_ERRORS))
def test_a_sensor_error_is_one_plus_scale_times_the_truth_plus_bias(name: str, record: Record) -> None:
    predictor = Predictor(flat(), (), [record])
    plain = predictor.outputs(0, flat(), {}, states())
    erring = predictor.outputs(0, flat(), {name: 0.03}, states())
    channel, form, _, _ = SENSOR_ERRORS[name]
    wanted = plain.copy()
    true = plain[:, COLUMN[channel]]
    wanted[:, COLUMN[channel]] = 1.03 * true if form == "scale" else true + 0.03
    np.testing.assert_allclose(erring, wanted, atol=1e-12)


def test_sensor_errors_act_on_the_output_they_are_named_after() -> None:
    over_ground = {"wind_north": "vn", "wind_east": "ve", "wind_down": "vd"}
    for name, (channel, form, unit, size) in SENSOR_ERRORS.items():
        short = over_ground.get(name) or name.replace("accel_bias_", "a").replace("gyro_bias_", "").removesuffix(
            "_bias"
        ).removesuffix("_scale")
        assert (channel, form) == (short, "scale" if name.endswith("_scale") else "bias")
        assert (unit == "1") == (form == "scale")
        assert size > 0.0


def test_a_bias_of_ax_is_no_thrust_of_the_motor_that_hangs_on_the_cell() -> None:
    """Thrust is the cell plus 0.08 kg times measured ax; the part that is bias must come off again."""
    truth = mav.fly(mav.pulse(duration=N * 0.02))
    plane = vehicle()
    assert plane.propulsion is not None
    plane = replace(plane, propulsion=replace(plane.propulsion, moving_mass=0.08))
    found = []
    for bias in (0.0, 0.5):
        errors = {"accel_bias_x": bias}
        data = mav.measure(truth, np.random.default_rng(0), errors=errors, noise={})
        # A steady flight: what the cell reads is thrust less what accelerates the motor.
        ax = np.full(N, truth["ax"][0])
        columns = {**data.columns, "ax": ax + bias, "thrust": truth["thrust"] - 0.08 * ax}
        record = make_record(replace(data, columns=columns), plane, 0, N)
        found.append(Predictor(flat(), (), [record]).outputs(0, flat(), errors, states()))
    np.testing.assert_allclose(found[1][:, COLUMN["airspeed"]], found[0][:, COLUMN["airspeed"]], atol=1e-9)
    np.testing.assert_allclose(found[1][:, COLUMN["ax"]], found[0][:, COLUMN["ax"]] + 0.5, atol=1e-9)


def test_values_reach_their_places_and_leave_the_given_model_alone(record: Record) -> None:
    given = flat()
    before = (given.C.copy(), given.E.copy())
    parameters = [coefficient("Cm_alpha"), effect_parameter("stall", "alpha_stall"), sensor_error("gyro_bias_q")]
    predictor = Predictor(given, parameters, [record])
    theta = np.concatenate(([-0.7, 0.21, 0.004], states()[[0, 2, 4, 7]]))
    model, errors = predictor.apply(theta)
    assert model.C[model.names.index("Cm_alpha")] == -0.7
    assert model.E[slot("stall")] == 1.0
    assert model.E[slot("stall", "alpha_stall")] == 0.21
    assert errors == {"gyro_bias_q": 0.004}
    np.testing.assert_array_equal(given.C, before[0])
    np.testing.assert_array_equal(given.E, before[1])


def test_unknowns_are_the_parameters_and_the_free_states_of_each_record(record: Record) -> None:
    free = replace(record, imposed_states=np.zeros((0, 9)))
    predictor = Predictor(flat(), [coefficient("Cm_alpha")], [record, free, record])
    assert predictor.free_states == [[0, 2, 4, 7], list(range(9)), [0, 2, 4, 7]]
    assert predictor.size == 1 + 4 + 9 + 4
    assert [predictor.state_slice(i) for i in range(3)] == [slice(1, 5), slice(5, 14), slice(14, 18)]
    theta = np.arange(18.0)
    guess = -np.ones(9)
    assert predictor.initial_states(0, theta, guess).tolist() == [1, -1, 2, -1, 3, -1, -1, 4, -1]
    assert predictor.initial_states(1, theta, guess).tolist() == list(range(5, 14))
    assert guess.tolist() == [-1.0] * 9


@pytest.mark.parametrize("name", sorted(n for n, e in EFFECTS.items() if not e.is_coefficient))
def test_parameters_of_effects_carry_the_bounds_of_the_catalogue(name: str) -> None:
    for entry in EFFECTS[name].parameters:
        parameter = effect_parameter(name, entry.name)
        assert (parameter.name, parameter.low, parameter.high) == (f"{name}.{entry.name}", entry.low, entry.high)
        assert parameter.kind == "effect"
    with pytest.raises(KeyError):
        effect_parameter(name, "wibble")


def test_a_prior_of_a_coefficient_is_kept() -> None:
    assert coefficient("Cm_q").prior_std == np.inf
    told = coefficient("Cm_q", -5.0, 2.0)
    assert (told.prior_mean, told.prior_std) == (-5.0, 2.0)
