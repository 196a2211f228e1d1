"""The free-running simulation of estimators: the same flight as the plant's, tick by tick."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import hand_flight as hf
import numpy as np
import pytest
from effect_values import VALUES
from numpy.typing import NDArray

from sim_vehicle.effects import EFFECTS
from sim_vehicle.flight.plant import OUTPUTS, Plant
from sim_vehicle.model.model_file import Model
from sim_vehicle.physics.kernel_records import DrivingInputs
from sim_vehicle.physics.layout import CHANNELS, REGRESSORS, STATE_SIZE, WORK_SIZE, Aux, Par
from sim_vehicle.physics.simulation import evaluate_path, impose, simulate
from sim_vehicle.vehicle.packed_model import PackedModel, flatten

Array = NDArray[np.float64]

DT, N, SUB_STEPS = 0.02, 120, 4
# Samples until sensors that come late show nothing of the time before the flight, which each takes as it likes.
KNOWN = 3
FREE = np.zeros((0, 9))
STILL_AIR = np.zeros((0, 3))
COLUMN = {name: j for j, name in enumerate(CHANNELS)}


@dataclass(frozen=True)
class Flight:
    """A flight of the plant: commands (N, 4), states (N, 14), readings (N, 19), outputs name -> (N,) at each tick."""

    plant: Plant
    commands: Array
    states: Array
    readings: Array
    outputs: dict[str, Array]


def flown(effects: dict[str, dict[str, float]], gust: Array = hf.STILL, tau: float = 0.1) -> Flight:
    plant = Plant(hf.vehicle(tau=tau), hf.model_with(effects), max_step=DT / SUB_STEPS)
    generator = np.random.default_rng(11)
    commands = np.repeat(hf.SURFACES + generator.normal(0.0, 0.05, (N // 6, 4)), 6, axis=0)
    commands[:1] = hf.SURFACES
    state = plant.state_at(hf.body_state(), hf.SURFACES, hf.SURFACES)
    state.surfaces[:3] += effects.get("linkage_nonlinearity", {}).get("cubic", 0.0) * state.surfaces[:3] ** 3
    state.surfaces[0] *= 1.0 + effects.get("elevator_gain", {}).get("scale", 0.0)
    plant.evaluate(state, hf.STILL, gust, 0.0)
    states, readings, outputs = np.empty((N, STATE_SIZE)), np.empty((N, len(CHANNELS))), np.empty((N, len(OUTPUTS)))
    for k in range(N):
        states[k], readings[k], outputs[k] = state.x, state.reading, plant.outputs(state)
        plant.step(state, commands[k], DT, hf.STILL, gust)
    named = {name: outputs[:, j] for j, name in enumerate(OUTPUTS)}
    return Flight(plant, commands, states, readings, named)


def simulated(
    flight: Flight,
    *,
    x0: Array | None = None,
    first: int = 0,
    start: int = 0,
    flat: PackedModel | None = None,
    thrust: Array | None = None,
    command_first: bool = False,
    held: Array = FREE,
    gusts: Array = STILL_AIR,
    sub_steps: int = SUB_STEPS,
) -> Array:
    """Readings (N - start, 19) of the same inputs in the estimators' simulation."""
    flat = flat or flight.plant.flat
    y = np.empty((N - start, len(CHANNELS)))
    measured = np.full(N, np.nan) if thrust is None else thrust
    rho = np.full(N, hf.RHO)
    inputs = DrivingInputs(flight.commands, measured, rho, held, gusts, DT, sub_steps, command_first)
    simulate(flight.states[start].copy() if x0 is None else x0, first, start, N, inputs, flat.arrays, y)
    return y


@pytest.mark.parametrize("name", ["", *sorted(EFFECTS)])
def test_a_simulation_reads_what_the_plant_reads(name: str) -> None:
    flight = flown({name: VALUES[name]} if name else {})
    told = slice(KNOWN if name == "sensor_time_skew" else 0, None)
    np.testing.assert_allclose(simulated(flight)[told], flight.readings[told], rtol=1e-11, atol=1e-12)


def test_all_effects_at_once_read_what_the_plant_reads() -> None:
    flight = flown(VALUES)
    np.testing.assert_allclose(simulated(flight)[KNOWN:], flight.readings[KNOWN:], rtol=1e-10, atol=1e-11)


