"""What the vehicle file says of servos, sensors and stamps is what the estimator knows before the flight."""

from __future__ import annotations

import math
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated import fly_mav

from sim_vehicle.errors import VehicleFileError
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import VEHICLES, Vehicle, load_vehicle
from sysid.identification.identify import identify
from sysid.posterior.nuisance_priors import PRIORS, unknowns_of
from sysid.posterior.stated_priors import airspeed_lag, declared, unused_timing, zero_stds

MESSAGES = {"q": "HIGHRES_IMU", "de": "SERVO_OUTPUT_RAW", "alpha": "AOA_SSA", "airspeed": "VFR_HUD"}
NOMINAL = {one.name: one for one in PRIORS}


def written(folder: Path, *changes: tuple[str, str], more: str = "") -> Vehicle:
    """The trainer's vehicle file with keys added."""
    text = (VEHICLES / "ultrastick25e.toml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "plane.toml"
    path.write_text(text + "\n" + more)
    return load_vehicle(path)


def test_a_silent_file_leaves_the_table() -> None:
    plane = load_vehicle("ultrastick25e")
    assert declared(plane, "longitudinal", MESSAGES) == {}
    assert airspeed_lag(plane, MESSAGES) == (0.05, 0.05)


def test_servo_sensors_and_stamps_are_taken_from_the_file(tmp_path: Path) -> None:
    plane = written(
        tmp_path,
        ("[controls.elevator]\n", "[controls.elevator]\ndelay = 0.02\ndelay_std = 0.003\nlag = 0.0\nlag_std = 0.0\n"),
        more="[timing]\nSERVO_OUTPUT_RAW = { offset = 0.008, std = 0.004 }\nHIGHRES_IMU = { offset = 0.001 }\n"
        "AOA_SSA = { offset = 0.011 }\n",
    )
    sensors = replace(
        plane.sensors,
        alpha_vane=replace(plane.sensors.alpha_vane, scale_std=0.01, bias_std=0.002),
        airspeed=replace(plane.sensors.airspeed, scale_std=0.03, bias_std=0.4, position_error_std=0.02),
    )
    plane = replace(plane, sensors=sensors)
    told = declared(plane, "longitudinal", MESSAGES)
    # A command that is stamped late acts early by its stamps; the gyro's own offset counts against both.
    assert told["servo_delay"] == pytest.approx((0.02 - 0.007, math.hypot(0.003, 0.004)))
    assert told["vane_clock"] == pytest.approx((0.010, NOMINAL["vane_clock"].std))
    assert told["airspeed_error"] == (None, pytest.approx(math.hypot(0.03, 0.4 / plane.flight.airspeed)))
    assert told["airspeed_alpha"] == (None, 0.02)
    assert zero_stds(plane)["alpha"] == 0.002
    unknowns = unknowns_of("longitudinal", True, False, told)
    assert "servo_lag" not in unknowns.names
    assert unknowns.fixed["servo_lag"] == 0.0
    assert dict(zip(unknowns.names, unknowns.std, strict=True))["alpha_scale"] == 0.01
    assert dict(zip(unknowns.names, unknowns.std, strict=True))["servo_backlash"] == NOMINAL["servo_backlash"].std


def test_a_vane_that_lags_is_one_that_swings_more_slowly(tmp_path: Path) -> None:
    plane = written(tmp_path)
    swinging = replace(plane.sensors.alpha_vane, lag=replace(plane.sensors.alpha_vane.lag, value=0.024, std=0.006))
    slow = replace(plane, sensors=replace(plane.sensors, alpha_vane=swinging))
    mean, std = declared(slow, "longitudinal", MESSAGES)["vane_period"]
    assert mean is not None
    assert std == pytest.approx(mean / 4.0)
    # 2 damping over omega, at the usual damping, is the lag of a slow ramp.
    assert 2.0 * 0.3 / (2.0 * math.pi / mean) == pytest.approx(0.024)


def test_moments_of_inertia_a_little_beyond_the_triangle_are_a_doubt(tmp_path: Path) -> None:
    plain = load_vehicle("ultrastick25e").mass
    text = (VEHICLES / "ultrastick25e.toml").read_text()
    line = next(line for line in text.splitlines() if line.startswith("Izz"))
    for beyond in (1.06, 1.15):
        path = tmp_path / f"{beyond}.toml"
        izz = beyond * (plain.Ixx + plain.Iyy)
        path.write_text(text.replace(line, f"Izz = {izz}").replace("Ixz =", "Ixz = 0.0 #"))
        if beyond < 1.1:
            assert any("exceeds the sum of the other two by 6%" in one for one in load_vehicle(path).warnings)
        else:
            with pytest.raises(VehicleFileError, match="exceeds the sum"):
                load_vehicle(path)


def test_a_negative_standard_deviation_is_refused_with_its_key(tmp_path: Path) -> None:
    with pytest.raises(VehicleFileError, match=r"controls.elevator.lag_std is -1; it must be at least 0"):
        written(tmp_path, ("[controls.elevator]\n", "[controls.elevator]\nlag_std = -1\n"))


def test_stamps_of_a_message_that_brings_nothing_are_said(tmp_path: Path) -> None:
    plane = written(tmp_path, more="[timing]\nSERVO_OUTPUT = { offset = 0.008 }\nAOA_SSA = { offset = 0.01 }\n")
    (line,) = unused_timing(plane, MESSAGES)
    assert line.startswith("timing.SERVO_OUTPUT: no signal of this flight comes in that message")
    assert "SERVO_OUTPUT_RAW" in line


@pytest.mark.whole_flight
def test_without_moments_of_inertia_moments_are_known_within_wide_bars(tmp_path: Path) -> None:
    text = re.sub(r"^I(xx|yy|zz|xz)\s*=.*\n", "", (VEHICLES / "iitb-mav.toml").read_text("utf-8"), flags=re.MULTILINE)
    for points in VEHICLES.glob("*.csv"):
        shutil.copy(points, tmp_path)
    path = tmp_path / "unswung.toml"
    path.write_text(text, encoding="utf-8")
    flight = fly_mav("elevator-3211,aileron-doublet,rudder-doublet", 3)[0]
    vehicle = load_vehicle(str(path))
    found, truth = identify([flight], vehicle, systematic=False), read_model("iitb-mav").values()
    for name in ("CL_alpha", "CL_de", "CD_0", "CD_k", "CY_beta", "CY_dr"):
        assert found.model.coefficients[name].value == pytest.approx(truth[name], rel=0.15), name
    joint = found.posterior.joint  # type: ignore[union-attr]
    share = vehicle.mass.Iyy_std / vehicle.mass.Iyy  # type: ignore[operator]
    for name in ("Cm_alpha", "Cm_de"):
        place = joint.names.index(name)
        value, std = joint.mean[place], np.sqrt(joint.covariance[place, place])
        assert std == pytest.approx(share * abs(value), rel=0.25), name
        assert abs(value - truth[name]) < 1.96 * std
        assert found.model.coefficients[name].value == pytest.approx(value)  # not refused: the bar says it
    # Their ratio, and so the modes, are known as well as with inertia that was measured.
    first, second = found.model.coefficients["Cm_alpha"].value, found.model.coefficients["Cm_de"].value
    assert first / second == pytest.approx(truth["Cm_alpha"] / truth["Cm_de"], rel=0.1)  # type: ignore[operator]
    assert any("since the moments of inertia are" in one.text for one in found.quality.reasons)
