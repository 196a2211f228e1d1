"""A field flight as a telemetry log with a vehicle file and its truth, for estimators that read files."""

from __future__ import annotations

import json
import math
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
from field_flight import MICROSECOND, FieldFlight

from sysid.signals.flight import Signal

os.environ.setdefault("MAVLINK20", "1")

from pymavlink.dialects.v20 import ardupilotmega as mavlink

START = 1_750_000_000.0  # s since the epoch, when the log begins; the vehicle has been up for BOOT seconds then
BOOT = 20.0
TEMPERATURE, GAS = 15.0, 287.053  # degrees Celsius, J/(kg K)
OUTPUTS = ("da", "de", "throttle", "dr")  # servo 1 to 4
FINE = 2e-5  # rad of a microsecond where a position is told, which is no pulse and must not be rounded


def messages(flight: FieldFlight) -> list[tuple[float, Any]]:
    """Time on the vehicle's clock, s, and message, in order."""
    signals = flight.signals.signals
    found: list[tuple[float, Any]] = []

    def rows(*names: str) -> zip[tuple[float, ...]]:
        first: Signal = signals[names[0]]
        times = first.time_s + BOOT
        return zip(times.tolist(), *(_held(signals[name], first).tolist() for name in names), strict=True)

    def ms(t: float) -> int:
        return round(t * 1e3)

    def us(t: float) -> int:
        return round(t * 1e6)

    for t, ax, ay, az, p, q, r, rho in rows("ax", "ay", "az", "p", "q", "r", "air_density"):
        pressure = rho * GAS * (TEMPERATURE + 273.15) / 100.0
        imu = (ax, ay, az, p, q, r, 0.0, 0.0, 0.0, pressure, 0.0, 0.0, TEMPERATURE, 0b1101000111111)
        found.append((t, mavlink.MAVLink_highres_imu_message(us(t), *imu)))
    for t, phi, theta, psi in rows("phi", "theta", "psi"):
        yaw = math.remainder(psi, 2.0 * math.pi)
        found.append((t, mavlink.MAVLink_attitude_message(ms(t), phi, theta, yaw, 0.0, 0.0, 0.0)))
    for t, alpha, beta in rows("alpha", "beta"):
        found.append((t, mavlink.MAVLink_aoa_ssa_message(us(t), math.degrees(alpha), math.degrees(beta))))
    for t, speed in rows("airspeed"):
        found.append((t, mavlink.MAVLink_airspeed_message(0, speed, 1500, 101300.0, 0)))
    for t, thrust in rows("thrust"):
        found.append((t, mavlink.MAVLink_named_value_float_message(ms(t), b"thrust", thrust)))
    for t, *velocity in rows("vn", "ve", "vd"):
        found.append((t, mavlink.MAVLink_local_position_ned_message(ms(t), 0.0, 0.0, 0.0, *velocity)))
    for t, da, de, throttle, dr in rows(*OUTPUTS):
        one, centre = _pulse(flight)
        pulses = [round(centre + x / one) for x in (da, de)] + [round(1000 + 1000 * throttle), round(centre + dr / one)]
        found.append((t, mavlink.MAVLink_servo_output_raw_message(us(t), 0, *pulses, 0, 0, 0, 0)))
    for t in np.arange(BOOT, BOOT + flight.seconds, 1.0).tolist():
        beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 4, 3)
        found.append((t, beat))
    return sorted(found, key=lambda pair: pair[0])


def _held(signal: Signal, other: Signal) -> Any:
    """Values on the other's stamps: its own, where they are the same."""
    same = signal.time_s.size == other.time_s.size
    return signal.values if same else np.interp(other.time_s, signal.time_s, signal.values)


def _position(flight: FieldFlight) -> bool:
    return flight.vehicle.controls["elevator"].signal == "position"


def _pulse(flight: FieldFlight) -> tuple[float, float]:
    """Rad of a microsecond, and the pulse of no deflection."""
    return (FINE, 30000.0) if _position(flight) else (MICROSECOND, 1500.0)


def vehicle_file(flight: FieldFlight) -> str:
    """What the estimator is told, as a vehicle file with one servo a control."""
    v = flight.vehicle
    one, centre = _pulse(flight)
    travel = 20000.0 if _position(flight) else 500.0
    lines = [f'name = "{v.name}"', "[mass]"]
    lines += [f"{key} = {getattr(v.mass, key)!r}" for key in ("mass", "Ixx", "Iyy", "Izz", "Ixz")]
    lines += ["[geometry]", *(f"{key} = {getattr(v.geometry, key)!r}" for key in ("S", "b", "c"))]
    for name, servo in (("aileron", 1), ("elevator", 2), ("rudder", 4)):
        lines += [f"[controls.{name}]", f"servo = {servo}", f'signal = "{v.controls[name].signal}"']
        lines += [f"pwm = [{centre - travel!r}, {centre!r}, {centre + travel!r}]"]
        lines += [f"deflection = [{-travel * one!r}, 0.0, {travel * one!r}]"]
    lines += ["[controls.throttle]", "servo = 3", "pwm = [1000, 2000]", "deflection = [0.0, 1.0]"]
    if v.propulsion is not None:
        lines += ["[propulsion]", f"line = {list(v.propulsion.line)}", f"max_thrust = {v.propulsion.max_thrust!r}"]
    lines += ["[sensors]", 'airspeed = { kind = "calibrated" }']
    lines += [f"accelerometer = {{ position = {list(v.sensors.accelerometer.position)} }}"]
    lines += [f"alpha_vane = {{ position = {list(v.sensors.alpha_vane.position)} }}"]
    lines += [f'beta_vane = {{ position = {list(v.sensors.beta_vane.position)}, kind = "sideslip" }}']
    lines += ["[environment]", f"gravity = {v.environment.gravity!r}"]
    lines += ["[flight]", f"airspeed = {v.flight.airspeed!r}"]
    return "\n".join(lines) + "\n"


def write_flight(flight: FieldFlight, path: Path) -> None:
    """Write PATH.tlog, PATH.toml and PATH.truth.json."""
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    log = bytearray()
    for t, message in messages(flight):
        log += struct.pack(">Q", round((START + t) * 1e6)) + message.pack(link)
        link.seq = (link.seq + 1) % 256
    path.with_name(f"{path.name}.tlog").write_bytes(log)
    path.with_name(f"{path.name}.toml").write_text(vehicle_file(flight), encoding="utf-8")
    told = {"truth": flight.truth, "excited": flight.excited, "seconds": flight.seconds}
    path.with_name(f"{path.name}.truth.json").write_text(json.dumps(told), encoding="utf-8")
