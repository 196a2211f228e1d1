"""Another aircraft flown by another simulation, its telemetry written by pymavlink alone.

Nothing of the product is used: its own equations of motion (body axes, moments solved with the full inertia tensor),
its own integration (RK4 at 4 ms), accelerations read with the command that is sent at the same instant, as most
simulations do it, and its own sensors. The vehicle file is the text that a user would write.
"""

from __future__ import annotations

import math
import os
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

os.environ.setdefault("MAVLINK20", "1")

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

Array = NDArray[np.float64]

VEHICLE = """
name = "heron"
[mass]
mass = 4.5
Ixx = 0.35
Iyy = 0.42
Izz = 0.70
Ixz = 0.03
[geometry]
S = 0.55
b = 2.1
c = 0.27
[controls.elevator]
servo = 3
pwm = [1100, 1500, 1900]
deflection = [0.35, 0.0, -0.35]
[controls.aileron]
servo = [1, 6]
pwm = [[1000, 1500, 2000], [1000, 1500, 2000]]
deflection = [[-0.4, 0.0, 0.4], [0.4, 0.0, -0.4]]
mix = [0.5, -0.5]
[controls.rudder]
servo = 4
pwm = [1000, 1500, 2000]
deflection = [-0.5, 0.0, 0.5]
[sensors]
accelerometer = { position = [0.05, 0.0, -0.02] }
alpha_vane = { position = [0.15, 0.6, 0.0] }
beta_vane = { position = [0.15, -0.6, 0.0], kind = "flank" }
airspeed = { kind = "true" }
"""

# Chosen for a glider-like aircraft; its surfaces have the usual signs, unlike those of the packaged aircraft.
TRUTH = {
    "CL_0": 0.25, "CL_alpha": 4.8, "CL_de": 0.42, "CD_0": 0.031, "CD_k": 0.058, "Cm_0": 0.021, "Cm_alpha": -0.9,
    "Cm_q": -11.0, "Cm_de": -1.1, "CY_beta": -0.38, "CY_dr": 0.19, "Cl_beta": -0.09, "Cl_p": -0.52, "Cl_r": 0.1,
    "Cl_da": -0.21, "Cn_beta": 0.075, "Cn_p": -0.03, "Cn_r": -0.13, "Cn_da": 0.012, "Cn_dr": -0.07,
}  # fmt: skip
BIASES = {"accel_bias_x": 0.12, "accel_bias_z": -0.15, "gyro_bias_q": 0.01, "gyro_bias_p": -0.006}

MASS, S, B, C = 4.5, 0.55, 2.1, 0.27
INERTIA = np.array([[0.35, 0.0, -0.03], [0.0, 0.42, 0.0], [-0.03, 0.0, 0.70]])
GRAVITY = 9.80665
PRESSURE, TEMPERATURE = 93_000.0, 291.15  # Pa, K
DENSITY = PRESSURE / (287.05287 * TEMPERATURE)
SPEED = 20.0
RATE_HZ, SUBSTEPS = 50, 5
ACCELEROMETER, VANES_X, VANE_Y = np.array([0.05, 0.0, -0.02]), 0.15, 0.6
DEG = math.pi / 180.0
# (start, seconds per unit, pattern in units, surface, rad)
INPUTS = (
    (2.0, 0.25, (3, -2, 1, -1), "de", 2.5 * DEG),
    (8.0, 0.4, (1, -1), "da", 3.0 * DEG),
    (12.0, 0.5, (1, -1), "dr", 5.0 * DEG),
    (17.0, 0.25, (-3, 2, -1, 1), "de", 2.5 * DEG),
    (22.0, 0.5, (-1, 1), "dr", 5.0 * DEG),
    (26.0, 0.4, (-1, 1), "da", 3.0 * DEG),
    (30.0, 0.4, (1, -1), "de", 3.0 * DEG),
)
DURATION_S = 35.0


@dataclass(frozen=True)
class Row:
    """One sample: time since take-up, s, what the sensors read, and the pulses that go to the servos, us."""

    time_s: float
    force: Array
    rates: Array
    angles: Array
    alpha: float
    beta: float
    airspeed: float
    thrust: float
    pulses: dict[int, int]


