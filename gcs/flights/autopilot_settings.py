"""What the parameters of an autopilot say of its aircraft, for what the vehicle file leaves out.

ArduPilot: SERVOn_FUNCTION, _MIN, _TRIM, _MAX, _REVERSED, INS_POS1_*, GPS_POS1_*, INS_GYRO_FILTER, ARSPD_TYPE
(ardupilot.org/plane, "Complete parameter list"). PX4: PWM_MAIN_FUNCn, _MINn, _MAXn, PWM_MAIN_REV, CA_SV_CSn_TYPE,
EKF2_IMU_POS_*, EKF2_GPS_POS_* (docs.px4.io, "Parameter reference"). No parameter says how far a surface moves.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from gcs.flights.streams import ColumnSource
from sim_vehicle.vehicle.controls import CONTROL_NAMES, DEFLECTION_SIGNALS, LARGEST_PWM_US, Control, mixing_matrix
from sim_vehicle.vehicle.strict_toml import Known
from sim_vehicle.vehicle.vehicle_file import Vehicle

# Travel at the ends of the servo's range, rad, where nobody has measured it (usual throws of small aircraft are 15 to
# 35 deg), and what it is known to, 1 sigma.
USUAL_TRAVEL, USUAL_TRAVEL_STD = float(np.radians(25.0)), 0.3
_INT32 = 6  # MAV_PARAM_TYPE
_SERVOS = range(1, 17)

Mix = Mapping[str, float]
_LEFT_ELEVON, _RIGHT_ELEVON = {"elevator": 0.5, "aileron": -0.5}, {"elevator": 0.5, "aileron": 0.5}
_LEFT_TAIL, _RIGHT_TAIL = {"elevator": 0.5, "rudder": 0.5}, {"elevator": 0.5, "rudder": -0.5}
# What a servo's demand is of the demands to pitch up, roll right and yaw right. ArduPilot: by SERVOn_FUNCTION.
_ARDUPILOT: Mapping[int, Mix] = {
    4: {"aileron": 1.0}, 19: {"elevator": 1.0}, 21: {"rudder": 1.0}, 70: {"throttle": 1.0},
    77: _LEFT_ELEVON, 78: _RIGHT_ELEVON, 79: _LEFT_TAIL, 80: _RIGHT_TAIL,
}  # fmt: skip
# PX4: by CA_SV_CSn_TYPE, surfaces going up and to the right.
_PX4: Mapping[int, Mix] = {
    1: {"aileron": -1.0}, 2: {"aileron": 1.0}, 3: {"elevator": 1.0}, 4: {"rudder": 1.0},
    5: _LEFT_ELEVON, 6: _RIGHT_ELEVON, 7: _LEFT_TAIL, 8: _RIGHT_TAIL, 15: {"aileron": 1.0},
}  # fmt: skip
_PX4_MOTOR, _PX4_SURFACE = 101, 201
# Messages whose rates and forces ArduPilot's low pass has gone through, as those of its log "IMU" have; by how much
# sensors' own filters differ, s.
_FILTERED, _FILTER_STD_S = ("HIGHRES_IMU", "SCALED_IMU", "RAW_IMU"), 0.002
_POSITIONS = {
    "accelerometer": ("INS_POS1_{}", "INS_POS_{}", "EKF2_IMU_POS_{}"),
    "gps": ("GPS1_POS_{}", "GPS_POS1_{}", "EKF2_GPS_POS_{}"),
}


def parameters_of(recording: ColumnSource, system: int) -> dict[str, float]:
    """Every parameter that a recording holds, the last value that was sent; what is no finite number is left out."""
    found: dict[str, float] = {}
    for columns in recording.columns("PARAM_VALUE", system):
        rows = columns.fields
        for name, value, kind in zip(rows["param_id"], rows["param_value"], rows["param_type"], strict=True):
            text = bytes(name).split(b"\0")[0].decode("ascii", "replace")
            whole = float(np.float32(value).view(np.int32))
            # PX4 sends the bytes of a whole number in the place of the float, ArduPilot its value.
            found[text] = whole if kind == _INT32 and 0.0 < abs(value) < 1e-30 else float(value)
    return {name: value for name, value in found.items() if np.isfinite(value)}


def filled(vehicle: Vehicle, parameters: Mapping[str, float], messages: Collection[str] = ()) -> Vehicle:
    """The vehicle with what its file leaves out by the autopilot's parameters: controls, places of sensors, lateness of
    the IMU; a warning says of each what was taken. messages: those that the recording has.
    """
    controls, warnings = dict(vehicle.controls), list(vehicle.warnings)
    taken = {servo for control in controls.values() for servo in control.servos}
    more = {
        name: control
        for name, control in _controls(parameters).items()
        if name not in controls and DEFLECTION_SIGNALS[name] not in vehicle.signals and not taken & set(control.servos)
    }
    if np.linalg.matrix_rank(mixing_matrix(more)[1]) < len(more):
        warnings.append(
            "[controls] is not given, and the servos of the log's parameters cannot be distinguished: give it"
        )
        more = {}
    for name, control in more.items():
        controls[name] = control
        servos = ", ".join(
            f"{n} ({low[0]:.0f} to {low[-1]:.0f} us)" for n, low in zip(control.servos, control.pwm, strict=True)
        )
        line = f"[controls.{name}] is not given: servo {servos} by the log's parameters"
        if name != "throttle":
            line += (
                f"; that it moves by {np.degrees(USUAL_TRAVEL):.0f} deg is assumed, to {USUAL_TRAVEL_STD:.0%}, down and"
                " left positive: measure its travel"
            )
        warnings.append(line)
    moved: dict[str, Any] = {}
    for sensor, names in _POSITIONS.items():
        place = _position(parameters, names)
        if any(place) and not any(vehicle.sensors[sensor].position):
            moved[sensor] = replace(vehicle.sensors[sensor], position=place)
            warnings.append(f"[sensors.{sensor}] position is not given: {list(place)} m by the log's parameters")
    timing = dict(vehicle.timing)
    late_s = filter_delay(parameters.get("INS_GYRO_FILTER", 0.0))
    for message in (one for one in _FILTERED if late_s > 0.0 and one in messages and one not in timing):
        timing[message] = Known(late_s, _FILTER_STD_S)
        warnings.append(
            f"[timing] {message} is not given: {1e3 * late_s:.1f} ms late by the log's parameters (INS_GYRO_FILTER ="
            f" {parameters['INS_GYRO_FILTER']:g} Hz)"
        )
    if parameters.get("ARSPD_TYPE") == 0.0:
        warnings.append("ARSPD_TYPE is 0: no airspeed sensor; an airspeed in the log is the autopilot's own guess")
    sensors = replace(vehicle.sensors, **moved)
    return replace(vehicle, controls=controls, sensors=sensors, timing=timing, warnings=tuple(warnings))


def filter_delay(cutoff_hz: float) -> float:
    """By how much Butterworth's low pass of second order delays what is slow, s: sqrt(2) / w; 0 where there is none."""
    return 2.0**0.5 / (2.0 * np.pi * cutoff_hz) if cutoff_hz > 0.0 else 0.0


