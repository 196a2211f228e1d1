"""The model file: coefficients with their errors, and effects; read and written by simulator and estimator alike."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from sim_vehicle.effects import Effect, effect_called
from sim_vehicle.errors import ModelFileError
from sim_vehicle.model.aerodynamic_terms import parse_term

SCHEMA = "model/1"
BUILT_IN = Path(__file__).parent.parent / "vehicles"


@dataclass(frozen=True)
class Coefficient:
    """A value with its standard error, or the reason why a flight could not identify it.

    value: the coefficient, per radian, rates nondimensional; None if refused.
    std: statistical standard error; None if it is not an estimate.
    mean, mean_std: of an estimate that is refused: what flies in its place, for zero is no better known; None where
    there was none.
    extra: further keys of the file (ci95, systematic), kept as they came.
    """

    value: float | None
    std: float | None = None
    refused: str = ""
    extra: Mapping[str, Any] = field(default_factory=dict)
    mean: float | None = None
    mean_std: float | None = None

    @property
    def flown(self) -> float | None:
        """What flies: the value, or where that is refused the mean of its estimate."""
        return self.mean if self.value is None else self.value

    @property
    def flown_std(self) -> float | None:
        """Standard error of what flies."""
        return self.mean_std if self.value is None else self.std

    def to_json(self) -> dict[str, Any]:
        if self.value is None:
            means = {"mean": self.mean, "mean_std": self.mean_std}
            return {"refused": self.refused, **{k: v for k, v in means.items() if v is not None}, **self.extra}
        entry: dict[str, Any] = {"value": self.value}
        if self.std is not None:
            entry["std"] = self.std
        return {**entry, **self.extra}


@dataclass(frozen=True)
class ModelEffect:
    """An effect of the model with its parameters (SI; a choice among names as the name's place)."""

    name: str
    parameters: Mapping[str, Coefficient]

    def values(self) -> dict[str, float]:
        """Parameter values without their errors."""
        return {key: entry.value for key, entry in self.parameters.items() if entry.value is not None}

    def refused(self) -> list[str]:
        """Names of the parameters that have no value."""
        return [key for key, entry in self.parameters.items() if entry.value is None]

    def to_json(self) -> dict[str, Any]:
        entries = {key: entry.to_json() for key, entry in self.parameters.items()}
        for key, value in self.values().items():
            entries[key]["value"] = effect_called(self.name).parameter(key).shown(value)
        return {"name": self.name, "parameters": entries}


@dataclass(frozen=True)
class Correlation:
    """How the errors of estimates depend on each other. names: P coefficients or `effect.parameter`; matrix: P rows."""

    names: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]

    def to_json(self) -> dict[str, Any]:
        return {"names": list(self.names), "matrix": [list(row) for row in self.matrix]}


