"""The loops that an autopilot closes about roll and pitch, by its parameters: each gain's part of the open loop.

ArduPilot Plane 4.1 and later: AP_RollController and AP_PitchController about AC_PID, with rates in rad/s, demands of 45
notional degrees for the whole travel, gains scaled by the square of SCALING_SPEED over airspeed, feedforward by it
itself. PX4 1.12 and later: FixedwingAttitudeControl and FixedwingRateControl, scaled by FW_AIRSPD_TRIM in the same way.
Both feed the error of the angle over a time constant to the rate as its demand. The loop is cut at the demand to the
servo, as if nothing saturated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from gcs.errors import SettingsError
from gcs.tuning.proposals import SCALING_SPEED, positive
from sysid.arrays import Array
from sysid.identification.linear_model import Complex, StateSpace

# Demand, as a share of the travel, of an output in rad of ArduPilot's PID.
_NOTIONAL = math.degrees(1.0) / 45.0
# Where the log does not say: ArduPilot's own defaults, and PX4's. Gains must be there; PX4 before 1.13 has no D.
_DEFAULTS = {
    "ardupilot": {"TCONST": 0.5, "FLTT": 3.0, "FLTE": 0.0, "FLTD": 12.0},
    "px4": {"TCONST": 0.4, "FLTT": 0.0, "FLTE": 0.0, "FLTD": 30.0},
}
_NEEDED = {"ardupilot": ("P", "I", "D", "FF"), "px4": ("P", "I", "FF")}
_OF_RATE = ("P", "I", "D", "FF")
_FILTERS = ("FLTT", "FLTE", "FLTD")


def _names(tconst: str, rate: str, keys: tuple[str, ...], **others: str) -> dict[str, str]:
    return {"TCONST": tconst, **{key: f"{rate}_{key}" for key in keys}, **others}


_NAMES = {
    "ardupilot": {
        "roll": _names("RLL2SRV_TCONST", "RLL_RATE", (*_OF_RATE, *_FILTERS)),
        "pitch": _names("PTCH2SRV_TCONST", "PTCH_RATE", (*_OF_RATE, *_FILTERS)),
    },
    "px4": {
        "roll": _names("FW_R_TC", "FW_RR", _OF_RATE, FLTD="IMU_DGYRO_CUTOFF"),
        "pitch": _names("FW_P_TC", "FW_PR", _OF_RATE, FLTD="IMU_DGYRO_CUTOFF"),
    },
}
# Parameters of the speed that gains are scaled to, of the gyros' low pass, Hz, and of the loop's rate, Hz; and what
# those are where the log does not say.
_SPEED = {"ardupilot": ("SCALING_SPEED", SCALING_SPEED), "px4": ("FW_AIRSPD_TRIM", SCALING_SPEED)}
_GYRO = {"ardupilot": ("INS_GYRO_FILTER", 20.0), "px4": ("IMU_GYRO_CUTOFF", 40.0)}
_RATE = {"ardupilot": ("SCHED_LOOP_RATE", 50.0), "px4": ("IMU_GYRO_RATEMAX", 400.0)}
AXES = {"roll": ("da", "p", "phi"), "pitch": ("de", "q", "theta")}
GAINS = _OF_RATE


class NoGainsError(SettingsError):
    """Parameters hold no gains of a rate loop."""


@dataclass(frozen=True)
class Controller:
    """One axis of an autopilot. gains: of GAINS. scaler: speed that gains are scaled to over that flown, equivalent;
    eas2tas: true over equivalent airspeed. Filters in Hz, 0 for none; tconst, hold: s, the latter between commands.
    """

    autopilot: str
    names: Mapping[str, str]
    gains: Mapping[str, float]
    tconst: float
    target_hz: float
    error_hz: float
    derivative_hz: float
    gyro_hz: float
    hold: float
    scaler: float
    eas2tas: float


def autopilot_of(now: Mapping[str, float]) -> str:
    """Whose parameters those are. Raises NoGainsError where they hold none of a rate loop."""
    for autopilot, axes in _NAMES.items():
        if axes["roll"]["P"] in now or axes["pitch"]["P"] in now:
            return autopilot
    raise NoGainsError("the recording holds no gains of the rate loops (RLL_RATE_P, FW_RR_P)")


def controller(axis: str, now: Mapping[str, float], airspeed: float, eas2tas: float) -> Controller | str:
    """That of roll or pitch, or why it is not known. airspeed: equivalent, m/s."""
    autopilot = autopilot_of(now)
    names, usual = _NAMES[autopilot][axis], _DEFAULTS[autopilot]
    if missing := [names[key] for key in _NEEDED[autopilot] if names[key] not in now]:
        return f"the recording does not hold {', '.join(missing)}"
    value = {key: now.get(names.get(key, ""), one) for key, one in usual.items()}
    speed, gyro, rate = (positive(now, *one[autopilot]) for one in (_SPEED, _GYRO, _RATE))
    scaled = autopilot == "ardupilot" or now.get("FW_ARSP_SCALE_EN", 1.0) != 0.0
    return Controller(
        autopilot, names, {key: now.get(names[key], 0.0) for key in GAINS}, max(value["TCONST"], 0.05), value["FLTT"],
        value["FLTE"], value["FLTD"], gyro, 1.0 / rate, speed / airspeed if scaled else 1.0, eas2tas,
    )  # fmt: skip


def along(frequency_hz: Array) -> Complex:
    """(N,) rad/s on the imaginary axis."""
    return np.asarray(2j * math.pi * frequency_hz, dtype=np.complex128)


def low_pass(s: Complex, cutoff_hz: float) -> Complex:
    """(N,) of first order; 1 for a cutoff of 0."""
    return np.asarray(np.ones_like(s) if cutoff_hz <= 0.0 else 1.0 / (1.0 + s / (2.0 * math.pi * cutoff_hz)))


def butterworth(s: Complex, cutoff_hz: float) -> Complex:
    """(N,) of second order, as both autopilots filter their gyros; 1 for a cutoff of 0."""
    if cutoff_hz <= 0.0:
        return np.ones_like(s)
    at = s / (2.0 * math.pi * cutoff_hz)
    return np.asarray(1.0 / (1.0 + math.sqrt(2.0) * at + at * at))


@dataclass(frozen=True)
class OpenLoop:
    """The open loop along a path. s: (N,) rad/s. parts: gain's name -> (N,) what it adds. forward: (N,) from
    the angle that is demanded to the angle, the loop open.
    """

    s: Complex
    parts: Mapping[str, Complex]
    forward: Complex

    @property
    def frequency_hz(self) -> Array:
        """(N,) of a path along the imaginary axis."""
        return np.asarray(self.s.imag / (2.0 * math.pi))

    @property
    def total(self) -> Complex:
        """(N,) return ratio."""
        return np.asarray(sum(self.parts.values(), np.zeros(self.s.size, dtype=np.complex128)))


def open_loop(
    axis: str,
    system: StateSpace,
    made: Controller,
    travel: float,
    delay: float,
    lag: float,
    s: Complex,
) -> OpenLoop:
    """Of one axis. travel: deflection of a full demand, rad, its sign that of a demand to roll right or pitch up.

    delay, lag: of the servo, s. s: (N,) rad/s.
    """
    source, rate, angle = AXES[axis]
    frequency_hz = s / (2j * math.pi)
    servo = travel * np.exp(-s * (delay + 0.5 * made.hold)) / (1.0 + lag * s)
    turning: Complex = servo * system.response(source, rate, frequency_hz) * butterworth(s, made.gyro_hz)
    turned: Complex = servo * system.response(source, angle, frequency_hz)
    unit = _NOTIONAL if made.autopilot == "ardupilot" else 1.0
    shapes: dict[str, Callable[[Complex], Complex]] = {
        "P": np.ones_like, "I": lambda s: 1.0 / s, "D": lambda s: s * low_pass(s, made.derivative_hz),
    }  # fmt: skip
    demand: Complex = np.asarray(low_pass(s, made.target_hz) * turned / made.tconst)
    steady = made.scaler / made.eas2tas if made.autopilot == "ardupilot" else made.scaler
    parts: dict[str, Complex] = {}
    forward: Complex = np.zeros(s.size, dtype=np.complex128)
    for name, shape in shapes.items():
        by: Complex = unit * made.scaler**2 * made.gains[name] * low_pass(s, made.error_hz) * shape(s)
        # PX4 takes the derivative of the measured rate alone.
        of_demand = 0.0 if name == "D" and made.autopilot == "px4" else 1.0
        parts[name] = by * (turning + of_demand * demand)
        forward += of_demand * by * demand
    parts["FF"] = unit * steady * made.gains["FF"] * demand
    return OpenLoop(s, parts, forward + parts["FF"])
