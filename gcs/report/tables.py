"""Tables of an identification's result."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gcs.report.markup import NONE, estimate, number, p_value, shown, standard_error, table, text
from gcs.report.symbols import axis_symbol, symbol
from gcs.text.intervals import interval
from gcs.text.meanings import meaning
from gcs.text.nuisance_text import STATED, unknown_words
from gcs.text.quality import VERDICTS
from sim_vehicle.model.aerodynamic_terms import AXES

Result = Mapping[str, Any]
_PERTURBATIONS = {
    "mass_1pct": "mass 1 %", "inertia_5pct": "inertia 5 %", "density_2pct": "density 2 %",
    "linkage_5pct": "linkage gain 5 %",
    "thrust_5pct": "thrust 5 %", "battery_efficiency": "efficiency from battery to air",
}  # fmt: skip
_MAIN = ("CL_alpha", "CD_0", "Cm_alpha", "Cm_q", "Cl_p", "Cn_beta")
_SCORES = {
    "tic": "TIC", "tic_bias": "TIC: bias", "tic_variance": "TIC: variance", "tic_covariance": "TIC: covariance",
    "r2": "R²", "residual_mean": "residual mean", "residual_std": "residual std", "rms_over_noise": "rms / noise",
    "largest_over_noise": "largest / noise", "white": "white", "gaussian_p": "Gaussian p",
}  # fmt: skip


def _estimate_cells(entry: Mapping[str, Any]) -> list[str]:
    """Value, standard error, 95 % interval and relative error."""
    value, std = entry.get("value"), entry.get("std")
    if value is None:
        return [NONE] * 4
    ends = interval(entry)
    between = NONE if ends is None else f"{estimate(ends[0], std)} … {estimate(ends[1], std)}"
    relative = NONE if std is None or value == 0.0 else _percent(100.0 * std / abs(value))
    return [estimate(value, std), standard_error(std), between, relative]


def _named(name: str) -> str:
    """A coefficient's symbol and its name in files; other names as they are."""
    code = f"<code>{text(name)}</code>"
    return code if symbol(name) == text(name) else f"{symbol(name)} {code}"


def _explained(name: str) -> str:
    """The same, and below it what it is."""
    words = meaning(name)
    return f"{_named(name)}<br><small>{text(words)}</small>" if words else _named(name)


def _percent(share: float) -> str:
    """Two digits, and no power of ten below a million."""
    return f"{share:.0f} %" if 100.0 <= share < 1e6 else f"{shown(share, 2)} %"


def _estimated(model: Result) -> dict[str, Mapping[str, Any]]:
    """Coefficients and effect parameters that have a value."""
    entries = dict(model["coefficients"])
    for effect in model.get("effects", []):
        entries |= {f"{effect['name']}.{name}": entry for name, entry in effect.get("parameters", {}).items()}
    return {name: entry for name, entry in entries.items() if entry.get("value") is not None}


def coefficients(model: Result) -> str:
    """Every coefficient estimated, with its error bars."""
    entries = _estimated(model)
    rows = [
        [_explained(name), *_estimate_cells(entry), standard_error(entry.get("statistical_std"))]
        for name, entry in entries.items()
    ]
    head = ["coefficient", "value", "± (1 σ)", "95 % interval", "relative σ", "σ of the flight alone"]
    if not any("statistical_std" in entry for entry in entries.values()):
        return table("Coefficients", head[:-1], [row[:-1] for row in rows])
    caption = "Coefficients. σ and interval hold all: what the flight leaves open, and what was taken as known"
    return table(caption, head, rows)


def main_derivatives(model: Result) -> str:
    """What an engineer looks at first: stability and damping, with their whole errors."""
    entries = model["coefficients"]
    rows = [
        [_explained(name), *_estimate_cells(entries[name])[:3]] if entries[name].get("value") is not None
        else [_explained(name), "not identified", NONE, NONE]
        for name in _MAIN if name in entries
    ]  # fmt: skip
    return table("Main derivatives, per rad", ["derivative", "value", "± (1 σ)", "95 % interval"], rows)


def axes(result: Result) -> str:
    """What the flight is worth for each axis."""
    found = (result.get("quality") or {}).get("axes", {})
    rows = [[text(axis), text(VERDICTS.get(one["verdict"], ""))] for axis, one in found.items()]
    return table("Axes", ["axis", "verdict"], rows)


def systematic(model: Result) -> str:
    """What was taken as known, and its part in the error of each coefficient."""
    entries = {name: entry["systematic"] for name, entry in _estimated(model).items() if entry.get("systematic")}
    causes = list(dict.fromkeys(cause for moved in entries.values() for cause in moved))
    rows = [[_named(name), *(number(moved.get(cause), 2) for cause in causes)] for name, moved in entries.items()]
    head = ["coefficient", *(_perturbation(cause) for cause in causes)]
    return table("What was taken as known: what such an error changes", head, rows)


def derivatives(found: Mapping[str, Mapping[str, Any]]) -> str:
    """Dimensional derivatives about the flight's mean."""
    rows = [
        [f"<code>{text(name)}</code>", *_estimate_cells(entry), text(entry["unit"])] for name, entry in found.items()
    ]
    caption = "Dimensional derivatives about the flight's mean: per mass or moment of inertia, which need not be known"
    return table(caption, ["derivative", "value", "± (1 σ)", "95 % interval", "relative σ", "unit (per rad)"], rows)


