"""The integrator's order, what a free body conserves, and how exact a trim is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sim_vehicle.flight.plant import OUTPUTS, Plant
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.physics.rotation import quaternion
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle

Array = NDArray[np.float64]

INERTIA = (0.02, 0.03, 0.045, 0.006)  # Ixx, Iyy, Izz, Ixz


def tensor() -> Array:
    Ixx, Iyy, Izz, Ixz = INERTIA
    return np.array([[Ixx, 0.0, -Ixz], [0.0, Iyy, 0.0], [-Ixz, 0.0, Izz]])


def vehicle_without_lag(density: float) -> Vehicle:
    vehicle = load_vehicle("iitb-mav")
    assert vehicle.propulsion is not None
    return replace(
        vehicle,
        mass=replace(vehicle.mass, Ixz=INERTIA[3]),
        propulsion=replace(vehicle.propulsion, tau=0.0),
        environment=replace(vehicle.environment, air_density=density),
    )


def fly(plant: Plant, x: Array, command: Array, seconds: float, step: float) -> Array:
    """Rigid-body state (14,) after `seconds` under a held command, in steps of exactly `step`."""
    state = plant.state_at(x, command, command)
    for _ in range(round(seconds / step)):
        plant.step(state, command, step)
    return state.x


@pytest.fixture
def tumbling() -> Array:
    x = np.zeros(14)
    x[2] = -100.0
    x[3:6] = 15.0, -2.0, 3.0
    x[6:10] = quaternion(0.4, -0.3, 1.2)
    x[10:13] = 2.0, -1.5, 3.0
    return x


def test_the_error_falls_with_the_fourth_power_of_the_step() -> None:
    """Runge and Kutta's classical method: halving the step divides the error by 16."""
    plant = Plant(vehicle_without_lag(1.225), read_model("iitb-mav"), max_step=1.0)
    trim = plant.trim(15.0, 100.0)
    command = trim.command + np.array([0.05, 0.03, -0.04, 0.1])
    steps = np.array([0.02, 0.01, 0.005, 0.0025])
    exact = fly(plant, trim.state.x, command, 1.0, 0.000625)
    errors = [np.linalg.norm(fly(plant, trim.state.x, command, 1.0, step)[:13] - exact[:13]) for step in steps]
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(4.0, abs=0.25)


def test_an_adaptive_integrator_of_eighth_order_gives_the_same_flight() -> None:
    plant = Plant(vehicle_without_lag(1.225), read_model("iitb-mav"), max_step=0.0025)
    trim = plant.trim(15.0, 100.0)
    command = trim.command + np.array([0.05, 0.03, -0.04, 0.1])

    def rate(_: float, x: Array) -> Array:
        return plant.rates(plant.state_at(x, command, command), np.zeros(3), np.zeros(3))

    reference = solve_ivp(rate, (0.0, 2.0), trim.state.x, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    ours = fly(plant, trim.state.x, command, 2.0, 0.0025)
    np.testing.assert_allclose(ours[:13], reference[:13], atol=2e-7, rtol=0)


def empty_space(gravity: float) -> Plant:
    """No aerodynamics and no thrust: a free body."""
    vehicle = vehicle_without_lag(1.225)
    vehicle = replace(vehicle, environment=replace(vehicle.environment, gravity=gravity))
    return Plant(vehicle, Model("nothing", {}), max_step=0.001)


def test_a_free_body_keeps_angular_momentum_and_energy(tumbling: Array) -> None:
    plant = empty_space(1e-12)
    J = tensor()

    def earth(x: Array) -> tuple[Array, Array]:
        q0, vector = x[6], x[7:10]

        def turn(a: Array) -> Array:
            return a + 2.0 * np.cross(vector, np.cross(vector, a) + q0 * a)

        return turn(J @ x[10:13]), turn(x[3:6])

    end = fly(plant, tumbling, np.zeros(4), 10.0, 0.001)
    for before, after in zip(earth(tumbling), earth(end), strict=True):
        np.testing.assert_allclose(after, before, rtol=0, atol=1e-9)
    energy = [x[10:13] @ J @ x[10:13] / 2.0 for x in (tumbling, end)]
    assert energy[1] == pytest.approx(energy[0], rel=1e-10)
    assert np.linalg.norm(end[10:13] - tumbling[10:13]) > 0.1  # it did tumble


def test_a_free_body_falls_on_a_parabola(tumbling: Array) -> None:
    plant = empty_space(9.80665)
    end = fly(plant, tumbling, np.zeros(4), 3.0, 0.001)
    vector, q0, v = tumbling[7:10], tumbling[6], tumbling[3:6]
    start = v + 2.0 * np.cross(vector, np.cross(vector, v) + q0 * v)
    fallen = tumbling[:3] + start * 3.0 + np.array([0.0, 0.0, 0.5 * 9.80665 * 9.0])
    np.testing.assert_allclose(end[:3], fallen, rtol=0, atol=1e-8)


def test_an_axisymmetric_top_precesses_at_the_closed_form_rate(tumbling: Array) -> None:
    """Euler's equations with Ixx = Iyy: p and q turn at (Izz - Ixx) / Ixx r, r stays."""
    vehicle = vehicle_without_lag(1.225)
    vehicle = replace(
        vehicle,
        mass=replace(vehicle.mass, Ixx=0.03, Iyy=0.03, Izz=0.045, Ixz=0.0),
        environment=replace(vehicle.environment, gravity=1e-12),
    )
    plant = Plant(vehicle, Model("nothing", {}), max_step=0.001)
    end = fly(plant, tumbling, np.zeros(4), 4.0, 0.001)
    p, q, r = tumbling[10:13]
    turned = (0.045 - 0.03) / 0.03 * r * 4.0
    wanted = [p * np.cos(turned) - q * np.sin(turned), q * np.cos(turned) + p * np.sin(turned), r]
    np.testing.assert_allclose(end[10:13], wanted, rtol=0, atol=1e-9)


@pytest.mark.parametrize("airspeed", [12.0, 15.0, 19.0])
@pytest.mark.parametrize("climb_angle", [-0.05, 0.0, 0.05])
def test_a_trim_accelerates_in_no_axis_and_stays(airspeed: float, climb_angle: float) -> None:
    plant = Plant(vehicle_without_lag(1.225), read_model("iitb-mav"))
    trim = plant.trim(airspeed, 100.0, climb_angle)
    assert trim.residual < 1e-8
    state = trim.state.copy()
    for _ in range(100):
        plant.step(state, trim.command, 0.02)
    outputs = dict(zip(OUTPUTS, plant.outputs(state), strict=True))
    assert outputs["V"] == pytest.approx(airspeed, abs=1e-7)
    assert outputs["down"] == pytest.approx(-100.0 - 2.0 * airspeed * np.sin(climb_angle), abs=1e-6)


def test_the_packaged_trim_is_the_papers() -> None:
    """Level flight at 15 m/s with Table IV: lift and drag by hand, at 3.9 deg with 3.7 N of thrust."""
    plant = Plant(vehicle_without_lag(1.225), read_model("iitb-mav"))
    trim = plant.trim(15.0, 100.0)
    outputs = dict(zip(OUTPUTS, plant.outputs(trim.state), strict=True))
    assert np.degrees(outputs["alpha"]) == pytest.approx(3.90, abs=0.01)
    assert np.degrees(outputs["de"]) == pytest.approx(0.086, abs=0.01)
    assert outputs["thrust"] == pytest.approx(3.735, abs=0.005)
