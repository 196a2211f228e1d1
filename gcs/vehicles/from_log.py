"""Controls of an aircraft by what the parameters of its autopilot say."""

from __future__ import annotations

import math
from pathlib import Path

from gcs.catalogue.intake import vehicle_of
from gcs.errors import VehicleError
from gcs.flights.autopilot_settings import filled, parameters_of
from gcs.flights.streams import sender_of
from gcs.recording.reader import Recording
from gcs.vehicles.document import ControlAnswer, ServoAnswer
from sim_vehicle.vehicle.controls import CONTROL_NAMES
from sim_vehicle.vehicle.vehicle_file import Vehicle


def controls_in(path: Path, log: str) -> dict[str, ControlAnswer]:
    """By name, each with the travel that is usual, marked as a guess: no parameter says how far a surface moves.

    log: the name by which the user knows the recording.
    Raises RecordingError, and VehicleError where the recording holds no such parameters.
    """
    recording = Recording(path)
    system = vehicle_of(recording)
    parameters = {} if system is None else parameters_of(recording, system)[0]
    found = filled(Vehicle.unknown(), parameters).controls
    if not found:
        raise VehicleError(
            f"{log} ({sender_of(recording, system)}): no parameter in it says which servo moves what (SERVOn_FUNCTION,"
            " PWM_MAIN_FUNCn): give each control as --control elevator=2:1100,1500,1900:-20,0,22"
        )
    answers = {}
    for name, control in found.items():
        factor = 100.0 if name == "throttle" else math.degrees(1.0) if name in CONTROL_NAMES else 1.0
        servos = tuple(
            ServoAnswer(servo, xs, tuple(round(factor * y, 2) for y in ys), weight)
            for servo, xs, ys, weight in zip(control.servos, control.pwm, control.deflection, control.mix, strict=True)
        )
        answers[name] = ControlAnswer(servos, control.signal, control.gain_std or None)
    return answers
