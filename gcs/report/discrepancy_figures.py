"""Figures of a discrepancy's result: the simulations over the measurement, the residual's curve, the gap by stages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gcs.report.svg import LIMIT, MEASURED, PREDICTED, Drawing, pages
from sysid.arrays import Array
from sysid.discrepancy.summary import shrinking

Result = Mapping[str, Any]
STAGES = {"given": "as given", "before": "fitted again", "after": "effect added", "noise_floor": "noise floor"}
#: Outputs of a flight that are drawn, those whose gap shrinks most.
MOSTOUTPUTS = 4
_Z95 = 1.96
_DEGREES = 180.0 / math.pi
_SIMULATED, _GIVEN = "#2e8b57", "#e0a030"
_COLOURS = {"given": _GIVEN, "before": PREDICTED, "after": _SIMULATED}
#: What is drawn on the axes of a quantity: (label, factor from SI).
OUTPUTS = {
    "V": ("V, m/s", 1.0), "alpha": ("α, deg", _DEGREES), "beta": ("β, deg", _DEGREES), "p": ("p, deg/s", _DEGREES),
    "q": ("q, deg/s", _DEGREES), "r": ("r, deg/s", _DEGREES), "phi": ("φ, deg", _DEGREES),
    "theta": ("θ, deg", _DEGREES), "ax": ("ax, m/s²", 1.0), "ay": ("ay, m/s²", 1.0), "az": ("az, m/s²", 1.0),
}  # fmt: skip
VARIABLES = {
    "alpha": ("α, deg", _DEGREES), "beta": ("β, deg", _DEGREES), "V": ("V, m/s", 1.0), "phat": ("p b / 2V", 1.0),
    "qhat": ("q c / 2V", 1.0), "rhat": ("r b / 2V", 1.0), "alphadot": ("α̇ c / 2V", 1.0),
    "de": ("elevator, deg", _DEGREES), "da": ("aileron, deg", _DEGREES), "dr": ("rudder, deg", _DEGREES),
    "thrust": ("thrust, N", 1.0), "throttle": ("throttle", 1.0),
}  # fmt: skip
_MODELS = {"given": "the model as given", "before": "the model fitted again", "after": "the model with the effect"}
_USES = {"estimation": "used for the fit", "validation": "not used for the fit"}
# Above this range of ratios bars are drawn over a logarithmic scale.
_WIDE = 20.0
# How far beyond the measurement's own range a simulation that runs away is followed.
_MARGIN = 0.6


def every(result: Result) -> list[Drawing]:
    """All figures of a result of schema discrepancy/1, in the order of the report."""
    return [*residual_curves(result), *gap_bars(result), *simulations(result)]


def simulations(result: Result) -> list[Drawing]:
    """Per flight the measurement and two free-running simulations over it."""
    found = []
    for use, flights in (result.get("series") or {}).items():
        for index, flight in enumerate(flights or []):
            stages = [stage for stage in _COLOURS if any(stage in entry for entry in flight["outputs"].values())]
            names = _chosen((result.get("gap") or {}).get(use) or {}, stages, flight["outputs"])
            if not names:
                continue
            models = " and ".join(_MODELS[stage] for stage in stages)
            caption = (
                f"Flight {flight['flight']}, {_USES.get(use, use)}: measurement, and free-running simulations over "
                f"windows of 5 s by {models}; the outputs whose gap shrinks most"
            )
            draw = partial(draw_simulations, flight=flight, outputs=names, stages=stages)
            found.append(Drawing(f"gap-{use}{index}", caption, (7.4, 1.6 * len(names) + 0.5), draw))
    return found


def draw_simulations(made: Figure, flight: Result, outputs: Sequence[str], stages: Sequence[str]) -> None:
    """One plot below another for each output of a flight of `series`."""
    time = _floats(flight["time_s"])
    plots = pages(made, len(outputs), 1)
    for plot, name in zip(plots, outputs, strict=True):
        entry, (label, factor) = flight["outputs"][name], OUTPUTS.get(name, (name, 1.0))
        measured = factor * _floats(entry["measured"])
        plot.plot(time, measured, color=MEASURED, linewidth=3.0, alpha=0.45, label="measured")
        for stage in stages:
            plot.plot(time, factor * _floats(entry[stage]), color=_COLOURS[stage], label=STAGES[stage])
        within_reach(plot, measured)
        plot.set_ylabel(label)
        plot.sharex(plots[0])
    plots[-1].set_xlabel("time, s")
    made.legend(*plots[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(stages) + 1)


def within_reach(plot: Any, measured: Array) -> None:
    """Follow a simulation that runs away no further than this beyond the measurement's own range."""
    low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
    margin = _MARGIN * max(high - low, 1e-9)
    bottom, top = plot.get_ylim()
    plot.set_ylim(max(bottom, low - margin), min(top, high + margin))