@dataclass(frozen=True)
class Model:
    """A flight model.

    validity: variable -> (low, high) range in which it was identified. correlation: of the estimates' errors; None
    where the model is no estimate, or comes from a file without it.
    """

    name: str
    coefficients: Mapping[str, Coefficient]
    effects: tuple[ModelEffect, ...] = ()
    validity: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    correlation: Correlation | None = None

    def values(self) -> dict[str, float]:
        """Coefficient values; a coefficient without one is left out."""
        return {name: entry.value for name, entry in self.coefficients.items() if entry.value is not None}

    def flown(self) -> dict[str, float]:
        """What flies: values, and means of estimates that are refused; a coefficient without either is left out."""
        return {name: entry.flown for name, entry in self.coefficients.items() if entry.flown is not None}

    def refused(self) -> list[str]:
        """Names of the coefficients that have no value."""
        return [name for name, entry in self.coefficients.items() if entry.value is None]

    def not_identified(self) -> list[str]:
        """Names of the coefficients that fly by the mean of an estimate that is refused."""
        return [name for name in self.refused() if self.coefficients[name].mean is not None]

    def unknown(self) -> list[str]:
        """Names of the coefficients of which nothing is known that could fly."""
        return [name for name in self.refused() if self.coefficients[name].mean is None]

    def with_starts(self) -> Model:
        """The model with a value for every coefficient, as a search for better ones begins: what is refused has the
        mean of its estimate, and 0 where nothing is known of it.
        """
        starts = {name: Coefficient(self.coefficients[name].mean or 0.0) for name in self.refused()}
        return replace(self, coefficients={**self.coefficients, **starts})

    def effect(self, name: str) -> dict[str, float] | None:
        """Parameter values of an effect, None where the model does not have it."""
        for effect in self.effects:
            if effect.name == name:
                return effect.values()
        return None

    def with_coefficient(self, name: str, value: float, std: float | None = None) -> Model:
        """A model in which that coefficient has that value."""
        parse_term(name)
        return replace(self, coefficients={**self.coefficients, name: Coefficient(float(value), std)})

    def with_effect(
        self, effect: Effect, values: Mapping[str, float], stds: Mapping[str, float] | None = None
    ) -> Model:
        """A model with the effect added (or replaced). A coefficient effect goes to the coefficients."""
        complete = effect.complete(values)
        stds = stds or {}
        entries = {key: Coefficient(value, stds.get(key)) for key, value in complete.items()}
        if effect.is_coefficient:
            return replace(self, coefficients={**self.coefficients, **entries})
        others = tuple(other for other in self.effects if other.name != effect.name)
        return replace(self, effects=(*others, ModelEffect(effect.name, entries)))

    def to_json(self) -> dict[str, Any]:
        """The model file as JSON values."""
        correlation = {} if self.correlation is None else {"correlation": self.correlation.to_json()}
        return {
            "schema": SCHEMA,
            "name": self.name,
            "coefficients": {name: entry.to_json() for name, entry in self.coefficients.items()},
            "effects": [effect.to_json() for effect in self.effects],
            "validity": {name: list(limits) for name, limits in self.validity.items()},
            **correlation,
        }

    def write(self, path: str | Path) -> None:
        """Write the model file; ModelFileError where the disk refuses."""
        try:
            Path(path).write_text(json.dumps(self.to_json(), indent=2, allow_nan=False) + "\n", encoding="utf-8")
        except OSError as error:
            raise ModelFileError(f"{path}: cannot write the model: {error.strerror}") from None


def _entry(where: str, data: Any) -> Coefficient:
    if isinstance(data, int | float) and not isinstance(data, bool):
        data = {"value": data}
    if not isinstance(data, dict):
        raise ModelFileError(f'{where}: expected {{"value": number}}, got {data!r}')
    extra = {key: item for key, item in data.items() if key not in ("value", "std", "refused", "mean", "mean_std")}
    if "refused" in data:
        means = (
            None if data.get(key) is None else _finite(f"{where}: {key}", data[key]) for key in ("mean", "mean_std")
        )
        return Coefficient(None, None, str(data["refused"]), extra, *means)
    value = _finite(f"{where}: value", data.get("value"))
    std = None if data.get("std") is None else _finite(f"{where}: std", data["std"])
    if std is not None and std < 0.0:
        raise ModelFileError(f"{where}: std must not be negative, got {std!r}")
    return Coefficient(value, std, "", extra)


def _finite(where: str, number: Any) -> float:
    # An integer of JSON may be too large for a float.
    if isinstance(number, bool) or not isinstance(number, int | float) or not abs(number) <= sys.float_info.max:
        raise ModelFileError(f"{where} must be a finite number, got {number!r:.40}")
    return float(number)


def _object(where: str, data: Mapping[str, Any], key: str) -> dict[str, Any]:
    """The object under `key`, empty where there is none; ModelFileError for anything else."""
    found = data.get(key, {})
    if not isinstance(found, dict):
        raise ModelFileError(f"{where}: {key} must be an object of name to value")
    return found


def _numbered(effect: Effect, key: str, entry: Any) -> Any:
    """The entry of a parameter, its value a number where it was the name of a choice."""
    choices = {parameter.name: parameter for parameter in effect.parameters if parameter.choices}
    given = entry.get("value") if isinstance(entry, dict) else entry
    if key not in choices or not isinstance(given, str):
        return entry
    number = effect.possible(choices[key], given)
    return {**entry, "value": number} if isinstance(entry, dict) else number


def _effect_from_json(item: Any, where: str) -> tuple[Effect, dict[str, Coefficient]]:
    """An effect of the file with its parameters, defaults filled in. What is refused stays without a value."""
    if not isinstance(item, dict) or "name" not in item:
        raise ModelFileError(f"{where}: an effect needs a name, got {item!r}")
    unknown = set(item) - {"name", "parameters"}
    try:
        effect = effect_called(str(item["name"]))
        if unknown:
            raise ModelFileError(f"effect {effect.name}: unknown key {sorted(unknown)[0]!r}")
        raw = _object(f"effect {effect.name}", item, "parameters")
        entries = {key: _entry(f"{effect.name}.{key}", _numbered(effect, key, entry)) for key, entry in raw.items()}
        # A refused parameter is a known name; any possible number stands for it in the check.
        stand_in = {parameter.name: max(parameter.low, 0.0) for parameter in effect.parameters}
        known = {k: stand_in.get(k, 0.0) if entry.value is None else entry.value for k, entry in entries.items()}
        complete = effect.complete(known)
    except ModelFileError as error:
        raise ModelFileError(f"{where}: {error}") from None
    return effect, {key: entries.get(key, Coefficient(value)) for key, value in complete.items()}


