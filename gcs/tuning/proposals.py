"""Parameters of an autopilot that a flight says something of: what each is now, what is proposed, why, or why not.

ArduPilot: "Complete parameter list" of Plane and its rate controllers (AP_RollController, AP_PitchController); PX4:
"Parameter reference" and FixedwingRateControl. A demand of 1 (ArduPilot: 45 notional degrees) moves a surface by half
of its travel; the feedforward moves it by so much of that as a steady rate needs, at the speed that gains are scaled
to.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs.errors import SettingsError
from gcs.exports.exported import Exported
from gcs.tuning.findings import Findings, Quantity
from gcs.tuning.travel import full_travel, range_of
from sim_vehicle.vehicle.controls import OUTPUTS, PORTS, servo_pwm
from sim_vehicle.vehicle.vehicle_file import Vehicle

AUTOPILOTS = ("ardupilot", "px4")
_NOTIONAL_DEG = 45.0
# Speeds that gains are scaled to where the log does not say: ArduPilot's SCALING_SPEED, PX4's FW_AIRSPD_TRIM, m/s.
SCALING_SPEED = 15.0
# PX4's trims of the demands, beside those of the servos.
_PX4_TRIMS = {"elevator": "TRIM_PITCH", "aileron": "TRIM_ROLL", "rudder": "TRIM_YAW"}
# The slowest speed over that of the stall, as ArduPilot's documentation of AIRSPEED_MIN asks for.
_OVER_STALL = 1.2
# Half of an interval, beyond which nobody should act on a number: share of the value, us.
_WIDEST_SHARE, _WIDEST_PULSE = 0.35, 40.0
_WIDEST_RATIO = 0.08
_RATE = "a steady rate needs so much of the surface's travel"


@dataclass(frozen=True)
class Proposal:
    """A parameter. now: its value in the log, None where the log does not hold it. interval: 95 %, None where no error
    is known. refused: why nothing is proposed, "" where something is.
    """

    name: str
    now: float | None
    value: float = math.nan
    interval: tuple[float, float] | None = None
    unit: str = "1"
    reason: str = ""
    refused: str = ""

    def to_json(self) -> dict[str, Any]:
        """The entry of schema tuning/1."""
        if self.refused:
            return {"name": self.name, "now": self.now, "refused": self.refused}
        between = None if self.interval is None else list(self.interval)
        return {
            "name": self.name, "now": self.now, "value": self.value, "interval": between, "unit": self.unit,
            "reason": self.reason,
        }  # fmt: skip


def positive(now: Mapping[str, float], name: str, usual: float) -> float:
    """A parameter that must be above 0, else what is usual."""
    value = now.get(name, usual)
    return value if value > 0.0 else usual


class _Parameters:
    """Those of the log, and what is proposed of them."""

    def __init__(self, now: Mapping[str, float], found: Findings) -> None:
        self.now, self.found = now, found
        self.proposals: list[Proposal] = []

    def named(self, *names: str) -> str:
        """The first of a parameter's names, by the autopilot's version, that the log holds; else the newest."""
        return next((name for name in names if name in self.now), names[0])

    def propose(
        self,
        name: str,
        of: str,
        function: Callable[[float], float],
        unit: str,
        reason: str,
        widest: float | None = None,
        digits: int = 4,
    ) -> None:
        """A parameter that is a function of a quantity. widest: half of the widest interval that is one to act on, in
        the parameter's unit; None takes a share of its value.
        """
        found = self.found.quantities.get(of)
        if found is None:
            self.refuse(name, self.found.refused.get(of, "the flight does not show it"))
            return
        self.take(name, found.map(function, unit), reason, widest, digits)

    def take(self, name: str, found: Quantity, reason: str, widest: float | None, digits: int = 4) -> None:
        """A parameter that is a quantity."""
        ends = found.interval
        most = _WIDEST_SHARE * abs(found.value) if widest is None else widest
        if ends is not None and (ends[1] - ends[0]) / 2.0 > most:
            unit = "" if found.unit == "1" else f" {found.unit}"
            self.refuse(name, f"the flight leaves it between {ends[0]:.3g} and {ends[1]:.3g}{unit} (95 %)")
            return
        value = round(found.value, digits)
        self.proposals.append(Proposal(name, self.now.get(name), value, ends, found.unit, reason))

    def refuse(self, name: str, why: str) -> None:
        """Nothing is proposed."""
        self.proposals.append(Proposal(name, self.now.get(name), refused=why))


def proposals(
    autopilot: str, found: Findings, model: Exported, stall: Quantity | str, now: Mapping[str, float]
) -> list[Proposal]:
    """Every parameter that a flight can say something of. stall: equivalent airspeed of the stall, m/s, or why it is
    not known. now: the autopilot's parameters. Raises SettingsError for another autopilot.
    """
    if autopilot not in AUTOPILOTS:
        raise SettingsError(f"--for {autopilot}: one of {', '.join(AUTOPILOTS)}")
    parameters = _Parameters(now, found)
    (_ardupilot if autopilot == "ardupilot" else _px4)(parameters, model.vehicle, stall)
    return parameters.proposals


def _ardupilot(parameters: _Parameters, vehicle: Vehicle, stall: Quantity | str) -> None:
    now, found = parameters.now, parameters.found
    _air_data(parameters, parameters.named("ARSPD_RATIO"), 2.0, now.get("ARSPD_RATIO"))
    for axis, name in (("roll", "AHRS_TRIM_X"), ("pitch", "AHRS_TRIM_Y")):
        _level(parameters, name, axis)
    _servo_trims(parameters, vehicle, "ardupilot")
    speed = positive(now, "SCALING_SPEED", SCALING_SPEED)
    for name, of, control in (
        ("RLL_RATE_FF", "roll_deflection", "aileron"),
        ("PTCH_RATE_FF", "pitch_deflection", "elevator"),
    ):
        full = full_travel(vehicle, control, "ardupilot", now)
        _feedforward(parameters, name, of, full, math.radians(_NOTIONAL_DEG) / speed, f"SCALING_SPEED {speed:g} m/s")
    level = f"level flight at the {found.airspeed:.1f} m/s flown"
    parameters.propose("TRIM_THROTTLE", "throttle", lambda k: 100.0 * k, "%", f"throttle of {level}", 10.0, 0)
    parameters.propose(
        "TECS_CLMB_MAX", "climb", float, "m/s", f"climb at {found.most:.0%} throttle at {found.airspeed:.1f} m/s"
    )
    parameters.propose("TECS_SINK_MIN", "sink", float, "m/s", f"sink in a glide at {found.airspeed:.1f} m/s")
    _speeds(parameters, stall, parameters.named("AIRSPEED_MIN", "ARSPD_FBW_MIN"), "AIRSPEED_STALL")
    bank = parameters.named("ROLL_LIMIT_DEG", "LIM_ROLL_CD")
    _bank(parameters, stall, bank, 100.0 if bank.endswith("_CD") else 1.0)
    pitch = parameters.named("PTCH_LIM_MAX_DEG", "LIM_PITCH_MAX")
    _steepest(parameters, pitch, 1.0 if pitch.endswith("_DEG") else 100.0)


def _px4(parameters: _Parameters, vehicle: Vehicle, stall: Quantity | str) -> None:
    now, found = parameters.now, parameters.found
    scale = parameters.named("ASPD_SCALE_1", "ASPD_SCALE")
    _air_data(parameters, scale, 1.0, now.get(scale))
    for axis, name in (("roll", "SENS_BOARD_X_OFF"), ("pitch", "SENS_BOARD_Y_OFF")):
        _level(parameters, name, axis)
    _servo_trims(parameters, vehicle, "px4")
    scaled = now.get("FW_ARSP_SCALE_EN", 1.0) != 0.0
    trim = positive(now, "FW_AIRSPD_TRIM", SCALING_SPEED)
    speed = trim * found.eas2tas if scaled else found.airspeed
    at = f"FW_AIRSPD_TRIM {trim:g} m/s" if scaled else f"the {found.airspeed:.1f} m/s flown, for it is not scaled"
    for name, of, control in (
        ("FW_RR_FF", "roll_deflection", "aileron"),
        ("FW_PR_FF", "pitch_deflection", "elevator"),
    ):
        _feedforward(parameters, name, of, full_travel(vehicle, control, "px4", now), 1.0 / speed, at)
    level = f"level flight at the {found.airspeed:.1f} m/s flown"
    parameters.propose("FW_THR_TRIM", "throttle", float, "1", f"throttle of {level}", 0.1, 3)
    parameters.propose(
        "FW_T_CLMB_MAX", "climb", float, "m/s", f"climb at {found.most:.0%} throttle at {found.airspeed:.1f} m/s"
    )
    parameters.propose("FW_T_SINK_MIN", "sink", float, "m/s", f"sink in a glide at {found.airspeed:.1f} m/s")
    _speeds(parameters, stall, "FW_AIRSPD_MIN", "FW_AIRSPD_STALL")
    _bank(parameters, stall, "FW_R_LIM", 1.0)
    _steepest(parameters, "FW_P_LIM_MAX", 1.0)


def _air_data(parameters: _Parameters, name: str, power: float, now: float | None) -> None:
    """The factor of the pitot tube's reading, which the airspeed goes with to the power of 1 / `power`."""
    if now is None or not now > 0.0:
        parameters.refuse(name, "the log does not hold what it is now, which the proposal is a multiple of")
        return
    found = parameters.found.quantities.get("airspeed_reading")
    share = "" if found is None else f"airspeed reads {100.0 * (found.value - 1.0):+.1f} % of what it is"
    widest = _WIDEST_RATIO * now
    parameters.propose(name, "airspeed_reading", lambda reads: now / reads**power, "1", share, widest)