def _position(parameters: Mapping[str, float], names: tuple[str, ...]) -> tuple[float, float, float]:
    """First of the places by these names that is there, m from the centre of gravity; zeros for none."""
    for name in names:
        x, y, z = (round(parameters.get(name.format(axis), 0.0), 4) for axis in "XYZ")
        if x or y or z:
            return x, y, z
    return 0.0, 0.0, 0.0


def _controls(parameters: Mapping[str, float]) -> dict[str, Control]:
    """Controls by what drives their servos, each with the travel that is usual."""
    servos: dict[str, list[tuple[int, float]]] = {name: [] for name in CONTROL_NAMES}
    curves: dict[int, tuple[float, ...]] = {}
    reversed_: dict[int, bool] = {}
    for servo, mix, pulses, turned in (*_by_ardupilot(parameters), *_by_px4(parameters)):
        curves[servo], reversed_[servo] = pulses, turned
        for name, weight in mix.items():
            servos[name].append((servo, weight))
    found = {}
    for name, entries in servos.items():
        if not entries:
            continue
        if name == "throttle":
            entries = entries[:1]
        pwm = tuple(
            curves[servo] if name != "throttle" else curves[servo][:: len(curves[servo]) - 1] for servo, _ in entries
        )
        travel = tuple(_travel(name, len(xs), reversed_[servo]) for (servo, _), xs in zip(entries, pwm, strict=True))
        share = sum(abs(weight) for _, weight in entries)
        weights = tuple(weight / share for _, weight in entries)
        doubt = 0.0 if name == "throttle" else USUAL_TRAVEL_STD
        found[name] = Control(name, "command", tuple(servo for servo, _ in entries), weights, pwm, travel, doubt)
    return found


def _travel(name: str, points: int, turned: bool) -> tuple[float, ...]:
    """Deflections at the points of a servo's range: a demand to pitch up, roll right or yaw right is negative."""
    values = (0.0, 1.0) if name == "throttle" else (USUAL_TRAVEL, 0.0, -USUAL_TRAVEL)
    values = values if points == len(values) else (values[0], values[-1])
    return values[::-1] if turned else values


def _by_ardupilot(parameters: Mapping[str, float]) -> Iterator[tuple[int, Mix, tuple[float, ...], bool]]:
    """Servo, what it is of which demand, its pulses [us], whether it is reversed."""
    for servo in _SERVOS:
        mix = _ARDUPILOT.get(int(parameters.get(f"SERVO{servo}_FUNCTION", 0)))
        if mix is not None:
            low, middle, high = (
                parameters.get(f"SERVO{servo}_{key}", usual)
                for key, usual in (("MIN", 1100.0), ("TRIM", 1500.0), ("MAX", 1900.0))
            )
            if 0.0 < low < high <= LARGEST_PWM_US:
                yield servo, mix, _pulses(low, middle, high), parameters.get(f"SERVO{servo}_REVERSED", 0.0) != 0.0


def _by_px4(parameters: Mapping[str, float]) -> Iterator[tuple[int, Mix, tuple[float, ...], bool]]:
    turned = int(parameters.get("PWM_MAIN_REV", 0.0))
    for servo in _SERVOS:
        function = int(parameters.get(f"PWM_MAIN_FUNC{servo}", 0.0))
        low, high = (
            parameters.get(f"PWM_MAIN_{key}{servo}", usual) for key, usual in (("MIN", 1000.0), ("MAX", 2000.0))
        )
        kind = int(parameters.get(f"CA_SV_CS{function - _PX4_SURFACE}_TYPE", 0.0))
        mix = {"throttle": 1.0} if function == _PX4_MOTOR else _PX4.get(kind) if function >= _PX4_SURFACE else None
        if mix is not None and 0.0 < low < high <= LARGEST_PWM_US:
            yield servo, mix, _pulses(low, (low + high) / 2.0, high), bool(turned >> (servo - 1) & 1)


def _pulses(low: float, middle: float, high: float) -> tuple[float, ...]:
    return (low, middle, high) if low < middle < high else (low, high)
