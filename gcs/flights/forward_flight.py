"""Of an aircraft that can hover only what it flies on its wing counts: lift motors at rest, no transition.

By EXTENDED_SYS_STATE.vtol_state, by the modes of ArduPilot's HEARTBEAT, and by the pulses of the motors that lift:
SERVOn_FUNCTION 33 to 40 and 82 to 85 (ArduPilot, "Quadplane"; tilting ones by Q_TILT_MASK), functions 101 to 112 of PX4
by CA_AIRFRAME and CA_ROTORn_AX (docs.px4.io, "Control Allocation").
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs.errors import SignalMapError
from gcs.flights.sender import FIXED_WING
from gcs.flights.streams import MAV_AUTOPILOT_ARDUPILOT, OF_STATE, VehicleStreams
from sim_vehicle.vehicle.controls import OUTPUTS, PORTS
from sysid.arrays import Array
from sysid.signals.flight import FlightSignals

#: Messages that are needed beside those of the signals.
MESSAGES = (*OF_STATE, "SERVO_OUTPUT_RAW")
# MAV_TYPE of what can hover, and MAV_VTOL_STATE of what does not fly on its wing.
_VTOL, _NOT_ON_WING = range(19, 26), (1, 2, 3)
# ArduPilot: modes that begin with Q, functions of motors that lift (number of the first one, and the count).
_Q_MODES, _MOTORS = (17, 18, 19, 20, 21, 22, 23, 25), ((33, 8), (82, 4))
_PX4_MOTOR, _PX4_MOTORS = 101, 12
_STANDARD_VTOL, _TILTROTOR, _TAILSITTER_CLASS = 2, 3, 10
# A motor turns above this share of its pulses.
_TURNS = 0.05
# Before and after a hover so much of the flight is neither, s; less than so much forward flight is none.
_BEFORE_S, _AFTER_S, _LEAST_S = 0.5, 2.0, 5.0


def pushes(parameters: Mapping[str, float], motor: int) -> bool:
    """Whether PX4's motor (from 0) drives the aircraft forward: all do but those that lift a VTOL."""
    airframe = int(parameters.get("CA_AIRFRAME", 0))
    if airframe == _STANDARD_VTOL:
        return parameters.get(f"CA_ROTOR{motor}_AX", 0.0) > 0.5
    if airframe == _TILTROTOR:
        return parameters.get(f"CA_ROTOR{motor}_TILT", 0.0) > 0.0 or parameters.get(f"CA_ROTOR{motor}_AX", 0.0) > 0.5
    return True


def lift_motors(parameters: Mapping[str, float]) -> dict[int, float]:
    """Output of each motor that only lifts -> the pulse above which it turns, us."""
    found: dict[int, float] = {}
    # Before 4.1 a tailsitter was a class of frames, and tilting motors were those of a mask alone.
    sits = parameters.get("Q_TAILSIT_ENABLE", float(parameters.get("Q_FRAME_CLASS") == _TAILSITTER_CLASS)) > 0.0
    if parameters.get("Q_ENABLE", 0.0) > 0.0 and not sits:
        tilting = int(parameters.get("Q_TILT_MASK", 0.0)) if parameters.get("Q_TILT_ENABLE", 1.0) > 0.0 else 0
        for servo in range(1, 2 * OUTPUTS + 1):
            function = int(parameters.get(f"SERVO{servo}_FUNCTION", 0))
            first = 0
            for begin, count in _MOTORS:
                if begin <= function < begin + count and not tilting >> (first + function - begin) & 1:
                    low = parameters.get("Q_M_PWM_MIN") or parameters.get(f"SERVO{servo}_MIN", 1000.0)
                    high = parameters.get("Q_M_PWM_MAX") or parameters.get(f"SERVO{servo}_MAX", 2000.0)
                    found[servo] = low + _TURNS * (high - low)
                first += count
    if int(parameters.get("CA_AIRFRAME", 0)) in (_STANDARD_VTOL, _TILTROTOR):
        for port, name in enumerate(PORTS[:2]):
            for output in range(1, OUTPUTS + 1):
                motor = int(parameters.get(f"PWM_{name}_FUNC{output}", 0)) - _PX4_MOTOR
                if 0 <= motor < _PX4_MOTORS and not pushes(parameters, motor):
                    low, high = (
                        parameters.get(f"PWM_{name}_{key}{output}", usual)
                        for key, usual in (("MIN", 1000.0), ("MAX", 2000.0))
                    )
                    found[OUTPUTS * port + output] = low + _TURNS * (high - low)
    return found


