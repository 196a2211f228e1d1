"""Options of `gcs vehicle`, and the questions it asks where they are left out."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.errors import SettingsError
from gcs.options.outputs import NEW, add_output

if TYPE_CHECKING:
    from gcs.vehicles.document import Answers, ControlAnswer
    from gcs.vehicles.inertia import Measured

# What is asked for: option, what it is called, and its unit.
_ASKED = (("mass", "Mass, ready to fly, on a scale", "kg"), ("span", "Span, tip to tip", "m"))
_INERTIA = ("Ixx", "Iyy", "Izz", "Ixz")


def add_new_arguments(parser: argparse.ArgumentParser) -> None:
    """What one measures of an aircraft, with its standard deviation behind a comma."""
    add = parser.add_argument
    add_output(parser, "-o", "--output", metavar="FILE.toml", kind=NEW, required=True)
    add("--name", help="name of the aircraft; without it that of the file")
    add("--mass", metavar="KG[,STD]")
    add("--span", metavar="M", type=float)
    add("--area", metavar="M2", type=float, help="wing area; without it span times chord")
    add("--chord", metavar="M", type=float, help="mean chord; without it area over span")
    add("--speed", metavar="M/S", type=float, help="airspeed in cruise")
    add("--inertia", metavar="IXX,IYY,IZZ[,IXZ]", help="kg m^2; without it those usual for span and mass")
    add("--control", metavar="NAME=SERVO:US,US,…:DEG,DEG,…", action="append", default=[],
        help="as elevator=2:1100,1500,1900:-20,0,22 (throttle: %%)")  # fmt: skip
    add("--thrust", metavar="N", type=float, help="largest static thrust")
    add("--propeller", metavar="M", type=float, help="its diameter")
    add("--moving-mass", metavar="KG", type=float, help="motor and propeller, where they hang on a thrust sensor")
    add("--log", metavar="FILE", type=Path, help="take the controls from the autopilot's parameters in this log")


def add_estimate_arguments(parser: argparse.ArgumentParser) -> None:
    """What one measures of a pendulum."""
    add = parser.add_argument
    add(
        "way",
        choices=("bifilar", "swing", "usual"),
        help="hung on two wires and turned about the vertical; swung about an axis; usual for span and mass",
    )
    add("--axis", choices=_INERTIA[:3], default="Iyy", help="which moment of inertia it was (usual: all)")
    add("--mass", metavar="KG[,STD]", required=True)
    add("--length", metavar="M[,STD]", help="of the wires; swing: from the axis to the centre of gravity")
    add("--spacing", metavar="M[,STD]", help="between the wires, half on either side of the centre of gravity")
    add("--times", metavar="S,S,…", help="what --swings whole swings took, each time")
    add("--swings", metavar="N", type=int, default=10)
    add("--span", metavar="M", type=float)
    add("--json", action="store_true")


def answers_from(args: argparse.Namespace) -> Answers:
    """The aircraft that the options describe; asked for in the terminal where they leave something out.

    Raises SettingsError where they cannot be meant, or nobody can be asked.
    """
    from gcs.vehicles.document import Answers

    given = {key: getattr(args, key) for key, _, _ in _ASKED}
    given |= {"area": args.area, "chord": args.chord}
    _ask_for_the_rest(given)
    mass, mass_std = _pair("--mass", str(given["mass"]))
    span = _pair("--span", str(given["span"]))[0]
    for name in ("area", "chord"):
        if given[name] is not None:
            _pair(f"--{name}", str(given[name]))
    numbers = {"mass_kg": mass, "mass_std_kg": mass_std, "span_m": span, "area_m2": given["area"],
               "chord_m": given["chord"],
               "speed_mps": args.speed, "max_thrust_n": args.thrust, "propeller_m": args.propeller,
               "moving_mass_kg": args.moving_mass}  # fmt: skip
    if args.inertia:
        values = _numbers("--inertia", args.inertia)
        if len(values) not in (3, 4):
            raise SettingsError(f"--inertia {args.inertia}: give Ixx,Iyy,Izz or Ixx,Iyy,Izz,Ixz, kg m^2")
        numbers |= {f"{key}_kgm2": value for key, value in zip(_INERTIA, values, strict=False)}
    controls = _controls_of(args.log) if args.log is not None else {}
    controls |= dict(_control(text) for text in args.control)
    return Answers(
        args.name or args.output.stem, {key: value for key, value in numbers.items() if value is not None}, controls
    )


def estimated(args: argparse.Namespace) -> dict[str, Measured]:
    """The moments of inertia that the options describe, by name. Raises SettingsError, VehicleError."""
    from gcs.vehicles.inertia import by_bifilar, by_swing, period, ruler, scale, usual

    mass = scale(*_pair("--mass", args.mass))
    if args.way == "usual":
        return usual(mass, _demanded(args, "span"))
    swing = period(_numbers("--times", _demanded(args, "times")), args.swings)
    length = ruler(*_pair("--length", _demanded(args, "length")))
    if args.way == "swing":
        return {args.axis: by_swing(mass, length, swing)}
    spacing = ruler(*_pair("--spacing", _demanded(args, "spacing")))
    return {args.axis: by_bifilar(mass, length, spacing, swing)}


def _demanded(args: argparse.Namespace, name: str) -> Any:
    value = getattr(args, name)
    if value is None:
        raise SettingsError(f"{args.way} needs --{name}")
    return value


def _ask_for_the_rest(given: dict[str, object]) -> None:
    questions = [one for one in _ASKED if given[one[0]] is None]
    if given["area"] is None and given["chord"] is None:
        questions.append(("area", "Wing area", "m^2"))
    if not questions:
        return
    if not sys.stdin.isatty():
        missing = ", ".join(f"--{key}" for key, _, _ in questions)
        raise SettingsError(f"{missing}: missing, and there is no terminal to ask in")
    for key, words, unit in questions:
        while given[key] is None:
            print(f"{words}, {unit}: ", end="", file=sys.stderr, flush=True)
            text = sys.stdin.readline()
            if not text:
                raise SettingsError(f"--{key}: missing")
            try:
                value = _pair(words, text.strip())[0]
            except SettingsError as error:
                print(error, file=sys.stderr)
                continue
            given[key] = text.strip() if key == "mass" else value


def _numbers(option: str, text: str) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise SettingsError(f"{option} {text}: give numbers with commas between, as 1.05,0.01") from error
    if not all(math.isfinite(value) for value in values):
        raise SettingsError(f"{option} {text}: give finite numbers")
    return values


def _pair(option: str, text: str) -> tuple[float, float | None]:
    """A value and its standard deviation, None where there is none."""
    values = _numbers(option, text)
    if len(values) > 2 or values[0] <= 0.0 or any(value < 0.0 for value in values):
        raise SettingsError(f"{option} {text}: give a positive number, and its standard deviation behind a comma")
    return values[0], values[1] if len(values) > 1 else None


def _control(text: str) -> tuple[str, ControlAnswer]:
    from gcs.vehicles.document import ControlAnswer, ServoAnswer
    from sim_vehicle.model.aerodynamic_terms import may_name_control
    from sim_vehicle.vehicle.controls import CONTROL_NAMES

    name, _, rest = text.partition("=")
    parts = rest.split(":")
    known = name in CONTROL_NAMES or may_name_control(name)
    if not known or len(parts) != 3 or not parts[0].isascii() or not parts[0].isdecimal():
        raise SettingsError(
            f"--control {text}: give NAME=SERVO:PULSES:DEFLECTIONS, as elevator=2:1100,1500,1900:-20,0,22;"
            f" NAME is one of {', '.join(CONTROL_NAMES)}, or a name of your own as flap"
        )
    pulses, travel = _numbers("--control", parts[1]), _numbers("--control", parts[2])
    if len(pulses) != len(travel):
        raise SettingsError(f"--control {text}: as many deflections as pulses")
    return name, ControlAnswer((ServoAnswer(int(parts[0]), tuple(pulses), tuple(travel)),))


def _controls_of(log: Path) -> dict[str, ControlAnswer]:
    """Controls by the parameters of the autopilot in a log; their travel is the usual one."""
    from gcs.inspection.info import as_recordings
    from gcs.vehicles.from_log import controls_in

    with as_recordings([log], "ardupilotmega") as paths:
        return controls_in(paths[0], log.name)
