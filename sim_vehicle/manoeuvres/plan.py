"""A plan: the manoeuvres of one flight in order, from a list of names or a JSON file of schema "plan/1".

    {"schema": "plan/1", "segments": [{"manoeuvre": "elevator-pulse", "duration": 10.0, "amplitude": 0.0349},
    ...]}

What a segment does not say is the manoeuvre's default. Seconds, rad, Hz; `harmonics`, `phases`, `weights` and
`amplitudes` are objects by axis. Other keys beside `segments`, such as a design's predictions, are left alone.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sim_vehicle.errors import PlanError
from sim_vehicle.manoeuvres.shapes import CONTROLS, SEGMENT_KEYS, SETTINGS, Segment, check, default_of, manoeuvre
from sim_vehicle.model.aerodynamic_terms import may_name_control

SCHEMA = "plan/1"
BY_HARMONIC = ("harmonics", "phases", "weights")  # of a multisine, by axis
RECOVERY_S = 5.0  # the autopilot's time to bring the aircraft back to trim between two manoeuvres


@dataclass(frozen=True)
class Plan:
    """Segments flown one after another."""

    segments: tuple[Segment, ...]

    @property
    def duration(self) -> float:
        """Seconds from the first segment's begin to the last one's end."""
        return math.fsum(segment.duration for segment in self.segments)

    def fitted(self, duration: float) -> Plan:
        """The plan repeated or cut so that it lasts exactly `duration`, s."""
        if not (math.isfinite(duration) and duration > 0.0):
            raise PlanError(f"duration is {duration:g} s; it must be above 0")
        found: list[Segment] = []
        left = duration
        while left > 1e-9:
            if found and self.segments[0].manoeuvre != "cruise" and left > RECOVERY_S:
                found.append(manoeuvre("cruise", duration=RECOVERY_S))
                left -= RECOVERY_S
            for segment in self.segments:
                if left <= 1e-9:
                    break
                found.append(replace(segment, duration=min(segment.duration, left)))
                left -= segment.duration
        return Plan(tuple(found))

    def with_settings(self, settings: Mapping[str, float]) -> Plan:
        """The plan with these settings (amplitude, width, ...) in every manoeuvre but `cruise`."""
        for key in settings:
            if key not in SETTINGS:
                raise PlanError(f"a manoeuvre has no setting {key!r}; there are {', '.join(SETTINGS)}")
        changed = []
        for segment in self.segments:
            if segment.manoeuvre != "cruise":
                segment = replace(segment, **settings)  # type: ignore[arg-type]
                check(segment)
            changed.append(segment)
        return Plan(tuple(changed))

    def to_json(self) -> dict[str, Any]:
        """The plan file as JSON values; only what differs from a manoeuvre's default, and its timing."""
        return {"schema": SCHEMA, "segments": [_segment_to_json(segment) for segment in self.segments]}

    def write(self, path: str | Path) -> None:
        """Write the plan file; PlanError where the disk refuses."""
        try:
            Path(path).write_text(json.dumps(self.to_json(), indent=2, allow_nan=False) + "\n", encoding="utf-8")
        except OSError as error:
            raise PlanError(f"{path}: cannot write the plan: {error.strerror}") from None


def plan_of(names: Sequence[str]) -> Plan:
    """A plan of named manoeuvres, with a recovery of 5 s of `cruise` between each two of them."""
    if not names:
        raise PlanError("no manoeuvre named; give at least one")
    segments: list[Segment] = []
    for name in names:
        if segments and "cruise" not in (name, segments[-1].manoeuvre):
            segments.append(manoeuvre("cruise", duration=RECOVERY_S))
        segments.append(manoeuvre(name))
    return Plan(tuple(segments))


def read_plan(path: str | Path) -> Plan:
    """Read a plan file. Raises PlanError, one line naming segment and key."""
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise PlanError(f"{path}: cannot read the plan: {error.strerror}") from None
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise PlanError(f"{path}: not a JSON file") from None
    return plan_from_json(data, str(path))


def plan_from_json(data: Any, where: str = "plan") -> Plan:
    """Check and convert the JSON of a plan file. Raises PlanError naming segment and key."""
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        raise PlanError(f'{where}: not a plan file (its "schema" must be "{SCHEMA}")')
    entries = data.get("segments")
    if not isinstance(entries, list) or not entries:
        raise PlanError(f"{where}: segments must be a list of at least one manoeuvre")
    return Plan(tuple(_segment(entry, f"{where}: segment {index + 1}") for index, entry in enumerate(entries)))


def _segment(entry: Any, where: str) -> Segment:
    if not isinstance(entry, dict) or not isinstance(entry.get("manoeuvre"), str):
        raise PlanError(f"{where}: needs a manoeuvre's name")
    unknown = sorted(set(entry) - set(SEGMENT_KEYS))
    if unknown:
        raise PlanError(f"{where}: unknown key {unknown[0]!r}; there are {', '.join(SEGMENT_KEYS)}")
    segment = manoeuvre(entry["manoeuvre"])
    values: dict[str, Any] = {key: _number(entry[key], where, key) for key in SETTINGS if key in entry}
    if "axes" in entry:
        axes = entry["axes"]
        known = isinstance(axes, list) and all(
            isinstance(axis, str) and (axis in CONTROLS or may_name_control(axis)) for axis in axes
        )
        if not known or len(set(axes)) < len(axes):
            raise PlanError(
                f"{where}: axes must be a list of {', '.join(CONTROLS)} or other controls of the vehicle, each once"
            )
        values["axes"] = tuple(axes)
    for key in BY_HARMONIC:
        by_axis = _by_axis(entry.get(key, {}), where, key)
        values[key] = {axis: tuple(_number(item, where, key) for item in row) for axis, row in by_axis.items()}
    if any(number != int(number) for row in values["harmonics"].values() for number in row):
        raise PlanError(f"{where}: harmonics must be whole numbers")
    values["harmonics"] = {axis: tuple(int(n) for n in row) for axis, row in values["harmonics"].items()}
    if not isinstance(entry.get("amplitudes", {}), dict):
        raise PlanError(f"{where}: amplitudes must be an object of axis to number")
    peaks = entry.get("amplitudes", {})
    values["amplitudes"] = {axis: _number(peak, where, "amplitudes") for axis, peak in peaks.items()}
    segment = replace(segment, **values)
    try:
        check(segment)
    except PlanError as error:
        raise PlanError(f"{where}: {error}") from None
    return segment


def _number(value: Any, where: str, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise PlanError(f"{where}: {key} must be a finite number, got {value!r}")
    return float(value)


def _by_axis(value: Any, where: str, key: str) -> dict[str, list[Any]]:
    if not isinstance(value, dict) or any(not isinstance(row, list) or not row for row in value.values()):
        raise PlanError(f"{where}: {key} must be an object of axis to a list of numbers")
    return value


def _segment_to_json(segment: Segment) -> dict[str, Any]:
    default = default_of(segment.manoeuvre)
    entry: dict[str, Any] = {"manoeuvre": segment.manoeuvre}
    for key in SETTINGS:
        if key in ("duration", "start", "amplitude") or getattr(segment, key) != getattr(default, key):
            entry[key] = getattr(segment, key)
    if segment.axes != default.axes:
        entry["axes"] = list(segment.axes)
    for key in BY_HARMONIC:
        if getattr(segment, key):
            entry[key] = {axis: list(row) for axis, row in getattr(segment, key).items()}
    if segment.amplitudes:
        entry["amplitudes"] = dict(segment.amplitudes)
    return entry
