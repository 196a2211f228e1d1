"""What live identification says in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.live.recursive.causes import CauseFound
from sysid.live.recursive.change_detection import Change
from sysid.live.signals.air_data_ekf import AirDataError
from sysid.live.signals.sensor_failures import SensorFailure

# What moves with a coefficient, to a pilot.
_MOTION = {"CL": "lift", "CD": "drag", "CY": "side force", "Cl": "roll", "Cm": "pitch", "Cn": "yaw"}
# A cause is named from this probability on, another beside it from that on.
_NAMED, _BESIDE = 0.5, 0.1
# An error that a pilot should know of, by its sensor.
_WORTH_REPORTING = {
    "airspeed_scale": 0.03,
    "alpha_bias": 0.035,
    "beta_bias": 0.035,
    "alpha_scale": 0.1,
    "beta_scale": 0.1,
    **dict.fromkeys(("accel_bias_x", "accel_bias_y", "accel_bias_z"), 0.6),
    **dict.fromkeys(("gyro_bias_p", "gyro_bias_q", "gyro_bias_r"), 0.02),
}
_SENSORS = {
    "airspeed": "AIRSPEED", "alpha": "ALPHA VANE", "beta": "BETA VANE", "psi": "HEADING",
    "de": "ELEVATOR", "da": "AILERON", "dr": "RUDDER",
    **{rate: f"GYRO {rate.upper()}" for rate in "pqr"}, **{f"a{axis}": f"ACCEL {axis.upper()}" for axis in "xyz"},
}  # fmt: skip
# Standard errors. A flight looks at all of them again and again, so that three come by chance.
_SURE = 4.0


def change_sentence(change: Change) -> str:
    """As "the elevator: 52 % ± 6 since 40.1 s (Cm_de 1.59 -> 0.82)", of a change whose cause is not known "something
    has changed in pitch since 40.1 s (Cm_de 1.59 -> 0.82)".
    """
    numbers = f"since {change.time_s:.1f} s ({change.coefficient} {change.before:.3g} -> {change.after:.3g})"
    named = named_cause(change)
    likely = [one.cause.name for one in change.causes if one.probability > _BESIDE]
    if named is None:
        perhaps = f": perhaps {_or(likely)}" if likely else ""
        return f"something has changed in {_MOTION[change.axis]} {numbers}{perhaps}"
    others = f"; or {_or(likely[1:])}" if likely[1:] else ""
    return f"{named.cause.name}: {_size(named)} {numbers}{others}"


def change_text(change: Change) -> str:
    """The same for a text of 50 characters, as "ELEVATOR 52% +-6 since 40.1s"."""
    named = named_cause(change)
    if named is None:
        return f"{_MOTION[change.axis].upper()} CHANGED since {change.time_s:.1f}s"
    unit = named.cause.unit.replace(" of a heavy coat", "")
    size = f"{_figure(named.size, named.std)}{'' if unit == '%' else ' '}{unit}"
    return f"{named.cause.short} {size} +-{named.std:.2g} since {change.time_s:.1f}s"


def named_cause(change: Change) -> CauseFound | None:
    """The cause that a change is reported with; None where none is likely enough."""
    return change.causes[0] if change.causes and change.causes[0].probability > _NAMED else None


def _size(found: CauseFound) -> str:
    unit = found.cause.unit
    return f"{_figure(found.size, found.std)} {unit} ± {found.std:.2g}"


def _figure(value: float, std: float) -> str:
    """A value to the second figure of its standard error."""
    places = min(max(1 - int(np.floor(np.log10(std))), 0), 4) if 0.0 < std < np.inf else 2
    return f"{value:.{places}f}"


def _or(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"


def failure_sentence(failure: SensorFailure) -> str:
    """As "the alpha vane jumped by +4.0 deg since 40.2 s: check the sensor"; "from 40.2 to 45.0 s" once it is over."""
    if failure.until_s is not None:
        return f"{failure.text} from {failure.time_s:.1f} to {failure.until_s:.1f} s: check {failure.check}"
    return f"{failure.text} since {failure.time_s:.1f} s: check {failure.check}"


def failure_text(failure: SensorFailure) -> str:
    """The same for a text of 50 characters, as "AIRSPEED -2.5 m/s since 24.0s"."""
    name = _SENSORS.get(failure.signal, failure.signal.upper())
    kind = failure.name.rpartition("_")[2].upper()
    size = f"{failure.size:+.2g} {failure.unit}" if failure.unit else {"STILL": "STUCK"}.get(kind, kind)
    if failure.until_s is not None:
        return f"{name} {size} {failure.time_s:.1f}s to {failure.until_s:.1f}s"
    return f"{name} {size} since {failure.time_s:.1f}s"


def sensor_warnings(errors: Mapping[str, AirDataError]) -> list[str]:
    """A line for each sensor error that is beyond doubt and large enough to report."""
    lines = []
    for name, limit in _WORTH_REPORTING.items():
        error = errors.get(name)
        if error is None or abs(error.value) < max(limit, _SURE * error.std):
            continue
        lines.append(_sentence(name, error.value))
    return lines


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
