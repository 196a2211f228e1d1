"""What the parameters of an autopilot say of its aircraft, for what the vehicle file leaves out.

ArduPilot: SERVOn_FUNCTION, _MIN, _TRIM, _MAX, _REVERSED, INS_POS1_*, GPS_POS1_*, INS_GYRO_FILTER, ARSPD_TYPE
(ardupilot.org/plane, "Complete parameter list"). PX4: PWM_MAIN_FUNCn, _MINn, _CENTn, _MAXn, PWM_MAIN_REV, the same of
PWM_AUX, CA_SV_CSn_TYPE, EKF2_IMU_POS_*, EKF2_GPS_POS_* (docs.px4.io, "Parameter reference"). No parameter says how far
a surface moves.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gcs.errors import SignalMapError
from gcs.flights.forward_flight import pushes
from gcs.flights.streams import Array, ColumnSource, Stream, load_streams
from sim_vehicle.vehicle.controls import (
    CONTROL_NAMES,
    LARGEST_PWM_US,
    OUTPUTS,
    PORTS,
    Control,
    mixing_matrix,
    output_name,
    signal_of,
)
from sim_vehicle.vehicle.strict_toml import Known
from sim_vehicle.vehicle.vehicle_file import Vehicle

# Travel at the ends of the servo's range, rad, where nobody has measured it (usual throws of small aircraft are 15 to
# 35 deg), and what it is known to, 1 sigma.
USUAL_TRAVEL, USUAL_TRAVEL_STD = float(np.radians(25.0)), 0.3
_INT32 = 6  # MAV_PARAM_TYPE
# Messages whose samples say from when to when a flight goes, and how far apart moments are that are one, s.
_SAMPLES = ("SERVO_OUTPUT_RAW", "HIGHRES_IMU", "SCALED_IMU", "RAW_IMU", "ATTITUDE", "SYSTEM_TIME")
_MOMENT_S = 1e-3
# Parameters that the autopilot's own reading of airspeed goes by, whatever the vehicle file says.
_OF_AIRSPEED = ("ARSPD_", "ASPD_", "SENS_DPRES_", "CAL_AIR_")
_SERVOS = range(1, len(PORTS) * OUTPUTS + 1)

Mix = Mapping[str, float]
_LEFT_ELEVON, _RIGHT_ELEVON = {"elevator": 0.5, "aileron": -0.5}, {"elevator": 0.5, "aileron": 0.5}
_LEFT_TAIL, _RIGHT_TAIL = {"elevator": 0.5, "rudder": 0.5}, {"elevator": 0.5, "rudder": -0.5}
# Controls whose demand is a share of their travel, 0 to 1, whatever that is.
_SHARES = ("throttle", "flap", "airbrake", "spoiler")
# What a servo's demand is of the demands to pitch up, roll right and yaw right. ArduPilot: by SERVOn_FUNCTION.
_ARDUPILOT: Mapping[int, Mix] = {
    4: {"aileron": 1.0}, 19: {"elevator": 1.0}, 21: {"rudder": 1.0}, 70: {"throttle": 1.0},
    24: {"aileron": 1.0}, 25: {"aileron": 1.0}, 73: {"throttle": 1.0}, 74: {"throttle": 1.0},
    2: {"flap": 1.0}, 3: {"flap": 1.0}, 110: {"airbrake": 1.0},
    77: _LEFT_ELEVON, 78: _RIGHT_ELEVON, 79: _LEFT_TAIL, 80: _RIGHT_TAIL,
}  # fmt: skip
# PX4: by CA_SV_CSn_TYPE, surfaces going up and to the right.
_PX4: Mapping[int, Mix] = {
    1: {"aileron": -1.0}, 2: {"aileron": 1.0}, 3: {"elevator": 1.0}, 4: {"rudder": 1.0},
    5: _LEFT_ELEVON, 6: _RIGHT_ELEVON, 7: _LEFT_TAIL, 8: _RIGHT_TAIL, 15: {"aileron": 1.0},
    9: {"flap": 1.0}, 10: {"flap": 1.0}, 11: {"airbrake": 1.0}, 17: {"spoiler": 1.0}, 18: {"spoiler": 1.0},
}  # fmt: skip
_PX4_MOTOR, _PX4_MOTORS, _PX4_SURFACE = 101, 12, 201
# What else ArduPilot moves that changes the forces on an aircraft.
_NO_CONTROL = {
    **dict.fromkeys((16, 17, 86, 87), "a differential spoiler"),
    **dict.fromkeys((41, 45, 46, 47, 75, 76), "a motor's tilt"),
    **{number: f"motor {number - 32}" for number in range(33, 41)},
}
# Messages whose rates and forces ArduPilot's low pass has gone through, as those of its log "IMU" have; by how much
# sensors' own filters differ, s.
_FILTERED, _FILTER_STD_S = ("HIGHRES_IMU", "SCALED_IMU", "RAW_IMU"), 0.002
_POSITIONS = {
    "accelerometer": ("INS_POS1_{}", "INS_POS_{}", "EKF2_IMU_POS_{}"),
    "gps": ("GPS1_POS_{}", "GPS_POS1_{}", "EKF2_GPS_POS_{}"),
}


@dataclass(frozen=True)
class Change:
    """A parameter that got another value in flight: when, s, and which one is taken for the whole of it."""

    name: str
    time_s: float
    before: float
    after: float
    taken: float

    def __str__(self) -> str:
        return (
            f"{self.name} changed from {self.before:g} to {self.after:g} at {self.time_s:.1f} s; {self.taken:g}, which"
            " held for longest, is taken throughout: identify each part by itself with --from and --to"
        )


def parameters_of(
    recording: ColumnSource, system: int, start_s: float | None = None, stop_s: float | None = None
) -> tuple[dict[str, float], list[Change]]:
    """Every parameter that a recording holds, and changes in flight. start_s, stop_s: the part of it that counts.

    A value counts from when it was sent, the first one before that too; of several in flight the one that held for
    longest is given. What is no finite number is left out.
    """
    first, last, clock = _span(recording, system)
    first, last = (max(first, start_s or 0.0), last if stop_s is None else min(last, stop_s))
    sent: dict[str, list[tuple[float, float]]] = {}
    for columns in recording.columns("PARAM_VALUE", system):
        rows = columns.fields
        times = clock(Stream("PARAM_VALUE", columns.component, columns.log_time, rows))
        for time, name, value, kind in zip(
            times.tolist(), rows["param_id"], rows["param_value"], rows["param_type"], strict=True
        ):
            text = bytes(name).split(b"\0")[0].decode("ascii", "replace")
            whole = float(np.float32(value).view(np.int32))
            # PX4 sends the bytes of a whole number in the place of the float, ArduPilot its value.
            number = whole if kind == _INT32 and 0.0 < abs(value) < 1e-30 else float(value)
            if np.isfinite(number):
                sent.setdefault(text, []).append((time, number))
    found: dict[str, float] = {}
    changes: list[Change] = []
    for name, values in sent.items():
        found[name], steps = _held(sorted(values, key=lambda one: one[0]), first, last)
        changes += [Change(name, *step, found[name]) for step in steps]
    return found, changes


def _span(recording: ColumnSource, system: int) -> tuple[float, float, Callable[[Stream], Array]]:
    """First and last sample of the flight, s, and how messages get onto its clock; without stamps, by reception."""
    try:
        streams = load_streams(recording, _SAMPLES, system)
    except SignalMapError:
        return -np.inf, np.inf, lambda stream: stream.log_ns / 1e9
    times = [one.time_s for group in streams.streams.values() for one in group if one.time_s.size]
    if not times:
        return -np.inf, np.inf, lambda stream: streams.clock.seconds(stream.stamps)
    first, last = min(float(one.min()) for one in times), max(float(one.max()) for one in times)
    return first, last, lambda stream: streams.clock.seconds(stream.stamps)


def _held(
    values: Sequence[tuple[float, float]], first: float, last: float
) -> tuple[float, list[tuple[float, float, float]]]:
    """The value that held for longest from first to last, and changes in between: when, before, after.

    values: (time, value) in order of time.
    """
    before = [value for time, value in values if time <= first + _MOMENT_S]
    value, since = before[-1] if before else values[0][1], first
    held: dict[float, float] = {}
    steps = []
    for time, after in values:
        if first + _MOMENT_S < time < last - _MOMENT_S and after != value:
            held[value] = held.get(value, 0.0) + time - since
            steps.append((time, value, after))
            value, since = after, time
    held[value] = held.get(value, 0.0) + last - since
    return max(held, key=lambda one: held[one]), steps


def flown(
    vehicle: Vehicle,
    recording: ColumnSource,
    system: int,
    messages: Collection[str] = (),
    start_s: float | None = None,
    stop_s: float | None = None,
) -> Vehicle | None:
    """The vehicle `filled` from a recording, None where that holds no parameters; a warning says of each that changed
    in flight and makes a difference to it.
    """
    found, changes = parameters_of(recording, system, start_s, stop_s)
    if not found:
        return None
    craft = filled(vehicle, found, messages)

    def matters(one: Change) -> bool:
        others = ({**found, one.name: value} for value in (one.before, one.after))
        return one.name.startswith(_OF_AIRSPEED) or any(filled(vehicle, other, messages) != craft for other in others)

    lines = [str(one) for one in changes if matters(one)]
    return replace(craft, warnings=(*craft.warnings, *lines))


def filled(vehicle: Vehicle, parameters: Mapping[str, float], messages: Collection[str] = ()) -> Vehicle:
    """The vehicle with what its file leaves out by the autopilot's parameters: controls, places of sensors, lateness of
    the IMU; a warning says of each what was taken. messages: those that the recording has.
    """
    controls, warnings = dict(vehicle.controls), list(vehicle.warnings)
    taken = {servo for control in controls.values() for servo in control.servos}
    more = {
        name: control
        for name, control in _controls(parameters).items()
        if name not in controls and signal_of(name) not in vehicle.signals and not taken & set(control.servos)
    }
    if np.linalg.matrix_rank(mixing_matrix(more)[1]) < len(more):
        warnings.append(
            "[controls] is not given, and the servos of the log's parameters cannot be distinguished: give it"
        )
        more = {}
    guessed = [name for name in more if name not in _SHARES]
    for name, control in more.items():
        controls[name] = control
        servos = ", ".join(
            f"{output_name(n)} ({low[0]:.0f} to {low[-1]:.0f} us)"
            for n, low in zip(control.servos, control.pwm, strict=True)
        )
        warnings.append(f"[controls.{name}] is not given: servo {servos} by the log's parameters")
    if guessed:
        warnings.append(
            f"travel of {', '.join(guessed)} is not in the log: {np.degrees(USUAL_TRAVEL):.0f} deg is taken, down and"
            f" left positive, and their derivatives are known to {100.0 * USUAL_TRAVEL_STD:.0f} %; measure it and write"
            " it to [controls]"
        )
    moving = {servo for control in controls.values() for servo in control.servos}
    for servo in _SERVOS:
        function = int(parameters.get(f"SERVO{servo}_FUNCTION", 0))
        if function in _NO_CONTROL and servo not in moving:
            warnings.append(
                f"servo {servo} is {_NO_CONTROL[function]} by the log's parameters (SERVO{servo}_FUNCTION ="
                f" {function}), which is no control of the model: what it does goes into the other coefficients"
            )
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
    servos: dict[str, list[tuple[int, float]]] = {name: [] for name in (*CONTROL_NAMES, *_SHARES)}
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
        pwm = tuple(
            curves[servo] if name not in _SHARES else curves[servo][:: len(curves[servo]) - 1] for servo, _ in entries
        )
        travel = tuple(_travel(name, len(xs), reversed_[servo]) for (servo, _), xs in zip(entries, pwm, strict=True))
        share = sum(abs(weight) for _, weight in entries)
        weights = tuple(weight / share for _, weight in entries)
        doubt = 0.0 if name in _SHARES else USUAL_TRAVEL_STD
        found[name] = Control(name, "command", tuple(servo for servo, _ in entries), weights, pwm, travel, doubt)
    return found


def _travel(name: str, points: int, turned: bool) -> tuple[float, ...]:
    """Deflections at the points of a servo's range: a demand to pitch up, roll right or yaw right is negative."""
    values = (0.0, 1.0) if name in _SHARES else (USUAL_TRAVEL, 0.0, -USUAL_TRAVEL)
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
    for port, name in enumerate(PORTS[:2]):
        turned = int(parameters.get(f"PWM_{name}_REV", 0.0))
        for output in range(1, OUTPUTS + 1):
            function = int(parameters.get(f"PWM_{name}_FUNC{output}", 0.0))
            low, high = (
                parameters.get(f"PWM_{name}_{key}{output}", usual) for key, usual in (("MIN", 1000.0), ("MAX", 2000.0))
            )
            middle = parameters.get(f"PWM_{name}_CENT{output}", -1.0)
            middle = middle if low < middle < high else (low + high) / 2.0
            kind = int(parameters.get(f"CA_SV_CS{function - _PX4_SURFACE}_TYPE", 0.0))
            motor = 0 <= function - _PX4_MOTOR < _PX4_MOTORS and pushes(parameters, function - _PX4_MOTOR)
            mix = {"throttle": 1.0} if motor else _PX4.get(kind) if function >= _PX4_SURFACE else None
            if mix is not None and 0.0 < low < high <= LARGEST_PWM_US:
                is_turned = bool(turned >> (output - 1) & 1)
                yield OUTPUTS * port + output, mix, _pulses(low, middle, high), is_turned


def _pulses(low: float, middle: float, high: float) -> tuple[float, ...]:
    return (low, middle, high) if low < middle < high else (low, high)
