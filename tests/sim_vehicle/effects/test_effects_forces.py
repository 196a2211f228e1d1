"""Effects on forces and moments: each against its equation, worked out by hand in one general state of flight."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import hand_flight as hf
import numpy as np
import pytest
from hand_flight import ALPHA, BETA, DA, DE, DR, MAX_THRUST, THROTTLE, B, C, Hand, P, Q, R, S, V

from sim_vehicle.flight.plant import Plant
from sim_vehicle.model.model_file import Model

Values = Mapping[str, float]
Change = Callable[[Hand, Values], None]

AXES = ("ax", "ay", "az", "p_dot", "q_dot", "r_dot")
THRUST = MAX_THRUST * THROTTLE
PHAT, QHAT, RHAT = P * B / (2 * V), Q * C / (2 * V), R * B / (2 * V)
LIFT, PITCH, ROLL, YAW, SIDE = {"ax", "az"}, {"q_dot"}, {"p_dot", "r_dot"}, {"p_dot", "r_dot"}, {"ay"}
# Full throttle turns the propeller at 9000 rpm; thrust goes with the square of that.
ROTOR = 9000.0 * 2.0 * math.pi / 60.0 * math.sqrt(THROTTLE)


def moment(axis: int, regressor: float, name: str) -> Change:
    """A moment coefficient times its regressor; axis 0 roll, 1 pitch, 2 yaw."""

    def change(hand: Hand, values: Values) -> None:
        hand.moments[axis] += hand.qbar * S * (C if axis == 1 else B) * values[name] * regressor

    return change


def lift(regressor: float, name: str) -> Change:
    def change(hand: Hand, values: Values) -> None:
        hand.extra_CL += values[name] * regressor

    return change


def drag(regressor: float, name: str) -> Change:
    def change(hand: Hand, values: Values) -> None:
        hand.extra_CD += values[name] * regressor

    return change


def both(*changes: Change) -> Change:
    def change(hand: Hand, values: Values) -> None:
        for one in changes:
            one(hand, values)

    return change


def polar(hand: Hand, values: Values) -> None:
    hand.extra_CD += values["CD_CL"] * hand.lift()


def side_force(hand: Hand, values: Values) -> None:
    hand.coefficients["CY_beta"] = values["CY_beta"]


def replaced(*names: str) -> Change:
    """The effect gives a coefficient that the packaged model has already."""

    def change(hand: Hand, values: Values) -> None:
        hand.coefficients.update({name: values[name] for name in names})

    return change


def stall(hand: Hand, values: Values) -> None:
    # Beard & McLain's (4.10), as the product of two logistic functions: attached between -alpha_s and alpha_s.
    a, m = values["alpha_stall"], values["sharpness"]
    attached = 1.0 / (1.0 + math.exp(m * (ALPHA - a))) / (1.0 + math.exp(-m * (ALPHA + a)))
    hand.attached = attached
    hand.extra_CL += (1.0 - attached) * 2.0 * math.sin(ALPHA) ** 2 * math.cos(ALPHA)
    hand.extra_CD += (1.0 - attached) * 2.0 * math.sin(ALPHA) ** 3


def propwash(hand: Hand, values: Values) -> None:
    hand.elevator_moment = 1.0 + values["k"] * THRUST / (hand.qbar * S)


def elastic(hand: Hand, values: Values) -> None:
    hand.elevator_moment = 1.0 - values["k"] * (hand.qbar / (0.5 * 1.225 * 15.0**2) - 1.0)


def reynolds(hand: Hand, values: Values) -> None:
    hand.coefficients["CD_0"] *= (V / 15.0) ** -values["n"]


def thrust_line(hand: Hand, values: Values) -> None:
    hand.moments[1] += values["z_T"] * THRUST


def speed_loss(hand: Hand, values: Values) -> None:
    hand.thrust += THROTTLE * values["dT_dV"] * (V - 15.0)


def thrust_scale(hand: Hand, values: Values) -> None:
    hand.thrust *= 1.0 + values["scale"]


def torque(hand: Hand, values: Values) -> None:
    hand.moments[0] -= values["k_Q"] * THRUST


def p_factor(hand: Hand, values: Values) -> None:
    # Clockwise from behind: the blade that goes down is on the right and pulls harder at a positive alpha.
    pull = values["k_P"] * THRUST * hf.DIAMETER
    hand.moments += np.array([0.0, -pull * BETA, -pull * ALPHA])


def gyroscope(hand: Hand, values: Values) -> None:
    momentum = np.array([values["I_P"] * ROTOR, 0.0, 0.0])
    hand.moments -= np.cross(np.array([P, Q, R]), momentum)


def normal_force(hand: Hand, values: Values) -> None:
    hand.extra_z -= values["k"] * THRUST * ALPHA


def density(hand: Hand, values: Values) -> None:
    hand.rho *= 1.0 + values["scale"]


def mass(hand: Hand, values: Values) -> None:
    hand.mass *= 1.0 + values["scale"]


def inertia(hand: Hand, values: Values) -> None:
    hand.inertia *= 1.0 + values["scale"]


CASES: dict[str, tuple[dict[str, float], Change, set[str]]] = {
    "pitch_damping": ({"Cm_q": -5.0}, moment(1, QHAT, "Cm_q"), PITCH),
    "pitch_curvature": (
        {"Cm_alpha2": -0.5, "Cm_alpha3": 3.0},
        both(moment(1, ALPHA**2, "Cm_alpha2"), moment(1, ALPHA**3, "Cm_alpha3")),
        PITCH,
    ),
    "lift_pitch_rate": ({"CL_q": 4.0}, lift(QHAT, "CL_q"), LIFT),
    "polar_offset": ({"CD_CL": 0.03}, polar, LIFT),
    "control_drag": ({"CD_de2": 1.0}, drag(DE**2, "CD_de2"), LIFT),
    "lift_alpha_elevator": ({"CL_alpha_de": 1.0}, lift(ALPHA * DE, "CL_alpha_de"), LIFT),
    "dihedral": ({"Cl_beta": -0.11}, replaced("Cl_beta"), ROLL),
    "weathercock": ({"Cn_beta": 0.2}, replaced("Cn_beta"), YAW),
    "roll_damping": ({"Cl_p": -0.3}, replaced("Cl_p"), ROLL),
    "yaw_damping": ({"Cn_r": -0.3}, replaced("Cn_r"), YAW),
    "cross_roll_yaw": ({"Cl_r": 0.3, "Cn_p": -0.1}, replaced("Cl_r", "Cn_p"), ROLL),
    "adverse_yaw": ({"Cn_da": 0.05}, replaced("Cn_da"), YAW),
    "rudder_roll": ({"Cl_dr": 0.02}, moment(0, DR, "Cl_dr"), ROLL),
    "asymmetry": ({"Cl_0": 0.004, "Cn_0": -0.003}, both(moment(0, 1.0, "Cl_0"), moment(2, 1.0, "Cn_0")), ROLL),
    "side_force": ({"CY_beta": -0.9}, side_force, SIDE),
    "sideslip_drag": ({"CD_beta2": 1.5}, drag(BETA**2, "CD_beta2"), LIFT),
    "stall": ({"alpha_stall": 0.13, "sharpness": 40.0}, stall, LIFT),
    "propwash_elevator": ({"k": 0.3}, propwash, PITCH),
    "elastic_tail": ({"k": 0.15}, elastic, PITCH),
    "reynolds_drag": ({"n": 0.4}, reynolds, LIFT),
    "thrust_line_offset": ({"z_T": 0.02}, thrust_line, PITCH),
    "thrust_speed_loss": ({"dT_dV": -0.3}, speed_loss, {"ax"}),
    "thrust_scale": ({"scale": 0.05}, thrust_scale, {"ax"}),
    "propeller_torque": ({"k_Q": 0.02}, torque, ROLL),
    "p_factor": ({"k_P": 0.2}, p_factor, {"p_dot", "q_dot", "r_dot"}),
    "propeller_gyroscopic": ({"I_P": 1e-4}, gyroscope, {"p_dot", "q_dot", "r_dot"}),
    "propeller_normal_force": ({"k": 0.5}, normal_force, {"az"}),
    "density_error": ({"scale": 0.08}, density, set(AXES)),
    "mass_error": ({"scale": 0.05}, mass, {"ax", "ay", "az"}),
    "inertia_error": ({"scale": 0.1}, inertia, {"p_dot", "q_dot", "r_dot"}),
}


def test_the_packaged_aircraft_obeys_newton_and_euler() -> None:
    plant = hf.plant_with({})
    found = hf.outputs(plant, hf.state_of(plant))
    for axis, wanted in Hand().accelerations().items():
        assert found[axis] == pytest.approx(wanted, rel=1e-11), axis


@pytest.mark.parametrize("name", CASES)
def test_an_effect_changes_what_its_equation_says_and_nothing_else(name: str) -> None:
    values, change, moved = CASES[name]
    hand = Hand()
    change(hand, values)
    wanted, bare = hand.accelerations(), Hand().accelerations()
    plant = hf.plant_with({name: values})
    found = hf.outputs(plant, hf.state_of(plant))
    for axis in AXES:
        assert found[axis] == pytest.approx(wanted[axis], rel=1e-11, abs=1e-12), axis
        assert (abs(found[axis] - bare[axis]) > 1e-9) == (axis in moved), axis


@pytest.mark.parametrize("name", ["propeller_torque", "p_factor", "propeller_gyroscopic"])
def test_a_propeller_that_turns_the_other_way_reverses_its_moments(name: str) -> None:
    """Counter-clockwise from behind: the change in the moments is the opposite one."""
    values = CASES[name][0]
    changes = []
    for rotation in ("cw", "ccw"):
        bare, plant = hf.plant_with({}, rotation), hf.plant_with({name: values}, rotation)
        before, after = hf.outputs(bare, hf.state_of(bare)), hf.outputs(plant, hf.state_of(plant))
        changes.append([after[axis] - before[axis] for axis in AXES[3:]])
    np.testing.assert_allclose(changes[0], -np.array(changes[1]), rtol=1e-9, atol=1e-12)
    assert np.abs(changes[0]).max() > 1e-3


def test_a_clockwise_propeller_rolls_left_and_yaws_left_at_a_high_angle_of_attack() -> None:
    """What every pilot of an American single knows."""
    bare = hf.plant_with({})
    before = hf.outputs(bare, hf.state_of(bare))
    for name, axis in (("propeller_torque", "p_dot"), ("p_factor", "r_dot")):
        plant = hf.plant_with({name: CASES[name][0]})
        assert hf.outputs(plant, hf.state_of(plant))[axis] < before[axis]


def test_a_gyroscope_does_no_work() -> None:
    """Its moment is at right angles to the rates: the change of kinetic energy is nil."""
    tensor = np.array([[hf.IXX, 0.0, -hf.IXZ], [0.0, hf.IYY, 0.0], [-hf.IXZ, 0.0, hf.IZZ]])
    rates = np.array([P, Q, R])
    power = []
    for effects in ({}, {"propeller_gyroscopic": {"I_P": 2e-4}}):
        plant = hf.plant_with(effects)
        found = hf.outputs(plant, hf.state_of(plant))
        power.append(rates @ tensor @ np.array([found[axis] for axis in AXES[3:]]))
    assert power[1] == pytest.approx(power[0], rel=1e-9)


@pytest.mark.parametrize(
    ("alpha", "wanted"),
    [(0.0, "attached"), (0.20, "half"), (-0.20, "half"), (0.6, "plate"), (-0.6, "plate"), (1.5, "plate")],
)
def test_lift_fades_from_the_attached_line_to_the_flat_plate(alpha: float, wanted: str) -> None:
    """At the stalling angle the two are mixed half and half; far beyond it nothing of the wing is left."""
    plant = hf.plant_with({"stall": {"alpha_stall": 0.20, "sharpness": 50.0}})
    x = hf.body_state()
    x[3:6] = V * math.cos(alpha), 0.0, V * math.sin(alpha)
    found = hf.outputs(plant, hf.state_of(plant, x))
    line = 0.1784 + 2.453 * alpha + 0.7405 * DE
    plate = math.copysign(2.0, alpha) * math.sin(alpha) ** 2 * math.cos(alpha)
    share = {"attached": 0.0, "half": 0.5, "plate": 1.0}[wanted]
    CL = (1.0 - share) * line + share * plate
    assert found["CL"] == pytest.approx(CL, abs=2e-4)
    assert found["CD"] == pytest.approx(0.0871 + 0.4 * CL**2 + share * 2.0 * abs(math.sin(alpha)) ** 3, abs=3e-4)


def alpha_rate(plant: Plant, step: float = 1e-5) -> float:
    """alpha-dot of the motion itself: central difference along the path, through the integrator."""
    here = hf.state_of(plant)
    rate = plant.rates(here, hf.STILL, hf.STILL)
    ends = [here.x + sign * step * rate for sign in (-1.0, 1.0)]
    low, high = (math.atan2(x[5], x[3]) for x in ends)
    return (high - low) / (2.0 * step)


@pytest.mark.parametrize(
    "values", [{"Cm_alphadot": -2.0}, {"CL_alphadot": 3.0}, {"Cm_alphadot": -2.0, "CL_alphadot": 3.0}]
)
def test_downwash_lag_acts_by_the_rate_at_which_alpha_really_changes(values: dict[str, float]) -> None:
    """The rate depends on the lift that depends on the rate; what counts is the one the path then has."""
    plant = hf.plant_with({"downwash_lag": values})
    alphadot = alpha_rate(plant) * C / (2 * V)
    assert abs(alphadot) > 1e-4
    hand = Hand()
    hand.extra_CL = values.get("CL_alphadot", 0.0) * alphadot
    hand.moments[1] = hand.qbar * S * C * values.get("Cm_alphadot", 0.0) * alphadot
    found = hf.outputs(plant, hf.state_of(plant))
    for axis, wanted in hand.accelerations().items():
        assert found[axis] == pytest.approx(wanted, rel=1e-7), axis


def test_downwash_lag_counts_the_air_not_the_ground() -> None:
    """The same motion through air that moves: rates over ground differ, forces do not."""
    plant = hf.plant_with({"downwash_lag": {"Cm_alphadot": -2.0, "CL_alphadot": 3.0}})
    still = hf.state_of(plant)
    wind = np.array([3.0, -5.0, 1.0])
    moved = hf.state_of(plant)
    q0, q = moved.x[6], moved.x[7:10]
    moved.x[3:6] += wind + 2.0 * np.cross(q, np.cross(q, wind) - q0 * wind)
    plant.evaluate(moved, wind, hf.STILL, 0.0)
    a, b = hf.outputs(plant, still), hf.outputs(plant, moved)
    assert a["vn"] + wind[0] == pytest.approx(b["vn"], abs=1e-12)
    for axis in (*AXES, "V", "alpha", "beta", "CL", "Cm"):
        assert a[axis] == pytest.approx(b[axis], rel=1e-10), axis


def test_unsteady_lift_follows_a_sudden_gust_with_its_time_constant() -> None:
    """An upgust that comes at once: lift holds the old angle, then goes to the new one as 1 - exp(-t / tau)."""
    tau, dt = 0.05, 1e-4
    plant = hf.plant_with({"unsteady_lift": {"tau": tau}})
    x = hf.body_state()
    x[3:6], x[10:13] = (V, 0.0, 0.0), 0.0
    x[13] = 0.0
    state = hf.state_of(plant, x)
    gust = np.array([0.0, 0.0, -V * math.tan(0.05)])
    lag = []
    time = dt * np.arange(1, 301)
    alpha = np.empty(time.size)
    for k in range(time.size):
        plant.step(state, hf.SURFACES, dt, gust_body=gust)
        found = hf.outputs(plant, state)
        alpha[k] = found["alpha"]
        lag.append((found["CL"] - 0.1784 - 0.7405 * DE) / 2.453)
    # alpha itself moves on as the aircraft responds: convolve it, trapezoidal rule, from rest at 0.
    path = np.concatenate(([math.atan(math.tan(0.05))], alpha))
    grid = dt * np.arange(path.size)
    wanted = [
        np.trapezoid(path[: k + 1] * np.exp(-(grid[k] - grid[: k + 1]) / tau) / tau, dx=dt) for k in range(1, 301)
    ]
    np.testing.assert_allclose(lag, wanted, atol=2e-6)
    assert lag[0] < 0.001
    assert lag[-1] > 0.4 * alpha[-1]


def test_unsteady_lift_stays_stable_with_the_shortest_lag_and_the_longest_step() -> None:
    plant = hf.plant_with({"unsteady_lift": {"tau": 0.005}})
    plant_long = type(plant)(plant.vehicle, plant.model, max_step=0.05)
    states = [hf.state_of(p) for p in (plant, plant_long)]
    for _ in range(50):
        for p, state in zip((plant, plant_long), states, strict=True):
            p.step(state, hf.SURFACES, 0.05)
    np.testing.assert_allclose(states[0].x, states[1].x, atol=1e-9)
    assert np.isfinite(states[0].x).all()


def test_motor_lag_lets_thrust_follow_the_throttle_as_one_minus_an_exponential() -> None:
    tau = 0.15
    plant = hf.plant_with({"motor_lag": {"tau": tau}})
    state = hf.state_of(plant)
    command = hf.SURFACES.copy()
    command[3] = 0.9
    for k in range(1, 30):
        plant.step(state, command, 0.02)
        throttle = 0.9 + (THROTTLE - 0.9) * math.exp(-0.02 * k / tau)
        assert hf.outputs(plant, state)["thrust"] == pytest.approx(MAX_THRUST * throttle, rel=1e-12)


def test_the_thrust_cell_reads_the_assumed_thrust_less_what_accelerates_the_motor() -> None:
    """True thrust is (1 + scale) times what the cell says, and 0.08 kg of motor and propeller hang on the cell."""
    for scale in (0.0, 0.05):
        plant = hf.plant_with({"thrust_scale": {"scale": scale}})
        state = hf.state_of(plant)
        hand = Hand()
        hand.thrust *= 1.0 + scale
        wanted = THRUST - 0.08 * hand.accelerations()["ax"]
        assert hf.readings(plant, state)["thrust"] == pytest.approx(wanted, rel=1e-12)


def test_the_moment_of_an_inclined_thrust_line_that_passes_beside_the_centre_of_gravity() -> None:
    vehicle = hf.vehicle()
    assert vehicle.propulsion is not None
    point, angle = np.array([0.12, 0.03, -0.05]), 0.06
    vehicle = replace(vehicle, propulsion=replace(vehicle.propulsion, line=tuple(point), inclination=angle))
    plant = Plant(vehicle, hf.model_with({}))
    found = hf.outputs(plant, hf.state_of(plant))
    force = THRUST * np.array([math.cos(angle), 0.0, -math.sin(angle)])
    hand = Hand(thrust=float(force[0]), extra_z=float(force[2]), moments=np.cross(point, force))
    for axis, wanted in hand.accelerations().items():
        assert found[axis] == pytest.approx(wanted, rel=1e-11), axis


def test_every_regressor_enters_as_its_name_says() -> None:
    """One term per regressor on the rolling moment, which starts from nothing."""
    CL = Hand().lift()
    regressors = {
        "0": 1.0, "alpha": ALPHA, "beta": BETA, "p": PHAT, "q": QHAT, "r": RHAT, "de": DE, "da": DA, "dr": DR,
        "throttle": THROTTLE, "CL": CL, "alpha2_de": ALPHA**2 * DE, "beta_p_r_dr": BETA * PHAT * RHAT * DR,
    }  # fmt: skip
    lift_terms = {name: entry for name, entry in hf.model_with({}).coefficients.items() if name.startswith("CL")}
    for name, value in regressors.items():
        model = Model("one term", lift_terms).with_coefficient(f"Cl_{name}", 0.7)
        plant = Plant(hf.vehicle(), model)
        assert hf.outputs(plant, hf.state_of(plant))["Cl"] == pytest.approx(0.7 * value, rel=1e-12), name
