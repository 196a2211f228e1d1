"""What is exported: a model of a vehicle, what every form says of it, and what a form may not hold."""

from __future__ import annotations

import json
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gcs.errors import ExportError
from gcs.text.meanings import meaning
from gcs.text.one_line import one_line
from gcs.version import VERSION
from sim_vehicle.effects import EFFECTS, Stage
from sim_vehicle.model.model_file import Coefficient, Model, model_from_json, read_model
from sim_vehicle.vehicle.packed_model import require_controls
from sim_vehicle.vehicle.vehicle_file import Vehicle

AXES_AND_SIGNS = (
    "SI units, angles in rad. CL and CD in stability axes, CY along body y; moments about the centre of gravity in body"
    " axes (x forward, y right, z down). p, q, r in coefficients are p b / 2V, q c / 2V, r b / 2V. Deflections have the"
    " signs of the vehicle file."
)
Z95 = 1.96


@dataclass(frozen=True)
class Exported:
    """A model and its vehicle.

    Effects of sensors and of the air are nothing that flies along, and are named in `left_out`.
    """

    model: Model
    vehicle: Vehicle

    def __post_init__(self) -> None:
        """Raises ModelFileError for a coefficient of a control that the vehicle does not have."""
        require_controls(self.vehicle, self.model)

    @property
    def title(self) -> str:
        """One line: which model, of which vehicle, by what, and which of its numbers no flight identified."""
        doubt = f"; {self.doubt}" if self.doubt else ""
        return one_line(f"{self.model.name}, identified model of {self.vehicle.name}, exported by gcs {VERSION}{doubt}")

    @property
    def doubt(self) -> str:
        """Which coefficients fly by the mean of an estimate that was refused; "" where none does."""
        names = self.model.not_identified()
        return f"not identified, there by the mean of a refused estimate: {', '.join(names)}" if names else ""

    @property
    def estimates(self) -> dict[str, Coefficient]:
        """Coefficients and effect parameters that have a value, effect.parameter for the latter."""
        return estimates_of(self.model)

    def effects_flown(self, form: str, known: Collection[str]) -> dict[str, dict[str, float]]:
        """Effects that fly along, with their values. Raises ExportError for one that the form does not hold."""
        self.require_values()
        found = {}
        for effect in self.model.effects:
            if EFFECTS[effect.name].stage in (Stage.SENSOR, Stage.ENVIRONMENT):
                continue
            if effect.name not in known:
                raise ExportError(
                    f"{self.model.name}: {form} does not hold the effect {effect.name} ({EFFECTS[effect.name].title});"
                    f" it holds {', '.join(sorted(known)) or 'none'}: identify without it, or take another form"
                )
            found[effect.name] = effect.values()
        return found

    def require_values(self) -> None:
        """Raise ExportError where a parameter of an effect was refused, so that nobody knows how large it is."""
        for effect in self.model.effects:
            if refused := effect.refused():
                raise ExportError(
                    f"{self.model.name}: the effect {effect.name} has no value for {', '.join(refused)}; identify"
                    " it, or take the effect out of the model"
                )

    @property
    def left_out(self) -> list[str]:
        """What no form holds: effects of sensors and air, refused coefficients."""
        every = [one.name for one in self.model.effects if EFFECTS[one.name].stage in (Stage.SENSOR, Stage.ENVIRONMENT)]
        lines = [f"{name} is no part of the aircraft" for name in every]
        unknown = self.model.unknown()
        if self.vehicle.motors:
            lines.append("each motor by itself: all of them follow one throttle, and turn the aircraft by nothing")
        return [*lines, *([f"refused, taken as 0: {', '.join(unknown)}"] if unknown else [])]


def estimates_of(model: Model) -> dict[str, Coefficient]:
    """Coefficients and effect parameters of a model that have a value, effect.parameter for the latter."""
    entries = dict(model.coefficients)
    for effect in model.effects:
        entries |= {f"{effect.name}.{name}": entry for name, entry in effect.parameters.items()}
    return {name: entry for name, entry in entries.items() if entry.value is not None}


def model_of(name_or_path: str) -> Model:
    """The model of a model file, of a result, or the built-in one of that name. Raises ModelFileError in one line."""
    path = Path(name_or_path)
    with suppress(OSError, ValueError):
        found = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(found, dict) and isinstance(found.get("model"), dict):
            return model_from_json(found["model"], str(path))
    return read_model(name_or_path)


def battery_of(name_or_path: str) -> dict[str, Any] | None:
    """What a result says of its battery; None for a model, and where it was not read."""
    with suppress(OSError, ValueError):
        found = json.loads(Path(name_or_path).read_text(encoding="utf-8"))
        if isinstance(found, dict) and isinstance(found.get("battery"), dict):
            return dict(found["battery"])
    return None


def described(name: str) -> str:
    """A coefficient in words, or an effect's title."""
    effect = name.partition(".")[0]
    return meaning(name) or (EFFECTS[effect].title if effect in EFFECTS else "")


def require_new(path: Path) -> None:
    """Raise ExportError where something is in the way."""
    if path.exists():
        raise ExportError(f"{path}: exists already; give another name")