def test_a_steady_gust_reads_what_the_plant_reads() -> None:
    gust = np.array([1.0, -0.7, 0.5])
    flight = flown({"downwash_lag": VALUES["downwash_lag"]}, gust)
    gusts = np.tile(gust, (N, 1))
    np.testing.assert_allclose(simulated(flight, gusts=gusts), flight.readings, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("sub_steps", [1, 2])
def test_the_coarse_steps_of_an_estimator_are_good_enough(sub_steps: int) -> None:
    """Against a fifth of a sensor's noise, with everything switched on that is not exact."""
    flight = flown({})
    noise = np.full(len(CHANNELS), np.inf)
    for name, sigma in (("airspeed", 0.02), ("alpha", 5e-3), ("q", 5e-4), ("theta", 9e-4), ("ax", 0.08), ("az", 0.08)):
        noise[COLUMN[name]] = sigma
    worst = np.abs(simulated(flight, sub_steps=sub_steps) - flight.readings).max(axis=0) / noise
    assert worst.max() < 0.2


@pytest.mark.parametrize(("effect", "share"), [("", 0.1), ("actuator_lag", 0.3)])
def test_surfaces_that_go_in_lines_read_what_a_plant_reads_that_gets_them_finely(effect: str, share: float) -> None:
    """A plant that is sent 64 commands a tick along the lines; by means alone the rates are off by a dt^2 / 12."""
    fine = 64
    plant = Plant(hf.vehicle(tau=0.0), hf.model_with({effect: VALUES[effect]} if effect else {}), max_step=DT / fine)
    knots = hf.SURFACES + np.random.default_rng(12).normal(0.0, 0.05, (N, 4)) * [1.0, 1.0, 1.0, 0.0]
    knots[:2] = hf.SURFACES
    state = plant.state_at(hf.body_state(), hf.SURFACES, hf.SURFACES)
    plant.evaluate(state, hf.STILL, hf.STILL, 0.0)
    x0, readings = state.x.copy(), np.empty((N, len(CHANNELS)))
    for k in range(N):
        readings[k] = state.reading
        for i in range(fine if k < N - 1 else 0):
            plant.step(state, knots[k] + (i + 0.5) / fine * (knots[k + 1] - knots[k]), DT / fine)
    rises = np.diff(knots[:, :3], axis=0, append=knots[-1:, :3])
    means = knots + 0.5 * np.column_stack((rises, np.zeros(N)))
    others = np.tile([np.nan, 0.0], (N, 1))

    def off(commands: Array) -> Array:
        y = np.empty((N, len(CHANNELS)))
        drive = DrivingInputs(commands, np.full(N, np.nan), np.full(N, hf.RHO), FREE, STILL_AIR, DT, 2, 0.5)
        simulate(x0.copy(), 0, 0, N, drive, plant.flat.arrays, y)
        return np.abs(y - readings)[: N - 1].max(axis=0)

    line, mean = off(np.column_stack((means, others, rises))), off(means)
    names = [COLUMN[name] for name in ("p", "q", "r", "az")]
    assert (line[names] < share * mean[names]).all(), (line[names], mean[names])


def test_measured_thrust_takes_the_place_of_the_throttle() -> None:
    """Held over a tick it acts as the mean of both ends; a constant is exact whatever the throttle does."""
    flight = flown({}, tau=0.0)
    thrust = np.full(N, 3.3)
    y = simulated(flight, thrust=thrust)
    plant = Plant(flight.plant.vehicle, flight.plant.model, max_step=DT / SUB_STEPS)
    state = plant.state_at(hf.body_state(), hf.SURFACES, hf.SURFACES)
    commands = flight.commands.copy()
    commands[:, 3] = 3.3 / hf.MAX_THRUST
    state.surfaces[3] = commands[0, 3]
    plant.evaluate(state, hf.STILL, hf.STILL, 0.0)
    for k in range(N):
        np.testing.assert_allclose(y[k], state.reading, rtol=1e-11, atol=1e-12)
        plant.step(state, commands[k], DT)


def test_measured_thrust_already_holds_its_loss_with_speed() -> None:
    plain, lossy = flown({}), flown({"thrust_speed_loss": {"dT_dV": -0.5}})
    thrust = np.full(N, 3.3)
    x0 = plain.states[0].copy()
    np.testing.assert_array_equal(simulated(lossy, thrust=thrust, x0=x0), simulated(plain, thrust=thrust, x0=x0.copy()))


def test_command_first_shows_the_command_in_the_accelerations_of_its_own_sample() -> None:
    """The motion is the same; only what acts at once differs: forces and moments of the surfaces, not the thrust."""
    flight = flown({})
    before, now = simulated(flight), simulated(flight, command_first=True)
    same = [COLUMN[n] for n in ("airspeed", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "altitude", "vd")]
    np.testing.assert_array_equal(now[:, same], before[:, same])
    shown = np.vstack((flight.commands[:1], flight.commands[:-1]))
    alpha, V = flight.outputs["alpha"], flight.outputs["V"]
    force = 0.5 * hf.RHO * V**2 * hf.S / hf.MASS
    lift = 0.1784 + 2.453 * alpha
    CL = [lift + 0.7405 * commands[:, 0] for commands in (shown, flight.commands)]
    CD = [0.0871 + 0.4 * one**2 for one in CL]
    down = [-(d * np.sin(alpha) + c * np.cos(alpha)) * force for c, d in zip(CL, CD, strict=True)]
    side = [force * 0.15 * commands[:, 2] for commands in (shown, flight.commands)]
    np.testing.assert_allclose((now - before)[:, COLUMN["az"]], down[1] - down[0], atol=1e-10)
    np.testing.assert_allclose((now - before)[:, COLUMN["ay"]], side[1] - side[0], atol=1e-10)


@pytest.mark.parametrize("name", ["actuator_lag", "actuator_rate_limit", "actuator_delay", "actuator_backlash"])
def test_command_first_changes_nothing_behind_an_actuator_that_takes_its_time(name: str) -> None:
    flight = flown({name: VALUES[name]})
    np.testing.assert_array_equal(simulated(flight, command_first=True), simulated(flight))


@pytest.mark.parametrize(("name", "key"), [("actuator_delay", "delay"), ("actuator_backlash", "width")])
def test_an_actuator_effect_of_nothing_leaves_command_first_as_it_is(name: str, key: str) -> None:
    plain, neutral = flown({}), flown({name: {key: 0.0}})
    np.testing.assert_allclose(simulated(neutral, command_first=True), simulated(plain, command_first=True), atol=1e-12)


@pytest.mark.parametrize("name", ["actuator_lag", "actuator_delay", "actuator_backlash", "motor_lag"])
def test_commands_before_the_start_are_still_under_way(name: str) -> None:
    """A run from the middle of a flight on goes as the whole flight does, if the actuators ran up to there."""
    flight = flown({name: VALUES[name]})
    start = 47
    going_on = simulated(flight, first=0, start=start)
    np.testing.assert_allclose(going_on, flight.readings[start:], rtol=1e-11, atol=1e-12)
    at_rest = simulated(flight, first=start, start=start)
    assert np.abs(at_rest - flight.readings[start:]).max() > 1e-3


def held_states(flight: Flight, names: tuple[str, ...]) -> Array:
    order = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi")
    columns = {
        **{name: flight.outputs[name] for name in order[3:]},
        "u": flight.states[:, 3], "v": flight.states[:, 4], "w": flight.states[:, 5],
    }  # fmt: skip
    return np.stack([columns[n] if n in names else np.full(N, np.nan) for n in order], axis=1)


NOISE = {
    "airspeed": 0.02, "alpha": 5e-3, "q": 5e-4, "theta": 9e-4, "ax": 0.08, "az": 0.08,
    "beta": 5e-3, "p": 5e-4, "r": 5e-4, "phi": 9e-4, "psi": 9e-4, "ay": 0.08,
}  # fmt: skip


def noises_off(y: Array, flight: Flight, names: tuple[str, ...]) -> float:
    """Largest difference from the flight, in units of the sensors' noise."""
    apart = np.abs(y - flight.readings).max(axis=0)
    return max(float(apart[COLUMN[name]]) / NOISE[name] for name in names)


def test_states_held_at_their_true_values_leave_the_flight_as_it_is() -> None:
    """Exact at the samples, in a straight line between them: close to the noise even in rolls at 3 rad/s."""
    flight = flown({})
    held = held_states(flight, ("v", "p", "r", "phi", "psi"))
    y = simulated(flight, held=held)
    assert noises_off(y, flight, ("airspeed", "alpha", "q", "theta", "ax", "az")) < 2.0
    for name in ("p", "r", "phi", "psi"):
        np.testing.assert_allclose(y[:, COLUMN[name]], flight.readings[:, COLUMN[name]], atol=1e-12)


def test_held_states_need_no_forces_of_their_own() -> None:
    """A lateral model alone, lift, drag and pitching moment unknown, flies the lateral motion of the whole aircraft."""
    flight = flown({}, tau=0.0)
    lateral = {n: e for n, e in hf.model_with({}).coefficients.items() if n.partition("_")[0] in ("CY", "Cl", "Cn")}
    flat = flatten(flight.plant.vehicle, Model("lateral", lateral))
    y = simulated(flight, flat=flat, held=held_states(flight, ("u", "w", "q", "theta")))
    assert noises_off(y, flight, ("beta", "p", "r", "phi", "psi", "ay")) < 2.0


def test_states_held_elsewhere_are_read_as_they_are_held() -> None:
    flight = flown({})
    held = np.full((N, 9), np.nan)
    held[:, 4], held[:, 6], held[:, 8] = 0.11, 0.3, -0.7
    y = simulated(flight, held=held)
    for name, value in (("q", 0.11), ("phi", 0.3), ("psi", -0.7)):
        np.testing.assert_allclose(y[:, COLUMN[name]], value, atol=1e-12)
    assert np.ptp(y[:, COLUMN["theta"]]) > 0.01


def test_imposing_one_angle_keeps_the_other_two() -> None:
    x = hf.body_state()
    held = np.full(9, np.nan)
    held[7] = -0.4
    impose(x, held)
    np.testing.assert_allclose(x[6:10], hf.quaternion(hf.PHI, -0.4, hf.PSI), atol=1e-14)
    before = hf.body_state()
    np.testing.assert_array_equal(x[:6], before[:6])
    np.testing.assert_array_equal(x[10:], before[10:])


def test_a_motion_that_diverges_leaves_numbers_before_and_nan_after() -> None:
    flight = flown({})
    thrust = np.full(N, 2.0)
    thrust[60:] = 1e9
    y = simulated(flight, thrust=thrust)
    assert np.isfinite(y[:60]).all()
    assert np.isnan(y[62:]).all()


def test_a_start_that_is_not_finite_gives_nan_and_no_error() -> None:
    flight = flown({})
    x0 = flight.states[0].copy()
    x0[11] = math.inf
    assert np.isnan(simulated(flight, x0=x0)[1:]).all()


def test_the_start_state_is_left_as_it_was() -> None:
    flight = flown({})
    x0 = flight.states[0].copy()
    simulated(flight, x0=x0)
    np.testing.assert_array_equal(x0, flight.states[0])


@pytest.mark.parametrize(
    "name", ["", "downwash_lag", "stall", "propwash_elevator", "reynolds_drag", "actuator_lag", "elevator_gain"]
)
def test_coefficients_along_a_known_motion_are_those_of_the_flight(name: str) -> None:
    flight = flown({name: VALUES[name]} if name else {})
    path = np.ascontiguousarray(held_states(flight, ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi")))
    found = np.empty((N, 12))
    flat = flight.plant.flat
    evaluate_path(path, flight.commands, 0, np.full(N, np.nan), np.full(N, hf.RHO), DT, False, flat.arrays, found)
    for j, axis in enumerate(("CL", "CD", "CY", "Cl", "Cm", "Cn")):
        np.testing.assert_allclose(found[:, j], flight.outputs[axis], atol=1e-9, err_msg=axis)
    for j, axis in enumerate(("ax", "ay", "az", "p_dot", "q_dot", "r_dot")):
        np.testing.assert_allclose(found[:, 6 + j], flight.outputs[axis], atol=1e-7, err_msg=axis)


def test_coefficients_from_the_middle_of_a_flight_on() -> None:
    flight = flown({"actuator_lag": {"tau": 0.05}})
    path = held_states(flight, ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi"))
    found, flat, first = np.empty((N - 40, 12)), flight.plant.flat, 40
    evaluate_path(
        np.ascontiguousarray(path[first:]), flight.commands, first, np.full(N, np.nan), np.full(N, hf.RHO), DT, False,
        flat.arrays, found,
    )  # fmt: skip
    np.testing.assert_allclose(found[:, 4], flight.outputs["Cm"][first:], atol=1e-9)


def test_the_flat_layout_has_no_two_names_for_a_place() -> None:
    assert sorted(Par) == list(range(len(Par)))
    assert [*range(len(REGRESSORS)), *sorted(Aux)] == list(range(WORK_SIZE))


def test_a_plant_copy_flies_on_its_own() -> None:
    flight = flown(VALUES)
    plant = flight.plant
    state = plant.state_at(hf.body_state(), hf.SURFACES, hf.SURFACES)
    other = state.copy()
    plant.step(state, flight.commands[10], DT)
    assert not np.array_equal(state.x, other.x)
    plant.step(other, flight.commands[10], DT)
    for name, value in vars(state).items():
        np.testing.assert_array_equal(value, getattr(other, name), err_msg=name)


def test_two_vehicles_do_not_share_anything() -> None:
    a = hf.plant_with({})
    heavy = replace(hf.vehicle(), mass=replace(hf.vehicle().mass, mass=2.0))
    b = Plant(heavy, hf.model_with({}))
    assert hf.outputs(a, hf.state_of(a))["az"] == pytest.approx(2.0 * hf.outputs(b, hf.state_of(b))["az"], rel=1e-12)
