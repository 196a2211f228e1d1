"""What sensors read at their places, and sensor effects, against closed forms and derivatives of the motion."""

from __future__ import annotations

import math
from dataclasses import replace

import hand_flight as hf
import numpy as np
import pytest
from numpy.typing import NDArray

from sim_vehicle.flight.plant import CHANNELS, Plant
from sim_vehicle.physics.rotation import quaternion

Array = NDArray[np.float64]

DT = 0.02
EFFECTS_OFF: dict[str, dict[str, float]] = {}


def attitude(x: Array) -> Array:
    """Matrix (3, 3) that turns body components into earth ones, from the quaternion."""
    w, a, b, c = x[6:10]
    return np.array(
        [
            [1 - 2 * (b * b + c * c), 2 * (a * b - c * w), 2 * (a * c + b * w)],
            [2 * (a * b + c * w), 1 - 2 * (a * a + c * c), 2 * (b * c - a * w)],
            [2 * (a * c - b * w), 2 * (b * c + a * w), 1 - 2 * (a * a + b * b)],
        ]
    )


def path_of(plant: Plant, step: float = 1e-4, count: int = 2) -> list[Array]:
    """States (14,) at -count ... count steps about the general state, along the motion under held surfaces."""
    forward = [hf.body_state()]
    state = hf.state_of(plant)
    for _ in range(2 * count):
        plant.step(state, hf.SURFACES, step)
        forward.append(state.x.copy())
    return forward


def accelerometer_at(place: tuple[float, float, float], effects: dict[str, dict[str, float]]) -> dict[str, float]:
    vehicle = hf.vehicle()
    sensors = replace(vehicle.sensors, accelerometer=replace(vehicle.sensors.accelerometer, position=place))
    plant = Plant(replace(vehicle, sensors=sensors), hf.model_with(effects))
    state = hf.state_of(plant)
    step = 1e-4
    for _ in range(2):
        plant.step(state, hf.SURFACES, step)
    return hf.readings(plant, state)


@pytest.mark.parametrize("place", [(0.3, 0.0, 0.0), (0.0, 0.4, 0.0), (0.0, 0.0, -0.2), (0.15, -0.4, 0.1)])
def test_an_accelerometer_reads_the_second_derivative_of_the_path_of_its_own_place(
    place: tuple[float, float, float],
) -> None:
    """Fourth-order differences of the earth position of the place, less gravity, turned into body axes."""
    plant = hf.plant_with(EFFECTS_OFF)
    step = 1e-4
    states = path_of(plant, step)
    # Velocity of the place over ground, exact by rigid-body kinematics; its derivative by differences.
    velocity = [attitude(x) @ (x[3:6] + np.cross(x[10:13], place)) for x in states]
    slope = (velocity[0] - 8 * velocity[1] + 8 * velocity[3] - velocity[4]) / (12.0 * step)
    wanted = attitude(states[2]).T @ (slope - np.array([0.0, 0.0, hf.GRAVITY]))
    by_file = accelerometer_at(place, EFFECTS_OFF)
    offset = dict(zip("xyz", place, strict=True))
    by_effect = accelerometer_at((0.0, 0.0, 0.0), {"accelerometer_offset": offset})
    for i, axis in enumerate(("ax", "ay", "az")):
        assert by_file[axis] == pytest.approx(wanted[i], abs=1e-7)
        assert by_effect[axis] == pytest.approx(wanted[i], abs=1e-7)


def test_an_accelerometer_offset_adds_to_the_place_in_the_vehicle_file() -> None:
    both = accelerometer_at((0.1, 0.2, 0.0), {"accelerometer_offset": {"x": 0.05, "y": -0.3, "z": 0.02}})
    whole = accelerometer_at((0.15, -0.1, 0.02), EFFECTS_OFF)
    assert both == pytest.approx(whole, abs=1e-12)


def test_a_misaligned_accelerometer_reads_the_components_in_its_own_axes() -> None:
    """Sensor axes are the body's turned by pitch about y, then by roll about the new x."""
    pitch, roll = 0.05, -0.03
    plain, turned = (
        hf.plant_with(EFFECTS_OFF),
        hf.plant_with({"accelerometer_misalignment": {"pitch": pitch, "roll": roll}}),
    )
    a = hf.readings(plain, hf.state_of(plain))
    b = hf.readings(turned, hf.state_of(turned))
    force = np.array([a["ax"], a["ay"], a["az"]])
    # Unit vectors of the sensor's axes in body components, from their picture.
    x_axis = np.array([math.cos(pitch), 0.0, -math.sin(pitch)])
    z_pitched = np.array([math.sin(pitch), 0.0, math.cos(pitch)])
    y_axis = math.cos(roll) * np.array([0.0, 1.0, 0.0]) + math.sin(roll) * z_pitched
    z_axis = np.cross(x_axis, y_axis)
    read = [b["ax"], b["ay"], b["az"]]
    np.testing.assert_allclose(read, [x_axis @ force, y_axis @ force, z_axis @ force], rtol=1e-12)
    assert np.linalg.norm(read) == pytest.approx(float(np.linalg.norm(force)), rel=1e-12)


