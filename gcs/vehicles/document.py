"""The text of a vehicle file: a form's answers put into it and read out of it, whatever else stands there kept."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit import TOMLDocument

from sim_vehicle.errors import VehicleFileError
from sim_vehicle.vehicle.controls import CONTROL_NAMES, GUESSED_TRAVEL_STD
from sim_vehicle.vehicle.toml_bounds import check_bounds
from sim_vehicle.vehicle.vehicle_file import Vehicle

# Numbers of the form, and where they stand in the file.
_NUMBERS: Mapping[str, tuple[str, str]] = {
    "mass_kg": ("mass", "mass"),
    "mass_std_kg": ("mass", "mass_std"),
    **{f"{key}_kgm2": ("mass", key) for key in ("Ixx", "Iyy", "Izz", "Ixz")},
    **{f"{key}_std_kgm2": ("mass", f"{key}_std") for key in ("Ixx", "Iyy", "Izz", "Ixz")},
    "area_m2": ("geometry", "S"),
    "span_m": ("geometry", "b"),
    "chord_m": ("geometry", "c"),
    "speed_mps": ("flight", "airspeed"),
    "max_thrust_n": ("propulsion", "max_thrust"),
    "propeller_m": ("propulsion", "diameter"),
    "moving_mass_kg": ("propulsion", "moving_mass"),
}
_SENSORS = ("accelerometer", "alpha_vane", "beta_vane")
_DIGITS = 6


@dataclass(frozen=True)
class ServoAnswer:
    """One servo of a control: its pulses, us, and the deflections there, deg (throttle: %)."""

    servo: int
    pwm_us: tuple[float, ...]
    travel: tuple[float, ...]
    mix: float = 1.0


@dataclass(frozen=True)
class ControlAnswer:
    """A control: its servos, and whether SERVO_OUTPUT_RAW carries their command or their measured position.

    guessed_to: what a travel that nobody has measured is taken to be known to, 1 sigma, share of it; None where that is
    not asked, and the file's own word stays.
    """

    servos: tuple[ServoAnswer, ...]
    signal: str = "command"
    guessed_to: float | None = None


@dataclass(frozen=True)
class BenchAnswer:
    """Bench points of an analogue channel, (reference, reading) each, the reference in `unit`."""

    source: str
    form: str
    unit: str
    points: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Answers:
    """What a form asks of an aircraft. numbers: by the names of `_NUMBERS`, in the unit behind each name.

    What is absent is not given, and is taken out of the file: moments of inertia that are not given are then those
    usual for span and mass. places: of sensors from the centre of gravity, m, forward, right, down.
    """

    name: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    controls: Mapping[str, ControlAnswer] = field(default_factory=dict)
    places: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    bench: Mapping[str, BenchAnswer] = field(default_factory=dict)


NUMBER_NAMES = tuple(_NUMBERS)
SENSOR_NAMES = _SENSORS


def with_answers(text: str, answers: Answers) -> str:
    """The text of a vehicle file with the answers of a form in it; what the form does not ask stays as it is.

    VehicleFileError where the text is no TOML. The result is a vehicle file only if the answers make one.
    """
    try:
        return _filled(_parsed(text), answers)
    except (KeyError, IndexError, TypeError, AttributeError) as error:  # tables torn apart, numbers in their place
        raise VehicleFileError(
            f"vehicle file: the form cannot be put into it ({error}); change its text, or put its tables together"
        ) from error


def _filled(document: TOMLDocument, answers: Answers) -> str:
    document["name"] = answers.name
    numbers = _with_third(answers.numbers)
    for name, (table, key) in _NUMBERS.items():
        _set(document, table, key, _plain(numbers.get(name)))
    if "controls" in document or answers.controls:
        controls = _table(document, "controls")
        for name in dict.fromkeys((*CONTROL_NAMES, *controls, *answers.controls)):
            _set_control(controls, name, answers.controls.get(name))
    for sensor in _SENSORS:
        place = answers.places.get(sensor)
        entry = document.get("sensors", {}).get(sensor)
        if place is not None and entry is None:
            _table(document, "sensors")[sensor] = tomlkit.inline_table()
        if place is not None or entry is not None:
            at = None if place is None else [_plain(x) for x in place]
            _put(_table(_table(document, "sensors"), sensor), "position", at)
    bench = document.get("calibration", {})
    for name in [one for one in bench if one not in answers.bench]:
        del _table(document, "calibration")[name]
    for name, given in answers.bench.items():
        entry = _table(_table(document, "calibration"), name)
        points = [[_plain(a), _plain(b)] for a, b in given.points]
        for key, value in (("source", given.source), ("form", given.form), ("unit", given.unit), ("points", points)):
            _put(entry, key, value)
    for name in ("sensors", "propulsion", "flight", "controls", "calibration"):
        if name in document and not document[name]:
            del document[name]
    return tomlkit.dumps(document)


def _with_third(numbers: Mapping[str, float]) -> dict[str, float]:
    """The numbers, and of wing area, span and mean chord the third where two of them are there."""
    found = dict(numbers)
    area, span, chord = (found.get(name) for name in ("area_m2", "span_m", "chord_m"))
    if chord is None and area and span:
        found["chord_m"] = round(area / span, _DIGITS)
    elif area is None and chord and span:
        found["area_m2"] = round(span * chord, _DIGITS)
    elif span is None and area and chord:
        found["span_m"] = round(area / chord, _DIGITS)
    return found


def answers_of(text: str) -> Answers:
    """What a form shows of a vehicle file. VehicleFileError where it holds what the form cannot show."""
    check_bounds(text, "vehicle file")
    try:
        data = tomllib.loads(text)
        numbers = {
            name: float(data[table][key]) for name, (table, key) in _NUMBERS.items() if key in data.get(table, {})
        }
        controls = {name: _control_of(name, entry) for name, entry in data.get("controls", {}).items()}
        places = {
            name: _place(entry["position"])
            for name, entry in data.get("sensors", {}).items()
            if name in _SENSORS and "position" in entry
        }
        bench = {
            name: BenchAnswer(entry["source"], entry["form"], entry["unit"], tuple((a, b) for a, b in entry["points"]))
            for name, entry in data.get("calibration", {}).items()
        }
        return Answers(str(data.get("name", "")), numbers, controls, places, bench)
    except (tomllib.TOMLDecodeError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise VehicleFileError(f"vehicle file: it cannot be shown as a form ({error}); edit its text") from error


def with_points_inside(text: str, vehicle: Vehicle) -> str:
    """The text with the bench tables that it names written into it, so that it needs no file beside it."""
    from sysid.signals.calibration import read_points

    tables = {name: entry.points for name, entry in vehicle.calibration.items() if isinstance(entry.points, Path)}
    if not tables:
        return text
    document = _parsed(text)
    for name, path in tables.items():
        found = read_points(path)
        rows = [[float(a), float(b)] for a, b in zip(found.reference, found.reading, strict=True)]
        _put(_table(_table(document, "calibration"), name), "points", rows)
    return tomlkit.dumps(document)


def _parsed(text: str) -> TOMLDocument:
    check_bounds(text, "vehicle file")
    try:
        return tomlkit.parse(text)
    except ValueError as error:  # tomlkit's own errors are ValueErrors
        raise VehicleFileError(f"vehicle file: is not a TOML file: {error}") from error


def _table(parent: Any, name: str) -> Any:
    if name not in parent:
        parent[name] = tomlkit.table()
    if not isinstance(parent[name], dict):
        raise VehicleFileError(f"vehicle file: {name} must be a table")
    return parent[name]


def _set(document: TOMLDocument, table: str, key: str, value: object) -> None:
    if value is not None:
        _put(_table(document, table), key, value)
    elif table in document:
        _put(_table(document, table), key, None)


def _put(entry: Any, key: str, value: object) -> None:
    """Set or take out a key; one that has that value already keeps its line and the remark behind it."""
    if value is None:
        if key in entry:
            del entry[key]
    elif key not in entry or _bare(entry[key]) != value:
        entry[key] = value


def _bare(item: Any) -> object:
    return item.unwrap() if hasattr(item, "unwrap") else item


def _set_control(controls: Any, name: str, answer: ControlAnswer | None) -> None:
    if answer is None:
        if name in controls:
            del controls[name]
        return
    entry = _table(controls, name)
    servos, one = answer.servos, len(answer.servos) == 1
    unit = _percent if name == "throttle" else _radians if name in CONTROL_NAMES else _plain
    pwm = [[_plain(x) for x in servo.pwm_us] for servo in servos]
    travel = [[unit(y) for y in servo.travel] for servo in servos]
    # Degrees of a form are rounded; what is the same in them is not written anew.
    before = _control_or_none(name, _bare(entry))
    if before != answer:
        _put(entry, "servo", servos[0].servo if one else [servo.servo for servo in servos])
        _put(entry, "signal", answer.signal)
        _put(entry, "pwm", pwm[0] if one else pwm)
        _put(entry, "deflection", travel[0] if one else travel)
        mix = [_plain(servo.mix) for servo in servos]
        _put(entry, "mix", (None if mix[0] == 1.0 else mix[0]) if one else mix)
    if answer.guessed_to is not None:
        guess = tomlkit.item(answer.guessed_to)
        guess.comment("the travel is guessed: measure it, and write here how well")
        entry["gain_std"] = guess
    elif before is not None and _travels(before) != _travels(answer) and _is_guessed(_bare(entry)):
        # Who writes another travel than the guessed one has measured it.
        del entry["gain_std"]


def _is_guessed(entry: Any) -> bool:
    std = entry.get("gain_std")
    return isinstance(std, int | float) and std >= GUESSED_TRAVEL_STD


def _travels(answer: ControlAnswer) -> list[tuple[float, ...]]:
    return [servo.travel for servo in answer.servos]


def _control_or_none(name: str, entry: Any) -> ControlAnswer | None:
    try:
        return _control_of(name, entry)
    except (KeyError, TypeError, ValueError):
        return None


def _control_of(name: str, entry: Mapping[str, Any]) -> ControlAnswer:
    numbers = entry["servo"] if isinstance(entry["servo"], list) else [entry["servo"]]
    nested = isinstance(entry["pwm"][0], list)
    pwm, deflection = (entry[key] if nested else [entry[key]] for key in ("pwm", "deflection"))
    mix = entry.get("mix", [1.0] * len(numbers))
    mix = mix if isinstance(mix, list) else [mix]
    known = name in CONTROL_NAMES
    unit, digits = 100.0 if name == "throttle" else math.degrees(1.0) if known else 1.0, 3 if known else _DIGITS
    servos = tuple(
        ServoAnswer(int(n), _floats(xs), tuple(round(unit * y, digits) for y in _floats(ys)), float(weight))
        for n, xs, ys, weight in zip(numbers, pwm, deflection, mix, strict=True)
    )
    return ControlAnswer(servos, str(entry.get("signal", "command")))


def _floats(values: Sequence[object]) -> tuple[float, ...]:
    return tuple(float(value) for value in values)  # type: ignore[arg-type]


def _place(values: Sequence[object]) -> tuple[float, float, float]:
    x, y, z = _floats(values)
    return x, y, z


def _radians(degrees: float) -> float:
    return round(math.radians(degrees), _DIGITS)


def _percent(value: float) -> float:
    return round(value / 100.0, _DIGITS)


def _plain(value: float | None) -> float | int | None:
    """A number as a person writes it: 1500, not 1500.0."""
    if value is None or not float(value).is_integer() or abs(value) > 1e15:
        return value
    return int(value) if abs(value) >= 10.0 else float(value)
