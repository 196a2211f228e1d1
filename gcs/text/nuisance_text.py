"""What is estimated beside coefficients, and what was taken as known, in plain words and units one thinks in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

_WORDS = {
    "servo_delay": ("servos, delay", "ms", 1e3), "servo_lag": ("servos, lag", "ms", 1e3),
    "command_clock": ("commands, stamps late by", "ms", 1e3),
    "servo_backlash": ("servos, half backlash", "deg", 180.0 / math.pi),
    "command_rounding": ("commands, share of their rounding that was flown", "%", 100.0),
    "airspeed_error": ("airspeed, error of its reading", "%", 100.0),
    "airspeed_alpha": ("airspeed, position error", "1/rad", 1.0), "airspeed_lag": ("airspeed, lag", "ms", 1e3),
    "alpha_scale": ("alpha vane, scale", "1", 1.0), "beta_scale": ("beta vane, scale", "1", 1.0),
    "vane_clock": ("vane, stamps late by", "ms", 1e3),
    "vane_period": ("vane, period of its swing", "ms", 1e3),
    "vane_log_damping": ("vane, ln(damping ratio)", "1", 1.0),
    "accelerometer_tilt": ("accelerometers, tilt in pitch", "deg", 180.0 / math.pi),
    "gyro_tilt": ("gyros, roll read as yaw", "%", 100.0),
    "thrust_error": ("thrust, error of its reading", "%", 100.0),
    "moving_mass": ("mass that hangs on the thrust sensor", "g", 1e3),
    "thrust_arm": ("thrust line below the centre of gravity", "mm", 1e3),
    "product_inertia": ("product of inertia beyond the file's", "g m^2", 1e3),
    "theta_offset": ("pitch angle, offset", "deg", 180.0 / math.pi),
    "phi_offset": ("roll angle, offset", "deg", 180.0 / math.pi),
    "alpha_offset": ("angle of attack as measured, offset", "deg", 180.0 / math.pi),
    **{f"{name}_zero": (f"accelerometer {name[1]} at zero", "m/s^2", 1.0) for name in ("ax", "ay", "az")},
    **{f"{name}_zero": (f"gyro {name} at zero", "deg/s", 180.0 / math.pi) for name in ("p", "q", "r")},
    **{f"{name}_zero": (f"{name} vane at zero", "deg", 180.0 / math.pi) for name in ("alpha", "beta")},
}  # fmt: skip


# An error that the vehicle file states ends so in `systematic`; the others are usual ones.
STATED = "_std"


def unknown_words(entry: Mapping[str, Any]) -> tuple[str, str, float]:
    """Words and unit for an entry of a result's `nuisances`, and the factor from SI to that unit."""
    words, unit, factor = _WORDS.get(entry["name"], (entry["name"], entry["unit"], 1.0))
    return f"{words} ({entry['flight']})" if entry.get("flight") else words, unit, factor
