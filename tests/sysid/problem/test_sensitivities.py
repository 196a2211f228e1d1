"""Tangents of a simulated flight against central differences of the simulation itself (Richardson's extrapolation)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import hand_flight as hf
import numpy as np
import pytest
from effect_values import VALUES as EVERY_VALUE
from numpy.typing import NDArray

from sim_vehicle.effects import EFFECTS, THRUST_AIRSPEED, THRUST_BEND, THRUST_SLOPE
from sim_vehicle.model.model_file import Model
from sim_vehicle.physics.kernel_records import DrivingInputs
from sim_vehicle.physics.layout import CHANNELS, MORE_COLUMN, Par
from sim_vehicle.physics.rotation import quaternion
from sim_vehicle.physics.simulation import simulate
from sim_vehicle.sensitivities.sensor_jacobian import READINGS
from sim_vehicle.vehicle.controls import Control
from sim_vehicle.vehicle.packed_model import PackedModel, flatten
from sim_vehicle.vehicle.propulsion import Polynomial, Propulsion
from sysid.problem.free_parameters import coefficient, effect_parameter, sensor_error
from sysid.problem.predictor import Predictor
from sysid.problem.sensitivities import Driven, Inputs, Lane, has_tangents, tangents
from sysid.signals.record import OUTPUTS, Record

Array = NDArray[np.float64]

DT, N, START = 0.02, 60, 5
# Whole samples late: parts of one have no tangents.
VALUES = {**EVERY_VALUE, "sensor_time_skew": {"delay": 2.0 * DT, "group": 2.0}}
HEIGHTS = 12.0 - 3.0 * np.cos(0.1 * np.arange(N))
COLUMNS = [CHANNELS.index(name) for name in READINGS]
STATES = np.array([hf.V * 0.98, 0.9, 1.6, hf.P, hf.Q, hf.R, hf.PHI, hf.THETA, hf.PSI])
# Terms in alphadot act through an implicit equation; products, powers and lift have slopes by several regressors.
RICH = {
    "CL_alphadot": 1.5, "CL_q": 3.0, "CD_CL": 0.03, "CD_alphadot": 0.02, "CD_beta2": 1.0, "CY_p": 0.1,
    "Cl_alpha_beta": 0.1, "Cm_alphadot": -2.0, "Cm_CL": 0.02, "Cm_alpha2_de": 0.7, "Cm_q": -4.0, "Cn_throttle": 0.001,
}  # fmt: skip
NOT_FLOWN = {"steady_wind", "turbulence", "unsteady_lift", "ground_effect"}
EFFECT_NAMES = sorted(name for name, effect in EFFECTS.items() if not effect.is_coefficient and name not in NOT_FLOWN)


def inputs(**changes: Any) -> Inputs:
    generator = np.random.default_rng(11)
    controls = np.repeat(hf.SURFACES + generator.normal(0.0, 0.03, (N // 6, 4)), 6, axis=0)
    commands = np.column_stack((controls, HEIGHTS))
    rho = hf.RHO + 0.01 * np.sin(np.arange(N))
    whole = Inputs(START, N, commands, np.full(N, np.nan), rho, DT, 2, False, np.zeros((0, 9)))
    return replace(whole, **changes)


def flat(effects: Mapping[str, Mapping[str, float]], coefficients: Mapping[str, float] | None = None) -> PackedModel:
    model: Model = hf.model_with(effects)
    for name, value in (coefficients or {}).items():
        model = model.with_coefficient(name, value)
    return flatten(hf.vehicle(tau=0.1), model)


def flown(model: PackedModel, given: Inputs, states: Array, coefficients: Array, more_thrust: float) -> Array:
    x0 = np.zeros(14)
    x0[3:6], x0[10:13], x0[13] = states[:3], states[3:6], np.nan
    x0[6:10] = quaternion(*states[6:9])
    y = np.empty((given.stop - given.start, len(CHANNELS)))
    inputs = DrivingInputs(
        given.commands, given.thrust + more_thrust, given.rho, given.held, np.zeros((0, 3)), given.interval_s,
        given.sub_steps, given.command_first, given.seen,
    )  # fmt: skip
    simulate(x0, 0, given.start, given.stop, inputs, model.arrays._replace(C=coefficients), y)
    return y[:, COLUMNS]


def slope(function: Callable[[float], Array], step: float) -> Array:
    """Fourth-order central difference at 0."""
    near, far = (function(h) - function(-h) for h in (step, 2.0 * step))
    return (8.0 * near - far) / (12.0 * step)


def driven_by(given: Inputs, h: float) -> Inputs:
    """The inputs with surfaces, thrust and imposed motion changed by h times something."""
    generator = np.random.default_rng(5)
    surfaces = np.repeat(generator.normal(0.0, 1.0, (N // 6, 3)), 6, axis=0)
    commands = given.commands.copy()
    commands[:, :3] += h * surfaces
    thrust = given.thrust + h * np.cos(0.2 * np.arange(N))
    held = given.held + h * generator.normal(0.0, 1.0, given.held.shape)
    if commands.shape[1] > MORE_COLUMN:
        commands[:, MORE_COLUMN:] += h * np.sin(0.3 * np.arange(N))[:, None]
    seen = given.seen.copy()
    seen[:, [*range(3), *range(4, seen.shape[1])]] += h  # the throttle's thrust is not differentiated by
    return replace(given, commands=commands, thrust=thrust, held=held, seen=seen)


def assert_tangents(model: PackedModel, given: Inputs, relative: float = 1e-6) -> None:
    """By every coefficient, every free initial state, the thrust, and what drives all of it."""
    free = [i for i in range(9) if not (given.held.size and np.isfinite(given.held[given.start, i]))]
    count = model.C.size
    lanes = [Lane(i, term=i) for i in range(count)] + [Lane(count, thrust=2.0)]
    lanes += [Lane(count + 1 + i) for i in range(len(free) + 1)]
    step = 1e-8
    other = driven_by(given, step)
    driven = [Driven(other.commands, other.thrust, other.held, step, other.seen)]
    x0 = np.zeros(14)
    x0[3:6], x0[10:13], x0[13] = STATES[:3], STATES[3:6], np.nan
    x0[6:10] = quaternion(*STATES[6:9])
    found = np.zeros((given.stop - given.start, len(READINGS), len(lanes)))
    tangents(model, given, x0, free, lanes, READINGS, np.ones(len(READINGS)), driven, found)
    for place in range(len(lanes)):

        def moved(h: float, place: int = place) -> Array:
            states, coefficients = STATES.copy(), model.C.copy()
            if place < count:
                coefficients[place] += h
            elif count < place < len(lanes) - 1:
                states[free[place - count - 1]] += h
            by = driven_by(given, h) if place == len(lanes) - 1 else given
            return flown(model, by, states, coefficients, 2.0 * h if place == count else 0.0)

        # Servos that limit and stick have kinks, which a smaller step avoids.
        expected = slope(moved, 1e-6 if place == len(lanes) - 1 else 1e-4)
        size = np.abs(expected).max(axis=0)
        miss = np.abs(found[:, :, place] - expected).max(axis=0)
        assert np.all(miss <= relative * np.maximum(size, 1e-3 * size.max() + 1e-4)), (place, miss / (size + 1e-12))


@pytest.mark.parametrize("command_first", [False, True])
def test_a_model_of_many_terms(command_first: bool) -> None:
    assert_tangents(flat({}, RICH), inputs(command_first=command_first))


@pytest.mark.parametrize("apart", [False, True])
def test_with_controls_of_their_own_names(apart: bool) -> None:
    """apart: what sensors see of the surfaces is given by itself."""
    servoless = Control("", "command", (), (), (), ())
    vehicle = hf.vehicle(tau=0.1)
    vehicle = replace(vehicle, controls={**vehicle.controls, "flap": servoless, "left_motor": servoless})
    own = {"CL_flap": 0.8, "CD_flap": 0.05, "Cm_alpha_flap": -0.3, "Cn_left_motor": 0.01, "CY_beta_left_motor": 0.1}
    model: Model = hf.model_with({})
    for name, value in {**RICH, **own}.items():
        model = model.with_coefficient(name, value)
    given = inputs()
    waves = 0.2 * np.sin(np.outer(np.arange(N), (0.2, 0.5)))
    wide = np.column_stack((given.commands[:, :4], np.full((N, 5), np.nan), waves))
    seen = np.column_stack((given.commands[:, :4], waves)) + 0.01 if apart else given.seen
    assert_tangents(flatten(vehicle, model), replace(given, commands=wide, seen=seen))


@pytest.mark.parametrize("name", EFFECT_NAMES)
def test_with_an_effect(name: str) -> None:
    """Thrust measured where the effect is not one of the throttle's; beside lift that depends on alphadot."""
    thrust = np.full(N, np.nan) if name in ("thrust_speed_loss", "motor_lag") else np.linspace(3.0, 4.0, N)
    model = flat({name: VALUES[name]}, {"CL_alphadot": 1.5, "CD_CL": 0.03})
    assert has_tangents(model, DT)
    assert_tangents(model, inputs(thrust=thrust))