def test_level_at_rest_a_sensor_pitched_up_reads_gravity_forward() -> None:
    """Specific force of 1 g upward: an x axis that points up by eps sees + g sin(eps)."""
    plant = hf.plant_with({"accelerometer_misalignment": {"pitch": 0.02}})
    trim = plant.trim(15.0)
    plain = hf.plant_with(EFFECTS_OFF)
    change = hf.readings(plant, trim.state)["ax"] - hf.readings(plain, plain.trim(15.0).state)["ax"]
    assert change == pytest.approx(0.02 * hf.GRAVITY, rel=0.02)


@pytest.mark.parametrize("kind", ["sideslip", "flank"])
def test_vanes_see_the_flow_at_their_own_places(kind: str) -> None:
    """Velocity of the air at the vane is that of the place; small-angle lever arms as the vehicle file's formulae."""
    vehicle = hf.vehicle()
    place_a, place_b = (0.3, 0.5, 0.0), (0.25, -0.4, 0.06)
    sensors = replace(
        vehicle.sensors,
        alpha_vane=replace(vehicle.sensors.alpha_vane, position=place_a),
        beta_vane=replace(vehicle.sensors.beta_vane, position=place_b, kind=kind),
    )
    plant = Plant(replace(vehicle, sensors=sensors), hf.model_with(EFFECTS_OFF))
    x = hf.body_state()
    # A straight-and-level-like state, where the small-angle formulae are exact to first order in the rates.
    x[3:6] = hf.V, 0.0, 0.0
    x[10:13] = 1e-3, 2e-3, -1.5e-3
    read = hf.readings(plant, hf.state_of(plant, x))
    flow_a, flow_b = (x[3:6] + np.cross(x[10:13], place) for place in (place_a, place_b))
    assert read["alpha"] == pytest.approx(math.atan2(flow_a[2], flow_a[0]), abs=2e-8)
    wanted = math.atan2(flow_b[1], flow_b[0]) if kind == "flank" else math.asin(flow_b[1] / np.linalg.norm(flow_b))
    assert read["beta"] == pytest.approx(wanted, abs=2e-8)


def test_a_flank_vane_reads_the_angle_in_its_own_plane() -> None:
    vehicle = hf.vehicle()
    sensors = replace(vehicle.sensors, beta_vane=replace(vehicle.sensors.beta_vane, kind="flank"))
    plant = Plant(replace(vehicle, sensors=sensors), hf.model_with(EFFECTS_OFF))
    assert hf.readings(plant, hf.state_of(plant))["beta"] == pytest.approx(
        math.atan(math.tan(hf.BETA) / math.cos(hf.ALPHA)), rel=1e-12
    )


def test_vane_rate_error_is_a_vane_that_sits_elsewhere() -> None:
    plant = hf.plant_with({"vane_rate_error": {"x": 0.3, "y": -0.2}})
    read = hf.readings(plant, hf.state_of(plant))
    assert read["alpha"] == pytest.approx(hf.ALPHA - 0.3 * hf.Q / hf.V + -0.2 * hf.P / hf.V, rel=1e-12)
    assert read["beta"] == pytest.approx(hf.BETA + 0.3 * hf.R / hf.V, rel=1e-12)


def test_scale_and_bias_effects_read_one_plus_scale_times_the_truth_plus_bias() -> None:
    indicated = hf.V * math.sqrt(hf.RHO / 1.225)
    effects = {
        "vane_upwash": {"scale": 0.08, "bias": 0.01},
        "airspeed_error": {"scale": -0.03, "bias": 0.4},
        "imu_scale": {"scale": 0.01, "bias": 0.002},
    }
    plant = hf.plant_with(effects)
    read = hf.readings(plant, hf.state_of(plant))
    wanted = {
        "alpha": 1.08 * hf.ALPHA + 0.01, "beta": hf.BETA, "airspeed": 0.97 * indicated + 0.4,
        "p": 1.01 * hf.P + 0.002, "q": 1.01 * hf.Q + 0.002, "r": 1.01 * hf.R + 0.002,
    }  # fmt: skip
    assert {name: read[name] for name in wanted} == pytest.approx(wanted, rel=1e-12)


def test_a_true_airspeed_sensor_does_not_feel_the_density() -> None:
    vehicle = hf.vehicle()
    sensors = replace(vehicle.sensors, airspeed=replace(vehicle.sensors.airspeed, kind="true"))
    plant = Plant(replace(vehicle, sensors=sensors), hf.model_with(EFFECTS_OFF))
    assert hf.readings(plant, hf.state_of(plant))["airspeed"] == pytest.approx(hf.V, rel=1e-12)


