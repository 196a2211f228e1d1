"""The noise of every sensor in a recording at rest, as JSON of schema noise/1 and as a table."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from gcs.errors import SignalMapError
from gcs.flights.signals import extract
from gcs.recording.reader import Recording
from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.second_sensors import SECOND_SENSORS
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.errors import SignalError
from sysid.signals.flight import Signal
from sysid.signals.static_noise import SensorNoise, sensor_noise

# Key under [sensors] of the vehicle file -> the signals whose noise it states.
SENSORS = {
    "accelerometer": ("ax", "ay", "az"),
    "gyro": ("p", "q", "r"),
    "attitude": ("phi", "theta", "psi"),
    "alpha_vane": ("alpha",),
    "beta_vane": ("beta",),
    **{one.key: (name,) for name, one in SECOND_SENSORS.items()},
    "airspeed": ("airspeed",),
    "thrust": ("thrust",),
    "gps": ("vn", "ve", "vd"),
}
OTHERS = ("differential_pressure", "static_pressure", "temperature", "altitude", "height", "rpm")
ANALOGUE = tuple(f"adc{number}" for number in range(16))
ANGLES = ("phi", "psi")  # which may wrap
_FILTERED = ("ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT")
_SLOW_M_S = 5.0  # below it an airspeed is the root of a pressure that is nothing but noise
_MOVING_RAD_S = 0.05
_MOVING_M_S = 1.0
# What a motor that starts or a take-off run changes: by so many times the scatter within a twentieth of the recording.
_STEADY = ("ax", "ay", "az", "airspeed", "differential_pressure", "thrust", "rpm")
_UNSTEADY, _PIECES, _PIECE_LEAST = 5.0, 20, 5


def noise_of_recording(
    path: Path, vehicle: Vehicle, *, start: float | None = None, stop: float | None = None, system: int | None = None
) -> dict[str, Any]:
    """Noise of every sensor of one recording, MCAP. start, stop: s from the first stamp.

    Raises SignalMapError or RecordingError in one line; what a single signal does not show is in `refused`.
    """
    flight = extract(Recording(path), vehicle, system)
    names = [name for group in SENSORS.values() for name in group]
    signals = {
        name: _cut(flight.signals[name], start, stop) for name in (*names, *OTHERS, *ANALOGUE) if name in flight.signals
    }
    found: dict[str, SensorNoise] = {}
    refused = []
    for name, signal in signals.items():
        try:
            found[name] = sensor_noise(_unwrapped(signal) if name in ANGLES else signal)
        except SignalError as error:
            refused.append({"name": name, "reason": str(error)})
    if "airspeed" in found and found["airspeed"].mean < _SLOW_M_S:
        del found["airspeed"]
        reason = "at rest it is the root of a pressure near 0, which says nothing of its noise in flight"
        refused.append({"name": "airspeed", "reason": f"{reason}; see differential_pressure"})
    moved = _movement(found, signals)
    filtered = [name for name, signal in signals.items() if name in found and signal.source.split(".")[0] in _FILTERED]
    if not found:
        reason = refused[0]["reason"] if refused else "it holds no signal of a sensor"
        raise SignalMapError(f"{path}: no noise can be estimated: {reason}")
    return {
        "schema": "noise/1",
        "file": path.name,
        "signals": {name: _to_json(noise) for name, noise in found.items()},
        "vehicle_file": {} if moved else _vehicle_file(found, vehicle),
        "refused": refused,
        "warnings": [*moved, *_estimates(filtered), *flight.warnings],
    }


def _cut(signal: Signal, start: float | None, stop: float | None) -> Signal:
    low = -math.inf if start is None else start
    high = math.inf if stop is None else stop
    inside = (signal.time_s >= low) & (signal.time_s <= high)
    return Signal(signal.time_s[inside], signal.values[inside], signal.unit, signal.source)


def _unwrapped(signal: Signal) -> Signal:
    known = np.isfinite(signal.values)
    values = signal.values.copy()
    values[known] = np.unwrap(values[known])
    return Signal(signal.time_s, values, signal.unit, signal.source)


def _vehicle_file(found: dict[str, SensorNoise], vehicle: Vehicle) -> dict[str, float]:
    """Noise of one sample of each sensor; of airspeed at the vehicle's speed, from that of its pressure."""
    noise = {key: value for key, group in SENSORS.items() if (value := _sensor_noise(found, group))}
    speed = vehicle.flight.airspeed
    if "differential_pressure" in found and math.isfinite(speed):
        noise["airspeed"] = found["differential_pressure"].sample_std / (SEA_LEVEL_DENSITY * speed)
    return noise