def residual_curves(result: Result) -> list[Drawing]:
    """For every axis that disagrees, its residual over the variable that explains it."""
    places = [place for place in result.get("where", []) if place.get("curve")]
    if not places:
        return []
    model = _MODELS["given" if result.get("verdict") == "parameter_error" else "before"]
    caption = (
        f"Residual coefficients, measured minus {model}, over the variable that each depends on most: means of "
        "eight parts of equally many samples with 95 % bands"
    )
    columns = min(3, len(places))
    size = (2.5 * columns if columns > 1 else 4.5, 2.4 * -(-len(places) // columns))
    return [Drawing("where", caption, size, partial(draw_curves, places=places))]


def draw_curves(made: Figure, places: Sequence[Result]) -> None:
    """A plot for each entry of `where`."""
    for plot, place in zip(pages(made, len(places), min(3, len(places))), places, strict=True):
        label, factor = VARIABLES.get(place["variable"], (place["variable"], 1.0))
        value = factor * _floats([one["value"] for one in place["curve"]])
        residual, std = (_floats([one[key] for one in place["curve"]]) for key in ("residual", "std"))
        plot.fill_between(value, residual - _Z95 * std, residual + _Z95 * std, color=MEASURED, alpha=0.3, linewidth=0.0)
        plot.plot(value, residual, "o-", color=MEASURED, markersize=3.0)
        plot.axhline(0.0, color="black", linewidth=0.6)
        plot.set_title(f"residual of $C_{{{place['axis'][1:]}}}$", fontsize=9)
        plot.set_xlabel(label)


def shown_gaps(result: Result) -> dict[str, Result]:
    """The gaps of each set of flights, at the stage `after` only where an effect was added.

    On flights that were not fitted the stages differ a little even where both are of the same model.
    """
    added = result.get("verdict") == "missing_effect"
    gaps = {use: gap for use, gap in (result.get("gap") or {}).items() if gap}
    return {use: {s: gap[s] for s in gap if added or s != "after"} for use, gap in gaps.items()}


def gap_bars(result: Result) -> list[Drawing]:
    """For each set of flights the gaps of all stages over their noise floors."""
    found = []
    for use, gap in shown_gaps(result).items():
        if gap.get("noise_floor"):
            caption = f"Gap on the flights {_USES.get(use, use)}, in times of the noise floor (dashed) at each stage"
            found.append(Drawing(f"bars-{use}", caption, (7.4, 2.4), partial(_one_plot, gap=gap)))
    return found


def _one_plot(made: Figure, gap: Result) -> None:
    draw_bars(made.subplots(), gap)


def draw_bars(plot: Axes, gap: Result) -> None:
    """Bars of gap over noise floor, one group for each output and one bar for each stage that it has."""
    floor = {name: value for name, value in gap["noise_floor"].items() if value}
    stages = [s for s in _COLOURS if gap.get(s)]
    width = 0.8 / max(len(stages), 1)
    ratios = {s: _floats([_ratio(gap[s].get(name), value) for name, value in floor.items()]) for s in stages}
    for place, stage in enumerate(stages):
        middle = np.arange(len(floor)) + (place - 0.5 * (len(stages) - 1)) * width
        plot.bar(middle, ratios[stage], width, color=_COLOURS[stage], label=STAGES[stage])
    plot.axhline(1.0, color=LIMIT, linestyle="--", linewidth=0.9)
    plot.set_xticks(np.arange(len(floor)), [OUTPUTS.get(name, (name,))[0].partition(",")[0] for name in floor])
    plot.set_ylabel("gap / noise floor")
    if any(np.nanmax(values, initial=0.0) > _WIDE for values in ratios.values()):
        plot.set_yscale("log")
    plot.legend(ncols=max(len(stages), 1), loc="lower center", bbox_to_anchor=(0.5, 1.0))


def _chosen(gap: Mapping[str, Any], stages: Sequence[str], there: Result) -> list[str]:
    """Outputs to draw: those whose gap shrinks most from the first of the stages to the last."""
    ordered = shrinking(gap, stages[0], stages[-1]) if stages else []
    return [name for name in [*ordered, *(n for n in there if n not in ordered)] if name in there][:MOSTOUTPUTS]


def _ratio(value: float | None, floor: float) -> float | None:
    return None if value is None else value / floor


def _floats(values: Sequence[float | None]) -> Array:
    """Numbers, NaN where the file has null."""
    return np.array(values, dtype=np.float64)