def test_the_other_channels_read_the_state_as_it_is() -> None:
    plant = hf.plant_with(EFFECTS_OFF)
    x = hf.body_state()
    x[:3] = 12.0, -7.0, -93.0
    read = hf.readings(plant, hf.state_of(plant, x))
    over_ground = attitude(x) @ x[3:6]
    wanted = {
        "phi": hf.PHI, "theta": hf.THETA, "psi": hf.PSI, "altitude": 93.0, "north": 12.0, "east": -7.0,
        "vn": over_ground[0], "ve": over_ground[1], "vd": over_ground[2],
    }  # fmt: skip
    assert {name: read[name] for name in wanted} == pytest.approx(wanted, abs=1e-12)


def ramped(effects: dict[str, dict[str, float]], channel: str, slope: float, count: int = 60) -> tuple[Array, Array]:
    """Readings of a channel, and what it truly is, while the aircraft is led along a ramp of it; no rates, no wind."""
    plant = hf.plant_with(effects)
    state = hf.state_of(plant)
    read, true = np.empty(count), np.empty(count)
    for k in range(count):
        value = {"alpha": 0.05, "beta": -0.02, "airspeed": 15.0, "phi": -0.3, "theta": 0.1}
        value[channel] += slope * k * DT
        speed, alpha, beta = value["airspeed"], value["alpha"], value["beta"]
        state.x[3:6] = speed * np.array(
            [math.cos(alpha) * math.cos(beta), math.sin(beta), math.sin(alpha) * math.cos(beta)]
        )
        state.x[6:10] = quaternion(value["phi"], value["theta"], 0.4)
        state.x[10:13] = 0.0
        plant.evaluate(state, hf.STILL, hf.STILL, DT if k else 0.0)
        read[k] = hf.readings(plant, state)[channel]
        true[k] = value[channel] * (math.sqrt(hf.RHO / 1.225) if channel == "airspeed" else 1.0)
    return read, true


@pytest.mark.parametrize("tau", [0.005, 0.04, 0.25])
@pytest.mark.parametrize(
    ("effect", "channel", "slope"),
    [
        ("vane_lag", "alpha", 0.2),
        ("vane_lag", "beta", -0.3),
        ("pitot_lag", "airspeed", 2.0),
        ("attitude_lag", "phi", 0.8),
        ("attitude_lag", "theta", -0.4),
    ],
)
def test_a_lag_answers_a_ramp_late_by_its_time_constant(effect: str, channel: str, slope: float, tau: float) -> None:
    """y = x0 + s (t - tau (1 - exp(-t / tau))) for a ramp x0 + s t from rest: exact at every sample."""
    read, true = ramped({effect: {"tau": tau}}, channel, slope)
    t = DT * np.arange(read.size)
    slope_read = (true[-1] - true[0]) / t[-1]
    wanted = true[0] + slope_read * (t - tau * -np.expm1(-t / tau))
    np.testing.assert_allclose(read, wanted, atol=1e-12)


@pytest.mark.parametrize("effect", ["vane_lag", "pitot_lag", "attitude_lag"])
def test_a_lag_leaves_the_other_channels_alone(effect: str) -> None:
    lagged = {"vane_lag": {"alpha", "beta"}, "pitot_lag": {"airspeed"}, "attitude_lag": {"phi", "theta"}}[effect]
    plain, late = hf.plant_with(EFFECTS_OFF), hf.plant_with({effect: {"tau": 0.1}})
    states = [hf.state_of(plant) for plant in (plain, late)]
    for _ in range(10):
        for plant, state in zip((plain, late), states, strict=True):
            plant.step(state, hf.SURFACES, DT)
    differing = {name for name, a, b in zip(CHANNELS, states[0].reading, states[1].reading, strict=True) if a != b}
    assert differing == lagged


def test_a_lag_starts_settled() -> None:
    for effect in ("vane_lag", "pitot_lag", "attitude_lag"):
        plain, late = hf.plant_with(EFFECTS_OFF), hf.plant_with({effect: {"tau": 0.2}})
        np.testing.assert_array_equal(hf.state_of(late).reading, hf.state_of(plain).reading)


def test_upwash_comes_before_the_lag_of_the_vane() -> None:
    """The flow at the vane is scaled, then the vane turns into it: the lagged ramp has the scaled slope."""
    tau, slope = 0.05, 0.2
    read, true = ramped({"vane_upwash": {"scale": 0.1, "bias": 0.02}, "vane_lag": {"tau": tau}}, "alpha", slope)
    wanted = 1.1 * (true[-1] - slope * tau) + 0.02
    assert read[-1] == pytest.approx(wanted, abs=1e-6)
