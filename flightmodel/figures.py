"""Pictures of flights, models and their differences, with matplotlib."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from flightmodel.errors import FlightModelError
from sysid.signals.flight import FlightSignals

_SHOWN = (
    "airspeed",
    "true_airspeed",
    "alpha",
    "beta",
    "p",
    "q",
    "r",
    "phi",
    "theta",
    "ax",
    "ay",
    "az",
    "de",
    "da",
    "dr",
)
_IN_DEGREES = {"rad": ("deg", math.degrees(1.0)), "rad/s": ("deg/s", math.degrees(1.0))}
_MEASURED, _MODEL, _BAR = "#222222", "#d1495b", "#2a6f97"
_HEIGHT_EACH, _WIDTH, _DPI = 1.25, 8.0, 64
_KNOWN = (0.05, 500.0)  # % of a value that are drawn


class Picture(Figure):
    """A figure that a notebook shows by itself: those that pyplot did not make it would only name."""

    def _repr_png_(self) -> bytes:
        data = BytesIO()
        self.savefig(data, format="png", dpi=_DPI)
        return data.getvalue()


def _figure(rows: int, width: float = _WIDTH, height: float | None = None) -> Picture:
    return Picture(figsize=(width, 0.6 + _HEIGHT_EACH * rows if height is None else height), layout="constrained")


def time_histories(flight: FlightSignals, signals: Sequence[str] | None) -> Picture:
    """Signals (SI, angles in degrees) over time, an axis for each."""
    names = [name for name in (_SHOWN if signals is None else signals) if name in flight.signals]
    if not names:
        raise FlightModelError(f"{flight.name}: none of these signals is there; it has {', '.join(flight.signals)}")
    figure = _figure(len(names))
    for axes, name in zip(np.atleast_1d(figure.subplots(len(names), 1, sharex=True)), names, strict=True):
        one = flight.signals[name]
        unit, factor = _IN_DEGREES.get(one.unit, (one.unit, 1.0))
        axes.plot(one.time_s, factor * one.values, color=_MEASURED, linewidth=0.8)
        axes.set_ylabel(f"{name}\n{unit}" if unit else name)
        axes.grid(alpha=0.3)
    axes.set_xlabel("time, s")
    figure.suptitle(flight.name)
    return figure


def compared(
    time_s: Any, measured: Mapping[str, Any], model: Mapping[str, Any], units: Mapping[str, str], title: str
) -> Picture:
    """Measured outputs and a model's (N,) over time, an axis for each."""
    figure = _figure(len(measured))
    for axes, name in zip(np.atleast_1d(figure.subplots(len(measured), 1, sharex=True)), measured, strict=True):
        unit, factor = _IN_DEGREES.get(units.get(name, ""), (units.get(name, ""), 1.0))
        axes.plot(time_s, factor * measured[name], color=_MEASURED, linewidth=0.8, label="measured")
        axes.plot(time_s, factor * model[name], color=_MODEL, linewidth=1.0, label="model")
        axes.set_ylabel(f"{name}\n{unit}" if unit else name)
        axes.grid(alpha=0.3)
    axes.set_xlabel("time, s")
    figure.axes[0].legend(loc="upper right", fontsize=8)
    figure.suptitle(title)
    return figure


def coefficients(result: Mapping[str, Any]) -> Picture:
    """How well each coefficient is known, an axis for each force or moment; beside it measured and model, if kept."""
    groups: dict[str, list[tuple[str, float, float]]] = {}
    for name, entry in result["model"]["coefficients"].items():
        if entry.get("std"):
            groups.setdefault(name.partition("_")[0], []).append((name, entry["value"], 1.96 * entry["std"]))
    if not groups:
        raise FlightModelError("the model holds no estimated coefficient to draw")
    series = (result.get("series") or {}).get("flights") or []
    figure = _figure(len(groups), 10.0, 1.9 * len(groups) + 0.6)
    grid = figure.subplots(len(groups), 2 if series else 1, squeeze=False)
    for row, (group, entries) in zip(grid, groups.items(), strict=True):
        _bars(row[0], entries)
        if series:
            _fit(row[1], group, series)
    figure.suptitle(f"{result['model']['name']}: how well each is known" + ("; measured and model" if series else ""))
    return figure


def _bars(axes: Any, entries: Sequence[tuple[str, float, float]]) -> None:
    places = range(len(entries))
    low, high = _KNOWN
    shares = [100.0 * bar / abs(value) if value else high for _, value, bar in entries]
    axes.barh(places, [min(max(share, low), high) for share in shares], color=_BAR, height=0.6)
    labels = [f"{name}  {value:.4g} ± {bar:.2g}" for name, value, bar in entries]
    axes.set_yticks(places, labels, fontsize=8)
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    axes.set_xlabel("95 % interval, ± % of the value", fontsize=8)
    axes.grid(axis="x", alpha=0.3)


def _fit(axes: Any, group: str, series: Sequence[Mapping[str, Any]]) -> None:
    for number, flight in enumerate(series):
        entry = flight["axes"].get(group)
        if entry is None:
            continue
        labels = ("measured", "model") if number == 0 else (None, None)
        axes.plot(entry["time_s"], entry["measured"], color=_MEASURED, linewidth=0.7, label=labels[0])
        axes.plot(entry["time_s"], entry["predicted"], color=_MODEL, linewidth=0.9, label=labels[1])
    axes.set_ylabel(group)
    axes.set_xlabel("time, s")
    axes.grid(alpha=0.3)
    if axes.lines:
        axes.legend(loc="upper right", fontsize=7)


def gaps(result: Mapping[str, Any]) -> Picture:
    """How far simulation strays from measurement, before and after what is missing was added, in noise floors."""
    gap = result["gap"].get("validation") or result["gap"]["estimation"]
    floor = gap["noise_floor"]
    stages = [(key, label) for key, label in _STAGES if key in gap]
    figure = _figure(1, 10.0, 4.0)
    axes = figure.subplots()
    width = 0.8 / len(stages)
    for number, (key, label) in enumerate(stages):
        heights = [gap[key].get(name, math.nan) / floor[name] for name in floor]
        axes.bar(
            [k + (number - 0.5 * (len(stages) - 1)) * width for k in range(len(floor))], heights, width, label=label
        )
    axes.set_xticks(range(len(floor)), list(floor))
    axes.set_yscale("log")
    axes.set_ylabel("RMS over 5 s, noise floors")
    axes.legend(fontsize=8)
    axes.grid(axis="y", alpha=0.3)
    named = ", ".join(effect["title"] for effect in result.get("effects", [])) or "no effect named"
    figure.suptitle(f"Simulation against measurement: {named}")
    return figure


_STAGES = (("given", "model as given"), ("before", "coefficients fitted again"), ("after", "effect added"))