def forward(flight: FlightSignals, streams: VehicleStreams, parameters: Mapping[str, float]) -> FlightSignals:
    """The flight without what is not flown on the wing, which a warning says.

    Raises SignalMapError in one line where nothing is left.
    """
    motors = lift_motors(parameters)
    times = [one.time_s for one in flight.signals.values() if one.time_s.size]
    if not times:
        return flight
    begin, end = min(float(one[0]) for one in times), max(float(one[-1]) for one in times)
    hovers = _merged([*_by_state(streams), *_by_mode(streams), *_by_pulses(streams, motors)], begin, end)
    if not hovers:
        return flight
    lost = sum(b - a for a, b in hovers)
    if end - begin - lost < _LEAST_S:
        raise SignalMapError(
            f"{flight.name}: it never flies on its wing alone for {_LEAST_S:g} s: of {end - begin:.0f} s it hovers, or"
            f" its lift motors turn, for {lost:.0f} s; give a flight with forward flight in it"
        )

    def outside(stamps: Array) -> Array:
        kept = np.ones(stamps.size, dtype=bool)
        for a, b in hovers:
            kept &= (stamps < a) | (stamps > b)
        return kept

    signals = {}
    for name, one in flight.signals.items():
        # What is constant has but its two ends.
        kept = outside(one.time_s) if one.time_s.size > 2 else np.ones(one.time_s.size, dtype=bool)
        if kept.any():
            signals[name] = replace(one, time_s=one.time_s[kept], values=one.values[kept])
    said = f"{lost:.0f} s of {end - begin:.0f} s are not flown on the wing alone (hover, transition); they are left out"
    return replace(flight, signals=signals, warnings=(*flight.warnings, said))


def _by_state(streams: VehicleStreams) -> list[tuple[float, float]]:
    found = []
    for stream in streams.streams.get("EXTENDED_SYS_STATE", []):
        found += _spans(stream.time_s, np.isin(stream.values("vtol_state"), _NOT_ON_WING))
    return found


def _by_mode(streams: VehicleStreams) -> list[tuple[float, float]]:
    if streams.sender.autopilot != MAV_AUTOPILOT_ARDUPILOT or streams.sender.kind not in (FIXED_WING, *_VTOL):
        return []
    found = []
    for stream in streams.streams.get("HEARTBEAT", [])[:1]:
        found += _spans(stream.time_s, np.isin(stream.values("custom_mode"), _Q_MODES))
    return found


def _by_pulses(streams: VehicleStreams, motors: Mapping[int, float]) -> list[tuple[float, float]]:
    found = []
    for stream in streams.streams.get("SERVO_OUTPUT_RAW", []):
        ports = stream.values("port")
        for servo, turns in motors.items():
            port, place = divmod(servo - 1, OUTPUTS)
            mine = stream.only(ports == port)
            try:
                pulses = mine.values(f"servo{place + 1}_raw")
            except KeyError:
                continue
            found += _spans(mine.time_s, (pulses > turns) & (pulses < 65535.0))
    return found


def _spans(stamps: Array, there: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """From when to when a state holds, s: until the next message that says otherwise; of the first and last, always."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(np.int8)))
    ends = np.concatenate([stamps, [np.inf]])
    return [(float(ends[a]) if a else -np.inf, float(ends[b])) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _merged(spans: list[tuple[float, float]], begin: float, end: float) -> list[tuple[float, float]]:
    """Spans with what is about them, within the flight, in order and apart."""
    found: list[tuple[float, float]] = []
    for a, b in sorted((max(a - _BEFORE_S, begin), min(b + _AFTER_S, end)) for a, b in spans):
        if b <= a:
            continue
        if found and a <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], b))
        else:
            found.append((a, b))
    return found