def test_with_measured_thrust_that_follows_the_airspeed() -> None:
    model = flat({"thrust_scale": {"scale": 0.05}}, RICH)
    model.E[[THRUST_AIRSPEED, THRUST_SLOPE, THRUST_BEND]] = 16.0, -0.27, 0.01
    assert_tangents(model, inputs(thrust=np.linspace(3.0, 4.0, N)))


def test_with_all_effects_and_sensors_off_the_centre_of_gravity() -> None:
    model = flat({name: VALUES[name] for name in EFFECT_NAMES}, RICH)
    places = (Par.accelerometer_x, Par.alpha_vane_x, Par.beta_vane_x, Par.propeller_x)
    for place, arm in zip(
        places, ((0.1, -0.05, 0.03), (0.2, 0.4, 0.1), (0.2, -0.4, 0.1), (0.2, 0.03, 0.02)), strict=True
    ):
        model.P[int(place) : int(place) + 3] = arm
    model.P[Par.inclination] = 0.05
    model.P[Par.airspeed_is_calibrated] = 1.0
    for flank in (0.0, 1.0):
        model.P[Par.beta_is_flank] = flank
        assert_tangents(model, inputs(sub_steps=1), 2e-6)


@pytest.mark.parametrize("measured", [False, True])
def test_with_thrust_and_torque_over_advance_ratio(measured: bool) -> None:
    """Beside the effects that need the propeller's speed or thrust, with its axis inclined and off the centre."""
    motor = Propulsion(
        line=(0.2, 0.03, 0.02), inclination=0.05, diameter=0.25, rotation="ccw", tau=0.1, max_rpm=12000.0,
        CT=Polynomial((0.1, -0.02, -0.12), (0.0, 0.8)), CQ=((0.0, 0.006), (0.3, 0.0063), (0.6, 0.003), (0.9, -0.002)),
    )  # fmt: skip
    names = ("thrust_scale", "propeller_gyroscopic", "propwash_elevator", "thrust_speed_loss")
    effects = {name: VALUES[name] for name in names}
    model = flatten(
        replace(hf.vehicle(), propulsion=motor), hf.model_with(effects).with_coefficient("CL_alphadot", 1.5)
    )
    assert_tangents(model, inputs(thrust=np.linspace(3.0, 4.0, N)) if measured else inputs())