def aerodynamics(x: Sequence[float], surfaces: Sequence[float], thrust: float) -> tuple[Array, Array]:
    """Force without weight, N, and moment, N m, in body axes."""
    u, v, w, p, q, r = x[:6]
    de, da, dr = surfaces
    k = TRUTH
    speed = math.sqrt(u * u + v * v + w * w)
    alpha, beta = math.atan2(w, u), math.asin(v / speed)
    ph, qh, rh = p * B / (2 * speed), q * C / (2 * speed), r * B / (2 * speed)
    lift = k["CL_0"] + k["CL_alpha"] * alpha + k["CL_de"] * de
    drag = k["CD_0"] + k["CD_k"] * lift * lift
    side = k["CY_beta"] * beta + k["CY_dr"] * dr
    roll = k["Cl_beta"] * beta + k["Cl_p"] * ph + k["Cl_r"] * rh + k["Cl_da"] * da
    pitch = k["Cm_0"] + k["Cm_alpha"] * alpha + k["Cm_q"] * qh + k["Cm_de"] * de
    yaw = k["Cn_beta"] * beta + k["Cn_p"] * ph + k["Cn_r"] * rh + k["Cn_da"] * da + k["Cn_dr"] * dr
    qs = 0.5 * DENSITY * speed * speed * S
    ca, sa = math.cos(alpha), math.sin(alpha)
    force = np.array([thrust + qs * (lift * sa - drag * ca), qs * side, -qs * (lift * ca + drag * sa)])
    return force, qs * np.array([B * roll, C * pitch, B * yaw])


def slope(x: Array, surfaces: Sequence[float], thrust: float) -> Array:
    """Rate of change of u v w p q r phi theta psi."""
    values = x.tolist()
    force, moment = aerodynamics(values, surfaces, thrust)
    phi, theta = values[6], values[7]
    velocity, rates = x[:3], x[3:6]
    weight = GRAVITY * np.array([-math.sin(theta), math.sin(phi) * math.cos(theta), math.cos(phi) * math.cos(theta)])
    p, q, r = values[3:6]
    turn = q * math.sin(phi) + r * math.cos(phi)
    return np.concatenate(
        [
            force / MASS + weight - np.cross(rates, velocity),
            np.linalg.solve(INERTIA, moment - np.cross(rates, INERTIA @ rates)),
            [p + turn * math.tan(theta), q * math.cos(phi) - r * math.sin(phi), turn / math.cos(theta)],
        ]
    )


def trim() -> tuple[Array, float, float]:
    """State, elevator and thrust of straight and level flight, by Newton's method on three accelerations."""
    z = np.array([0.03, 0.0, 5.0])  # alpha, de, thrust

    def residual(z: Array) -> Array:
        state = np.array([SPEED * math.cos(z[0]), 0, SPEED * math.sin(z[0]), 0, 0, 0, 0, z[0], 0])
        return slope(state, (z[1], 0.0, 0.0), z[2])[[0, 2, 4]]

    for _ in range(20):
        jacobian = np.stack([(residual(z + step) - residual(z - step)) / 2e-6 for step in 1e-6 * np.eye(3)], axis=1)
        z = z - np.linalg.solve(jacobian, residual(z))
    alpha = float(z[0])
    return (
        np.array([SPEED * math.cos(alpha), 0, SPEED * math.sin(alpha), 0, 0, 0, 0, alpha, 0]),
        float(z[1]),
        float(z[2]),
    )


def wanted(time_s: float, surface: str) -> float:
    """The input on one surface at a time, rad."""
    total = 0.0
    for start, unit, pattern, name, amplitude in INPUTS:
        at = start
        for part in pattern if name == surface else ():
            end = at + abs(part) * unit
            if at - 1e-9 <= time_s < end - 1e-9:
                total += math.copysign(amplitude, part)
            at = end
    return total


def pulses_of(de: float, da: float, dr: float) -> tuple[dict[int, int], tuple[float, float, float]]:
    """Whole microseconds, and the deflections that these give."""
    elevator = round(1500 - de * 400 / 0.35)
    aileron, rudder = round(1500 + da * 500 / 0.4), round(1500 + dr * 500 / 0.5)
    pulses = {1: aileron, 6: aileron, 3: elevator, 4: rudder}
    return pulses, ((1500 - elevator) * 0.35 / 400, (aileron - 1500) * 0.4 / 500, (rudder - 1500) * 0.5 / 500)