def _level(parameters: _Parameters, name: str, axis: str) -> None:
    """How the board is turned against the aircraft is not in the flight: IMU and attitude are turned alike."""
    found = parameters.found.quantities.get(f"{axis}_reading")
    reads = "" if found is None else f" ({axis} reads {math.degrees(found.value):+.2f} deg against the accelerometers)"
    parameters.refuse(name, f"a turned board turns IMU and attitude alike, so that no flight shows it: level it{reads}")


def _servo_trims(parameters: _Parameters, vehicle: Vehicle, autopilot: str) -> None:
    """Pulses at which the surfaces hold level flight, so that a demand of nothing does."""
    found = parameters.found
    controls = {
        key: one
        for key, one in vehicle.controls.items()
        if key != "throttle" and one.servos and one.signal != "position"
    }
    axes = {"elevator": "de", "aileron": "da", "rudder": "dr"}
    shared = {servo for key, one in controls.items() if key not in axes for servo in one.servos}
    controls = {key: one for key, one in controls.items() if key in axes}
    for servo in sorted({servo for one in controls.values() for servo in one.servos}):
        # A servo of two surfaces is moved by both.
        own = [key for key, one in controls.items() if servo in one.servos]
        name = f"SERVO{servo}_TRIM" if autopilot == "ardupilot" else _px4_centre(servo)
        missing = [axes[key] for key in own if axes[key] not in found.quantities]
        beside = [one for key in own if parameters.now.get(one := _PX4_TRIMS[key], 0.0) != 0.0]
        if servo in shared:
            parameters.refuse(name, "it moves a control beside these three too, whose trim the flight does not show")
            continue
        if autopilot == "px4" and servo > 2 * OUTPUTS:
            parameters.refuse(name, "a servo on UAVCAN has no centre among PX4's parameters: set it in the servo")
            continue
        if missing:
            parameters.refuse(name, found.refused.get(missing[0], "the flight does not show it"))
            continue
        if beside:
            parameters.refuse(
                name, f"{', '.join(beside)} trims it too: set that to 0 and fly again, or it counts twice"
            )
            continue
        trims = {key: found.quantities[axes[key]] for key in controls if axes[key] in found.quantities}
        held = {key: one.value for key, one in trims.items()}
        drawn = np.array([one.drawn for one in trims.values()]).T
        values = [servo_pwm(controls, dict(zip(trims, row.tolist(), strict=True)))[servo] for row in drawn]
        why = f"{' and '.join(own)} of level flight at the {found.airspeed:.1f} m/s flown"
        best = servo_pwm(controls, held)[servo]
        low, high = range_of(servo, autopilot, parameters.now) or (-math.inf, math.inf)
        if not low < best < high:
            parameters.refuse(name, f"level flight needs {best:.0f} us, beyond its range of {low:.0f} to {high:.0f} us")
            continue
        parameters.take(name, Quantity(best, np.array(values), "us"), why, _WIDEST_PULSE, 0)