def _perturbation(cause: str) -> str:
    if cause.endswith(STATED):
        return f"{text(cause.removesuffix(STATED).replace('_', ' '))}, as the file states it"
    return _PERTURBATIONS.get(cause, text(cause))


def refused(result: Result) -> str:
    """What was not identifiable from the flight, why, and what would identify it."""
    rows = [
        [
            _named(one["name"]),
            text(one["reason"]),
            text(one.get("manoeuvre") or "–"),
        ]
        for one in result.get("refused", [])
    ]
    return table(
        "Refused: not identifiable from this flight", ["name", "reason", "manoeuvre that would identify it"], rows
    )


def sensor_errors(result: Result) -> str:
    """Errors of the sensors with standard error and unit."""
    rows = [
        [f"<code>{text(name)}</code>", *_estimate_cells(entry)[:3], text(entry.get("unit") or "1")]
        for name, entry in result.get("sensor_errors", {}).items()
    ]
    head = ["error", "value", "± (1 σ)", "95 % interval", "unit"]
    return table(
        "Errors of the sensors: measured = (1 + scale) true + bias; wind is the velocity of the air", head, rows
    )


def compatibility(result: Result) -> str:
    """How far each sensor is from the motion that all agree on, before and after correction."""
    found = result.get("compatibility") or {}
    before, after = found.get("before", {}), found.get("after", {})
    rows = [
        [text(name), *(number(fit.get(name, {}).get(key)) for fit in (before, after) for key in ("rms", "tic"))]
        for name in dict.fromkeys([*before, *after])
    ]
    head = ["sensor", "rms before", "TIC before", "rms after", "TIC after"]
    return table("Data compatibility before and after correction (SI units, rad)", head, rows)


def verdicts(result: Result) -> str:
    """The verdict on each sensor in words."""
    rows = [
        [text(one["signal"]), text(one["verdict"]), text(one["status"])]
        for one in (result.get("compatibility") or {}).get("verdicts", [])
    ]
    return table("Verdicts of the sensors", ["sensor", "verdict", "status"], rows)


def _plus_minus(entry: Mapping[str, Any], factor: float = 1.0) -> str:
    value, std = entry["value"], entry["std"]
    return f"{estimate(value, std, factor)} ± {number(std, 2, factor)}"


def modes(result: Result) -> str:
    """Modes with frequency, damping and time constant."""
    found = result.get("modes")
    if not isinstance(found, list):
        return f"<p>No modes: {text(found['refused'])}.</p>" if found else ""
    keys = ("frequency_hz", "damping_ratio", "time_constant_s")
    rows = []
    for mode in found:
        cells = []
        for key in keys:
            entry = mode.get(key)
            cells.append(
                NONE if entry is None else f"{estimate(entry['value'], entry['std'])} ± {standard_error(entry['std'])}"
            )
        rows.append([text(mode["name"]), *cells])
    head = ["mode", "undamped natural frequency, Hz", "damping ratio", "time constant, s"]
    return table("Modes about the mean airspeed (a negative time constant grows)", head, rows)


def validation(result: Result) -> str:
    """Figures of merit of each output on the flights that the model is judged by."""
    outputs = (result.get("validation") or {}).get("outputs", {})
    there = [key for key in _SCORES if any(entry.get(key) is not None for entry in outputs.values())]
    ordered = sorted(outputs.items(), key=lambda one: AXES.index(one[0]) if one[0] in AXES else len(AXES))
    rows = [[axis_symbol(name), *(_score(key, entry.get(key)) for key in there)] for name, entry in ordered]
    return table("Validation", ["output", *(_SCORES[key] for key in there)], rows)


def _score(key: str, value: float | None) -> str:
    return p_value(value, 3) if key == "gaussian_p" else number(value, 3)


def nuisances(result: Result) -> str:
    """What was estimated beside coefficients, and what was known of it before the flight."""
    rows = []
    for entry in result.get("nuisances") or []:
        words, unit, factor = unknown_words(entry)
        rows.append(
            [text(words), text(entry["group"]), _plus_minus(entry, factor), number(entry["prior_std"], 2, factor), unit]
        )
    return table("Between aircraft and log", ["unknown", "axes", "estimate", "known before to", "unit"], rows)


def validity(model: Result) -> str:
    """Ranges that the flights covered."""
    names = {"alpha": ("angle of attack", "deg", 180.0 / math.pi), "airspeed": ("airspeed", "m/s", 1.0)}
    rows = []
    for name, (low, high) in (model.get("validity") or {}).items():
        words, unit, factor = names.get(name, (name, "", 1.0))
        rows.append([text(words), number(low, 4, factor), number(high, 4, factor), unit])
    return table("Validity: the model says nothing outside", ["variable", "from", "to", "unit"], rows)


def segments(result: Result) -> str:
    """Parts of the flights that were taken."""
    rows = [
        [text(s["flight"]), number(s["start"]), number(s["end"]), text(s.get("kind", "")), text(s.get("reason") or "")]
        for s in result.get("segments", [])
    ]
    return table("Parts of the flights that were used", ["flight", "from, s", "to, s", "kind", "reason"], rows)