def model_from_json(data: Any, where: str = "model") -> Model:
    """Check and convert the JSON of a model file. Raises ModelFileError naming the key that is wrong."""
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        wrote = "; give the file that --write-model wrote" if "model" in data else ""
        raise ModelFileError(f'{where}: not a model file (its "schema" must be "{SCHEMA}"){wrote}')
    unknown = set(data) - {"schema", "name", "coefficients", "effects", "validity", "correlation"}
    if unknown:
        raise ModelFileError(f"{where}: unknown key {sorted(unknown)[0]!r}")
    coefficients = {}
    for name, entry in _object(where, data, "coefficients").items():
        try:
            parse_term(name)
        except ModelFileError as error:
            raise ModelFileError(f"{where}: {error}") from None
        coefficients[name] = _entry(f"{where}: {name}", entry)
    effects: dict[str, ModelEffect] = {}
    items = data.get("effects", [])
    if not isinstance(items, list):
        raise ModelFileError(f"{where}: effects must be a list")
    for item in items:
        effect, entries = _effect_from_json(item, where)
        twice = set(entries) & set(coefficients) if effect.is_coefficient else {effect.name} & set(effects)
        if twice:
            raise ModelFileError(f"{where}: {sorted(twice)[0]} is given twice")
        if effect.is_coefficient:
            coefficients.update(entries)
        else:
            effects[effect.name] = ModelEffect(effect.name, entries)
    validity = {}
    for name, limits in _object(where, data, "validity").items():
        if not isinstance(limits, list) or len(limits) != 2:
            raise ModelFileError(f"{where}: validity.{name} must be [low, high]")
        low, high = (_finite(f"{where}: validity.{name}", limit) for limit in limits)
        validity[name] = (low, high)
    known = {*coefficients, *(f"{effect.name}.{key}" for effect in effects.values() for key in effect.parameters)}
    correlation = _correlation(where, data["correlation"], known) if "correlation" in data else None
    return Model(str(data.get("name", "")), coefficients, tuple(effects.values()), validity, correlation)


def _correlation(where: str, data: Any, known: set[str]) -> Correlation:
    """The correlation block, its names and shape checked."""
    if not isinstance(data, dict) or set(data) != {"names", "matrix"}:
        raise ModelFileError(f"{where}: correlation must hold names and matrix, nothing else")
    names, rows = data["names"], data["matrix"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names) or len(set(names)) < len(names):
        raise ModelFileError(f"{where}: correlation.names must be a list of names, each once")
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ModelFileError(f"{where}: correlation names {unknown[0]!r}, which the model does not have")
    if not isinstance(rows, list) or [isinstance(row, list) and len(row) for row in rows] != [len(names)] * len(names):
        raise ModelFileError(f"{where}: correlation.matrix must be {len(names)} rows of {len(names)} numbers")
    matrix = tuple(tuple(_finite(f"{where}: correlation", number) for number in row) for row in rows)
    for i, row in enumerate(matrix):
        for j, number in enumerate(row):
            if abs(number) > 1.0 or number != matrix[j][i] or (i == j and number != 1.0):
                raise ModelFileError(
                    f"{where}: correlation of {names[i]} and {names[j]} is {number:g}: the matrix must be symmetric, "
                    "within -1 to 1, and 1 on its diagonal"
                )
    return Correlation(tuple(names), matrix)


def read_model(name_or_path: str | Path) -> Model:
    """Read a model file, or the built-in model of that name. Raises ModelFileError."""
    path = Path(name_or_path)
    built_in = BUILT_IN / f"{name_or_path}.model.json"
    if not path.exists() and built_in.exists():
        path = built_in
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise ModelFileError(f"{path}: cannot read the model: {reason}") from None
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise ModelFileError(
            f"{path}:{error.lineno}: not JSON ({error.msg}): a model is what gcs identify --write-model wrote, or"
            f" {' or '.join(sorted(one.name.removesuffix('.model.json') for one in BUILT_IN.glob('*.model.json')))}"
        ) from None
    return model_from_json(data, str(path))