def _px4_centre(servo: int) -> str:
    port, place = divmod(servo - 1, OUTPUTS)
    return f"PWM_{PORTS[port]}_CENT{place + 1}"


def _feedforward(parameters: _Parameters, name: str, of: str, full: float | str, gain: float, at: str) -> None:
    """gain: of the deflection times speed, over the full travel, s."""
    if isinstance(full, str):
        parameters.refuse(name, full)
        return
    parameters.propose(name, of, lambda deflection: gain / full * deflection, "s", f"{_RATE}, at {at}")


def _speeds(parameters: _Parameters, stall: Quantity | str, slowest: str, stalling: str) -> None:
    if isinstance(stall, str):
        parameters.refuse(slowest, stall)
        parameters.refuse(stalling, stall)
        return
    why = f"{_OVER_STALL:g} times the stall speed"
    parameters.take(slowest, stall.map(lambda speed: _OVER_STALL * speed, "m/s"), why, None, 1)
    parameters.take(stalling, stall, "the stall that was flown", None, 1)


def _bank(parameters: _Parameters, stall: Quantity | str, name: str, factor: float) -> None:
    """The level turn at the speed flown that is as far from the stall as the slowest level flight should be."""
    if isinstance(stall, str):
        parameters.refuse(name, stall)
        return
    speed = parameters.found.equivalent_airspeed

    def bank(slow: float) -> float:
        load = (speed / (_OVER_STALL * slow)) ** 2
        return factor * math.degrees(math.acos(1.0 / load)) if load > 1.0 else math.nan

    if math.isnan(bank(stall.value)):
        parameters.refuse(name, f"the {speed:.1f} m/s flown are less than {_OVER_STALL:g} times the stall speed")
        return
    unit = "deg" if factor == 1.0 else "cdeg"
    why = f"the level turn at {speed:.1f} m/s that keeps {_OVER_STALL:g} times its stall speed"
    parameters.take(name, stall.map(bank, unit), why, None, 0)


def _steepest(parameters: _Parameters, name: str, factor: float) -> None:
    """Pitch in the climb at full throttle at the speed flown: angle of the path and of attack."""
    climb, alpha = (parameters.found.quantities.get(one) for one in ("climb", "alpha"))
    if climb is None or alpha is None:
        lacking = "climb" if climb is None else "alpha"
        parameters.refuse(name, parameters.found.refused.get(lacking, "the flight does not show it"))
        return
    speed = parameters.found.airspeed

    def pitch(up: float, attack: float) -> float:
        return factor * math.degrees(math.asin(min(max(up / speed, -1.0), 1.0)) + attack)

    values = [pitch(up, attack) for up, attack in zip(climb.drawn.tolist(), alpha.drawn.tolist(), strict=True)]
    unit = "deg" if factor == 1.0 else "cdeg"
    found = Quantity(pitch(climb.value, alpha.value), np.array(values), unit)
    parameters.take(name, found, f"pitch of the steepest climb that lasts, at {speed:.1f} m/s", None, 0)
