"""A plan as a Lua script that ArduPilot Plane flies.

The script (flight_test.lua) adds the plan's pulse widths to the servo outputs it finds in trim, by the scripting
functions `SRV_Channels:get_output_pwm_chan` and `SRV_Channels:set_output_pwm_chan_timeout` of ArduPilot's API.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import groupby
from pathlib import Path

import numpy as np

from gcs.design.pulses import PulseSchedule, pulse_schedule
from gcs.errors import SettingsError
from sim_vehicle.flight.autopilot import control_effectiveness
from sim_vehicle.flight.plant import Plant
from sim_vehicle.manoeuvres.plan import Plan
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.servo_mixing import ServoOutputs
from sim_vehicle.vehicle.vehicle_file import Vehicle

TEMPLATE = Path(__file__).resolve().parent / "flight_test.lua"
MARK = "--@SETTINGS@"
SWITCH_FUNCTION = 300  # RCn_OPTION Scripting1
MODES = {5: "FBWA", 6: "FBWB", 7: "CRUISE"}  # of Plane: what flies between the manoeuvres
LARGEST_ROLL, LARGEST_PITCH = math.radians(60.0), math.radians(45.0)
LOWEST_M = 40.0
# The weak bank hold that the simulator's autopilot keeps too while aileron and rudder are let go, rad/s^2 per rad: it
# keeps a slow spiral away. The estimate sees the servo outputs, so it does no harm there.
_BANK_STIFFNESS = 7.5
_PROBE = 0.02  # rad of aileron, for the servos' travel per radian
_LARGEST_SCRIPT = 150_000  # bytes: what fits beside the interpreter into SCR_HEAP_SIZE of usual boards
_GROUPS = (("elevator", "throttle"), ("aileron", "rudder"))


def lua_script(vehicle: Vehicle, model: Model, plan: Plan, rate_hz: float) -> str:
    """The whole script. Raises SettingsError for a plan that such a script cannot fly."""
    if any(segment.manoeuvre == "deceleration" for segment in plan.segments):
        raise SettingsError("--lua: a deceleration is flown by the autopilot's airspeed, not by a script; leave it out")
    pulses = pulse_schedule(vehicle, model, plan, rate_hz)
    settings = "\n".join(_settings(vehicle, model, plan, pulses, rate_hz))
    script = TEMPLATE.read_text(encoding="utf-8").replace(MARK, settings)
    if len(script) > _LARGEST_SCRIPT:
        raise SettingsError(
            f"--lua: the script would have {len(script)} bytes, more than an autopilot's {_LARGEST_SCRIPT}; give a "
            "shorter --duration"
        )
    return script


def _settings(vehicle: Vehicle, model: Model, plan: Plan, pulses: PulseSchedule, rate_hz: float) -> list[str]:
    ranges = {
        servo: (math.ceil(xs[0]), math.floor(xs[-1]))
        for control in vehicle.controls.values()
        for servo, xs in zip(control.servos, control.pwm, strict=True)
    }
    modes = ", ".join(f"[{number}] = true" for number in MODES)
    return [
        f"local RATE_HZ = {rate_hz:g}",
        f"local SWITCH_FUNCTION = {SWITCH_FUNCTION} -- RCn_OPTION",
        f"local MODES = {{ {modes} }} -- {', '.join(MODES.values())}",
        f"local LARGEST_ROLL, LARGEST_PITCH = {LARGEST_ROLL:.4f}, {LARGEST_PITCH:.4f} -- rad",
        f"local LOWEST_M = {LOWEST_M:g} -- above home",
        f"local END_S = {plan.duration:g}",
        "local RANGES = { -- servo output: smallest and largest us",
        *(f"   [{servo}] = {{ {low}, {high} }}," for servo, (low, high) in sorted(ranges.items())),
        "}",
        "local LEVEL = { -- servo output: us per rad of bank that keep the wings level",
        *(f"   [{servo}] = {gain:.2f}," for servo, gain in _level(vehicle, model).items()),
        "}",
        "local SEGMENTS = { -- s; offsets in us, VALUExSAMPLES",
        *(line for segment in _segments(vehicle, pulses, rate_hz) for line in segment),
        "}",
    ]


def _level(vehicle: Vehicle, model: Model) -> dict[int, float]:
    """Travel of each servo per radian of bank, us, that a weak bank hold takes back."""
    plant = Plant(vehicle, model)
    trim = plant.trim()
    roll = float(control_effectiveness(plant, trim)[1])
    if "aileron" not in vehicle.controls or abs(roll) < 1e-3:
        return {}
    outputs = ServoOutputs(vehicle)
    level = np.append(trim.command, np.zeros(len(vehicle.named_controls)))
    moved = level.copy()
    moved[1] += _PROBE
    before, after = outputs.pulses(level), outputs.pulses(moved)
    return {
        servo: (after[servo] - before[servo]) / _PROBE * _BANK_STIFFNESS / roll
        for servo in before
        if after[servo] != before[servo]
    }


def _segments(vehicle: Vehicle, pulses: PulseSchedule, rate_hz: float) -> Iterable[list[str]]:
    """Lines of each manoeuvre: from when the autopilot lets go of the servos to its end."""
    for name, begin, end in pulses.schedule.segments:
        inside = (pulses.time_s > begin - 1e-9) & (pulses.time_s < end - 1e-9)
        freed = pulses.freed & inside[:, None]
        # Controls of other names are the plan's while it moves them, and the autopilot keeps the rest.
        moved = (pulses.schedule.increments[:, 4:] != 0.0) & inside[:, None]
        active = freed.any(axis=1) | moved.any(axis=1)
        if not active.any():
            continue
        first, last = np.flatnonzero(active)[[0, -1]]
        released = [control for j, group in enumerate(_GROUPS) if freed[:, j].any() for control in group]
        released += [name for j, name in enumerate(vehicle.named_controls) if moved[:, j].any()]
        held = sorted(
            {servo for control in released if control in vehicle.controls for servo in vehicle.controls[control].servos}
        )
        offsets = {servo: pulses.pulses[servo][first : last + 1] - pulses.trim[servo] for servo in held}
        shown = {servo: values for servo, values in offsets.items() if values.any()}
        yield [
            f'   {{ name = "{name}", from = {first / rate_hz:g}, to = {(last + 1) / rate_hz:g},',
            f"     held = {{ {', '.join(map(str, held))} }},",
            "     offsets = {",
            *(f'       [{servo}] = "{_runs(values.tolist())}",' for servo, values in shown.items()),
            "     } },",
        ]


def _runs(values: list[int]) -> str:
    """Offsets with the number of samples that each lasts: 0x50 25x10 -3."""
    parts = []
    for value, run in groupby(values):
        count = len(list(run))
        parts.append(f"{value}x{count}" if count > 1 else str(value))
    return " ".join(parts)