def _estimates(names: list[str]) -> list[str]:
    if not names:
        return []
    return [f"{', '.join(names)}: a filter's estimates, no sensor's readings; in flight they are noisier than at rest"]


def _sensor_noise(found: dict[str, SensorNoise], group: tuple[str, ...]) -> float | None:
    """Standard deviation of one sample over the axes of a sensor."""
    squares = [found[name].sample_std ** 2 for name in group if name in found]
    return math.sqrt(float(np.mean(squares))) if squares else None


def _movement(found: dict[str, SensorNoise], signals: dict[str, Signal]) -> list[str]:
    """What says that the aircraft was not at rest, or its motor not off."""
    limits = dict.fromkeys(("p", "q", "r"), _MOVING_RAD_S) | dict.fromkeys(("vn", "ve", "vd"), _MOVING_M_S)
    moving = [name for name, limit in limits.items() if name in found and _spread(found[name]) > limit]
    moving += [name for name in _STEADY if name in found and _is_unsteady(signals[name], found[name].quantisation)]
    if not moving:
        return []
    text = "the aircraft was not at rest or its motor not off, so the noise is too large for a vehicle file"
    return [f"{', '.join(moving)} moved: {text}; give the part at rest by --from and --to"]


def _is_unsteady(signal: Signal, step: float | None) -> bool:
    """Whether the whole scatters far more than its pieces do; step: of the reading, below which nothing is known."""
    values = signal.values[np.isfinite(signal.values)]
    if values.size < _PIECES * _PIECE_LEAST:
        return False
    within = float(np.median([np.std(piece) for piece in np.array_split(values, _PIECES)]))
    return float(np.std(values)) > _UNSTEADY * max(within, step or 0.0)


def _spread(noise: SensorNoise) -> float:
    """RMS of a signal's motion, the longest-lasting one included: Allan deviations of all octaves, put together."""
    return float(np.sqrt(np.sum(noise.allan_deviation**2)))


def _to_json(noise: SensorNoise) -> dict[str, Any]:
    return {
        "unit": noise.unit,
        "rate_hz": noise.rate_hz,
        "duration_s": noise.duration_s,
        "samples": noise.samples,
        "mean": noise.mean,
        "noise": noise.sample_std,
        "white": noise.white.to_json(),
        "bias_instability": noise.bias_instability.to_json(),
        "rate_random_walk": noise.rate_random_walk.to_json(),
        "bandwidth_hz": noise.bandwidth_hz,
        "quantisation": noise.quantisation,
        "dead_zone": noise.dead_zone,
        "peaks": [{"frequency_hz": peak.frequency_hz, "rms": peak.rms} for peak in noise.peaks],
        "allan": {"tau_s": noise.allan_tau_s.tolist(), "deviation": noise.allan_deviation.tolist()},
    }


def noise_text(result: dict[str, Any]) -> str:
    """The result as lines for a terminal, with what to put into the vehicle file."""
    columns = ("noise", "white", "instability", "walk", "step", "dead zone")
    lines = [f"{'signal':<22} {'unit':<7}" + "".join(f"{column:>13}" for column in columns) + "  peaks, Hz (RMS)"]
    for name, entry in result["signals"].items():
        fitted = [entry[key].get("value") for key in ("white", "bias_instability", "rate_random_walk")]
        numbers = [entry["noise"], *fitted, entry["quantisation"], entry["dead_zone"]]
        peaks = ", ".join(f"{peak['frequency_hz']:.2f} ({peak['rms']:.2g})" for peak in entry["peaks"][:3])
        cells = "".join(f"{'-' if number is None else format(number, '.3g'):>13}" for number in numbers)
        lines.append(f"{name:<22} {entry['unit']:<7}{cells}  {peaks}".rstrip())
    lines += [
        "",
        "noise: 1 sigma of a sample; white: N of IEEE 952, noise / sqrt(rate) where it is white (a data sheet's",
        "one-sided density is 1.41 times that); instability: floor of the Allan deviation;",
        "walk: per s and sqrt(Hz); step: of the reading; -: none shows in this recording (--json says why).",
        "",
    ]
    if result["vehicle_file"]:
        lines.append("[sensors]  # for the vehicle file, beside each sensor's position")
    lines += [f"{key} = {{ noise = {value:.3g} }}" for key, value in result["vehicle_file"].items()]
    lines += ["", *(f"refused: {entry['name']}: {entry['reason']}" for entry in result["refused"])]
    lines += [f"warning: {warning}" for warning in result["warnings"]]
    return "\n".join(lines).rstrip()
