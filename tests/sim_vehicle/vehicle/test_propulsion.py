"""Thrust and torque by CT and CQ over advance ratio: closed forms, curves, the vehicle file's keys."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import hand_flight as hf
import numpy as np
import pytest

from sim_vehicle.errors import VehicleFileError
from sim_vehicle.flight.plant import Plant
from sim_vehicle.physics.layout import CT_PLACE
from sim_vehicle.physics.propeller import along, curve
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.propulsion import Curve, Polynomial, Propulsion
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle

CT = Polynomial((0.1, -0.02, -0.12), (0.0, 0.8))
CQ = Polynomial((0.006, 0.004, -0.015), (0.0, 0.8))
DIAMETER, MAX_RPM = 0.25, 12000.0


def vehicle(rotation: str = "cw", inclination: float = 0.0, CT: Curve = CT, CQ: Curve = CQ) -> Vehicle:
    motor = Propulsion(
        line=(0.1, 0.0, 0.02), inclination=inclination, diameter=DIAMETER, rotation=rotation, CT=CT, CQ=CQ,
        max_rpm=MAX_RPM,
    )  # fmt: skip
    return replace(hf.vehicle(), propulsion=motor)


def by_hand() -> tuple[float, float, float]:
    """Revolutions a second, thrust and torque in the general state at half throttle."""
    n = hf.THROTTLE * MAX_RPM / 60.0
    J = hf.V / (n * DIAMETER)
    thrust = hf.RHO * n**2 * DIAMETER**4 * (0.1 - 0.02 * J - 0.12 * J**2)
    return n, thrust, hf.RHO * n**2 * DIAMETER**5 * (0.006 + 0.004 * J - 0.015 * J**2)


@pytest.mark.parametrize(("rotation", "sign"), [("cw", -1.0), ("ccw", 1.0)])
@pytest.mark.parametrize("inclination", [0.0, 0.05])
def test_thrust_and_torque_act_on_the_aircraft_as_newton_and_euler_say(
    rotation: str, sign: float, inclination: float
) -> None:
    plant = Plant(vehicle(rotation, inclination), hf.model_with({}))
    n, thrust, torque = by_hand()
    axis = np.array([math.cos(inclination), 0.0, -math.sin(inclination)])
    moments = np.cross([0.1, 0.0, 0.02], thrust * axis) + sign * torque * axis
    hand = hf.Hand(thrust=thrust * axis[0], extra_z=thrust * axis[2], moments=moments)
    found = hf.outputs(plant, hf.state_of(plant))
    assert {name: found[name] for name in hand.accelerations()} == pytest.approx(hand.accelerations(), rel=1e-9)
    assert found["thrust"] == pytest.approx(thrust, rel=1e-12)
    assert found["rpm"] == pytest.approx(60.0 * n, rel=1e-12)


def test_points_are_met_without_bumps_between_and_go_on_straight_beyond() -> None:
    points = ((0.0, 0.11), (0.2, 0.1), (0.5, 0.06), (0.8, -0.01))
    P = flatten(vehicle(CT=points), hf.model_with({})).P
    for J, value in points:
        assert curve(P, CT_PLACE, J)[0] == pytest.approx(value, abs=1e-15)
    inside = np.array([curve(P, CT_PLACE, J)[0] for J in np.linspace(0.0, 0.8, 400)])
    assert (np.diff(inside) < 0.0).all()
    for edge, way in ((0.0, -1.0), (0.8, 1.0)):
        first, second = (curve(P, CT_PLACE, edge + way * d)[0] - curve(P, CT_PLACE, edge)[0] for d in (1e-6, 0.3))
        assert second / 0.3 == pytest.approx(first / 1e-6, rel=1e-4)


def test_two_points_are_a_straight_line() -> None:
    P = flatten(vehicle(CT=((0.0, 0.1), (1.0, -0.1))), hf.model_with({})).P
    assert [curve(P, CT_PLACE, J)[0] for J in (-0.5, 0.25, 1.5)] == pytest.approx([0.2, 0.05, -0.2])


def test_a_propeller_that_stops_gives_no_thrust_and_no_division_by_zero() -> None:
    P = flatten(vehicle(), hf.model_with({})).P
    thrust, torque = along(np.zeros(1), np.array([15.0]), np.array([1.2]), P)
    assert abs(thrust[0]) < 1e-3
    assert abs(torque[0]) < 1e-3


def test_trim_needs_the_thrust_that_the_drag_takes_and_aileron_against_the_torque() -> None:
    plant = Plant(vehicle(), hf.model_with({}))
    trim = plant.trim()
    outputs = hf.outputs(plant, trim.state)
    assert trim.residual < 1e-9
    n = outputs["throttle"] * MAX_RPM / 60.0
    J = outputs["V"] / (n * DIAMETER)
    assert outputs["thrust"] == pytest.approx(hf.RHO * n**2 * DIAMETER**4 * (0.1 - 0.02 * J - 0.12 * J**2), rel=1e-9)
    assert abs(outputs["da"]) > 1e-4


KEYS = {
    "CT must be two to 25 pairs": "diameter = 0.2\nCT = [[0, 0.1]]\n",
    "CT.polynomial has 7": "diameter = 0.2\nCT = { polynomial = [1, 2, 3, 4, 5, 6, 7], range = [0, 1] }\n",
    "CT.range must be": "diameter = 0.2\nCT = { polynomial = [0.1, -0.1], range = [1, 0] }\n",
    "CT.range is missing": "diameter = 0.2\nCT = { polynomial = [0.1, -0.1] }\n",
    "CT.degree is not a key": "diameter = 0.2\nCT = { polynomial = [0.1], range = [0, 1], degree = 1 }\n",
}
BASE = '[mass]\nmass=1\nIxx=0.02\nIyy=0.03\nIzz=0.045\n[geometry]\nS=0.2\nb=1\nc=0.2\n[propulsion]\n'  # fmt: skip


@pytest.mark.parametrize("message", KEYS)
def test_a_curve_that_cannot_be_is_refused_by_its_key(tmp_path: Path, message: str) -> None:
    path = tmp_path / "plane.toml"
    path.write_text(BASE + KEYS[message], encoding="utf-8")
    with pytest.raises(VehicleFileError) as caught:
        load_vehicle(path)
    assert f"propulsion.{message}" in str(caught.value)


def test_without_the_speed_of_the_propeller_the_simulator_says_what_it_needs(tmp_path: Path) -> None:
    path = tmp_path / "plane.toml"
    path.write_text(BASE + "diameter = 0.2\nCT = [[0, 0.1], [1, 0]]\n", encoding="utf-8")
    with pytest.raises(VehicleFileError, match=r"give .propulsion. max_thrust in newtons, or CT, diameter and max_rpm"):
        Plant(load_vehicle(path), hf.model_with({}))