@pytest.mark.parametrize("kept", [(0, 2, 4, 7), (1, 3, 5, 6, 8), (7,), (6, 8)])
def test_with_states_imposed(kept: tuple[int, ...]) -> None:
    generator = np.random.default_rng(2)
    held = np.tile(STATES, (N, 1)) + 0.02 * np.sin(0.1 * np.arange(N))[:, None] + 0.001 * generator.random((N, 9))
    held[:, list(kept)] = np.nan
    assert_tangents(flat({}, RICH), inputs(held=held))


def test_a_lift_that_lags_is_left_to_differences() -> None:
    assert not has_tangents(flat({"unsteady_lift": VALUES["unsteady_lift"]}), DT)
    assert not has_tangents(flat({"sensor_time_skew": {"delay": 1.65 * DT, "group": 2.0}}), DT)


@pytest.mark.parametrize("effect", ["", "stall", "unsteady_lift", "wind_shear"])
def test_the_estimators_derivatives_are_those_of_its_outputs(effect: str) -> None:
    """Coefficients, sensor errors, effect parameters and initial states in one; by differences where they must be."""
    model = flat({effect: VALUES[effect]} if effect else {})
    given = inputs(thrust=np.linspace(3.0, 4.0, N))
    record = Record(
        "x", DT, DT * np.arange(N - START), START, np.ascontiguousarray(given.commands[:, :4]), given.thrust, given.rho,
        np.zeros((N - START, len(OUTPUTS))), np.zeros((0, 9)), 0.08, relative_height=HEIGHTS,
    )  # fmt: skip
    chosen = [coefficient("Cm_alpha"), sensor_error("accel_bias_x"), sensor_error("alpha_scale"), coefficient("CD_k")]
    chosen += [effect_parameter(effect, key) for key in VALUES.get(effect, {})]
    predictor = Predictor(model, chosen, [record], tangent_steps=2)
    values = {"Cm_alpha": -0.6, "accel_bias_x": 0.2, "alpha_scale": 0.1, "CD_k": 0.1}
    values |= {f"{effect}.{key}": value for key, value in VALUES.get(effect, {}).items()}
    theta = np.concatenate(([values[parameter.name] for parameter in chosen], STATES))

    def outputs(at: Array) -> Array:
        return predictor.outputs(0, *predictor.apply(at), predictor.initial_states(0, at, STATES))

    found = np.moveaxis(predictor.derivatives(0, theta, STATES, outputs(theta)), 2, 0)
    # Written over what other values left.
    stale = np.full((N - START, len(OUTPUTS), theta.size), np.nan)
    coarse = Predictor(model, chosen, [record]).derivatives(0, theta, STATES, outputs(theta), stale)
    coarse = np.moveaxis(coarse, 2, 0)
    size = np.abs(found).max(axis=1, keepdims=True)
    assert np.all(np.abs(coarse - found) <= 3e-3 * np.maximum(size, 1e-3 * size.max(axis=2, keepdims=True)))
    assert found.shape == (theta.size, N - START, len(OUTPUTS))
    differences = effect == "unsteady_lift"
    for i in range(theta.size):
        step = 1e-3 * max(1.0, abs(theta[i]))
        expected = slope(lambda h, i=i: outputs(theta + h * np.eye(theta.size)[i]), step)
        size = np.abs(expected).max(axis=0)
        loose = differences or (i < len(chosen) and chosen[i].kind == "effect")
        tolerance = (2e-3 if loose else 1e-6) * np.maximum(size, 1e-3 * size.max())
        assert np.all(np.abs(found[i] - expected).max(axis=0) <= tolerance), i
