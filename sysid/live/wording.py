"""What live identification says in words."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sim_vehicle.model.terms import parse_term
from sysid.live.estimators.change_detection import Change
from sysid.live.signals.air_data_ekf import AirDataError

_SURFACES = {"de": "elevator", "da": "ailerons", "dr": "rudder", "throttle": "throttle"}
# What a coefficient is to a pilot, and what may have changed it.
_MEANING = {
    "CL_alpha": ("the lift slope", ", as with ice or damage of the wing,"),
    "CD_0": ("the drag at no lift", ", as with ice, damage or something that hangs out,"),
    "Cm_alpha": ("the stability in pitch", ", as with a moved centre of gravity or ice,"),
    "Cm_q": ("the damping in pitch", ""),
    "Cn_beta": ("the stability in yaw", ", as with damage of the fin or a moved centre of gravity,"),
    "Cl_beta": ("the dihedral effect", ""),
    "Cl_p": ("the damping in roll", ", as with damage of the wing,"),
    "Cn_r": ("the damping in yaw", ", as with damage of the fin,"),
}
# An error that a pilot should know of, by its sensor.
_WORTH_TELLING = {
    "airspeed_scale": 0.03,
    "alpha_bias": 0.035,
    "beta_bias": 0.035,
    "alpha_scale": 0.1,
    "beta_scale": 0.1,
    **dict.fromkeys(("accel_bias_x", "accel_bias_y", "accel_bias_z"), 0.6),
    **dict.fromkeys(("gyro_bias_p", "gyro_bias_q", "gyro_bias_r"), 0.02),
}
# Standard errors. A flight looks at all of them again and again, so that three come by chance.
_SURE = 4.0


def change_sentence(change: Change) -> str:
    """As "elevator answers at half since 40.2 s (Cm_de 1.59 -> 0.80)"."""
    share = change.after / change.before
    numbers = f"since {change.time_s:.1f} s ({change.coefficient} {change.before:.3g} -> {change.after:.3g})"
    for factor in parse_term(change.coefficient).factors:
        if factor in _SURFACES:
            name = _SURFACES[factor]
            verb, verbs = ("answer", "do") if name.endswith("s") else ("answers", "does")
            if abs(share) < 0.15:
                return f"{name} {verbs} not answer {numbers}"
            if 0.4 <= share <= 0.6:
                return f"{name} {verb} at half {numbers}"
            return f"{name} {verb} at {share:.0%} {numbers}"
    meaning, why = _MEANING.get(change.coefficient, (f"{change.coefficient} of the aircraft", ""))
    return f"{meaning} is at {share:.0%}{why} {numbers}"


def sensor_warnings(errors: Mapping[str, AirDataError]) -> list[str]:
    """A line for each sensor error that is beyond doubt and worth telling."""
    told = []
    for name, limit in _WORTH_TELLING.items():
        error = errors.get(name)
        if error is None or abs(error.value) < max(limit, _SURE * error.std):
            continue
        told.append(_sentence(name, error.value))
    return told


def _sentence(name: str, value: float) -> str:
    way = "high" if value > 0.0 else "low"
    sensor = name.partition("_")[0]
    if name == "airspeed_scale":
        return f"airspeed reads {abs(value):.0%} {way}: check the pitot tube and its calibration"
    if name in ("alpha_bias", "beta_bias"):
        return f"the {sensor} vane reads {abs(np.degrees(value)):.1f} deg {way}: check its mounting"
    if name in ("alpha_scale", "beta_scale"):
        return f"the {sensor} vane reads {abs(value):.0%} {way}: check its calibration"
    axis = name[-1]
    if name.startswith("gyro"):
        return f"gyro {axis} is off by {np.degrees(value):+.1f} deg/s: calibrate it at rest"
    return f"accelerometer {axis} is off by {value:+.2f} m/s^2: calibrate it at rest"