def fly(seed: int) -> list[Row]:
    """The flight as its sensors saw it."""
    random = np.random.default_rng(seed)
    x, de_trim, thrust = trim()
    rows = []
    h = 1.0 / (RATE_HZ * SUBSTEPS)
    bias_force = np.array([BIASES["accel_bias_x"], 0.0, BIASES["accel_bias_z"]])
    bias_rates = np.array([BIASES["gyro_bias_p"], BIASES["gyro_bias_q"], 0.0])
    for sample in range(round(DURATION_S * RATE_HZ)):
        time_s = sample / RATE_HZ
        pulses, command = pulses_of(de_trim + wanted(time_s, "de"), wanted(time_s, "da"), wanted(time_s, "dr"))
        force, _ = aerodynamics(x.tolist(), command, thrust)
        rates, turning = x[3:6], slope(x, command, thrust)[3:6]
        arm = np.cross(turning, ACCELEROMETER) + np.cross(rates, np.cross(rates, ACCELEROMETER))
        u, v, w = x[:3].tolist()
        p, q, r = rates.tolist()
        speed = math.sqrt(u * u + v * v + w * w)
        rows.append(
            Row(
                time_s,
                force / MASS + arm + bias_force + random.normal(0.0, 0.05, 3),
                rates + bias_rates + random.normal(0.0, 0.001, 3),
                x[6:9] + random.normal(0.0, 0.001, 3),
                math.atan2(w, u) - VANES_X * q / speed + VANE_Y * p / speed + random.normal(0.0, 0.004),
                math.atan2(v, u) + VANES_X * r / speed + random.normal(0.0, 0.004),
                speed + random.normal(0.0, 0.05),
                thrust + random.normal(0.0, 0.05),
                pulses,
            )
        )
        for _ in range(SUBSTEPS):
            k1 = slope(x, command, thrust)
            k2 = slope(x + 0.5 * h * k1, command, thrust)
            k3 = slope(x + 0.5 * h * k2, command, thrust)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(x + h * k3, command, thrust))
    return rows


def _imu_messages(kind: str, row: Row, usec: int, ms: int) -> Iterator[Any]:
    force, rates = row.force.tolist(), row.rates.tolist()
    hecto_pascal, celsius = PRESSURE / 100.0, TEMPERATURE - 273.15
    if kind == "HIGHRES_IMU":
        air = (hecto_pascal, 0.0, 0.0, celsius)
        yield mavlink.MAVLink_highres_imu_message(usec, *force, *rates, 0.0, 0.0, 0.0, *air, 0x123F, 0)
        return
    milli_g = [round(value / 9.80665 * 1000.0) for value in force]
    milli_rad = [round(value * 1000.0) for value in rates]
    if kind == "RAW_IMU":
        yield mavlink.MAVLink_raw_imu_message(usec, *milli_g, *milli_rad, 0, 0, 0)
    else:
        yield mavlink.MAVLink_scaled_imu_message(ms, *milli_g, *milli_rad, 0, 0, 0)
    difference = 0.005 * DENSITY * row.airspeed**2
    yield mavlink.MAVLink_scaled_pressure_message(ms, hecto_pascal, difference, round(celsius * 100.0))


def messages(row: Row, kind: str, boot_s: float, autopilot: int = 0) -> Iterator[Any]:
    """Telemetry of one sample. kind: the message that carries specific force and rates. autopilot: MAV_AUTOPILOT."""
    usec = round((boot_s + row.time_s) * 1e6)
    ms = usec // 1000
    if usec % 1_000_000 == 0:
        yield mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_FIXED_WING, autopilot, 128, 0, 4, 3)
    yield from _imu_messages(kind, row, usec, ms)
    yield mavlink.MAVLink_attitude_message(ms, *row.angles.tolist(), *row.rates.tolist())
    yield mavlink.MAVLink_aoa_ssa_message(usec, math.degrees(row.alpha), math.degrees(row.beta))
    yield mavlink.MAVLink_vfr_hud_message(row.airspeed, row.airspeed, 0, 50, 120.0, 0.0)
    yield mavlink.MAVLink_named_value_float_message(ms, b"thrust", row.thrust)
    outputs = [row.pulses.get(number, 0) for number in range(1, 17)]
    yield mavlink.MAVLink_servo_output_raw_message(usec & 0xFFFFFFFF, 0, *outputs)


def write_tlog(
    path: Path,
    rows: Sequence[Row],
    kind: str,
    boot_s: float,
    keep: Callable[[Any], bool] = lambda message: True,
    autopilot: int = 0,
) -> None:
    """A telemetry log as a ground station keeps it: reception, us since 1970, in front of each frame.

    keep: which messages are sent. Reception is up to some ms behind, as over a radio. Written by pymavlink's own
    writer, which leaves the stamps to whoever logs.
    """
    random = np.random.default_rng(5)
    log = mavutil.mavlogfile(str(path), write=True, source_system=7, source_component=1)
    for row in rows:
        received = 1_790_000_000_000_000 + round((row.time_s + 0.004 + random.exponential(0.001)) * 1e6)
        for message in filter(keep, messages(row, kind, boot_s, autopilot)):
            log.write(struct.pack(">Q", received))
            log.mav.send(message)
    log.close()
