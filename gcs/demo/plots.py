"""The picture at the end of the demonstration: estimates against the truth, and the gap before and after."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from gcs.text.intervals import of_the_flight
from gcs.text.probability_text import percent_text

_STAGES = ("given", "before", "after", "noise_floor")
_LABELS = ("model as given", "coefficients fitted again", "effect added", "noise floor")
_COLOURS = ("#9aa0a6", "#4c78a8", "#e4572e", "#222222")


def draw(result: dict[str, Any], truth: dict[str, float], found: dict[str, Any], path: Path) -> None:
    """Write a PNG: errors of the coefficients in standard errors, and the gap on the second flight."""
    mpl.use("Agg")
    figure = Figure(figsize=(12.0, 5.2), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2)
    _coefficients(left, result["model"]["coefficients"], truth)
    _gap(right, found)
    figure.savefig(path)


def _coefficients(axes: Any, entries: dict[str, Any], truth: dict[str, float]) -> None:
    estimated = {name: e for name, e in entries.items() if e.get("std")}
    names = list(estimated)
    sizes = [abs(truth.get(name, 0.0)) for name in names]
    scale = [size if size > 0.0 else 1.0 for size in sizes]
    error = [100.0 * (estimated[n]["value"] - truth.get(n, 0.0)) / s for n, s in zip(names, scale, strict=True)]
    rows = range(len(names))
    for of, width, label in (
        (lambda entry: entry["std"], 1.0, "whole error: mass to 1 %, inertia and travel to 5 %, density to 2 %"),
        (of_the_flight, 4.0, "of the flight alone"),
    ):
        bar = [196.0 * (of(estimated[n]) or 0.0) / s for n, s in zip(names, scale, strict=True)]
        axes.errorbar(
            error, rows, xerr=bar, fmt="o", markersize=3, color=_COLOURS[1], capsize=2, elinewidth=width, label=label
        )
    axes.legend(fontsize=7, loc="lower center", bbox_to_anchor=(0.5, -0.2), ncols=2, frameon=False)
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.set_yticks(rows, names, fontsize=7)
    axes.invert_yaxis()
    axes.set_xscale("symlog", linthresh=0.1)
    axes.set_xlabel("estimate − truth, % of the truth (of 1 where the truth is 0), with 95 % interval")
    axes.set_title("Identified from one recorded flight")
    axes.grid(axis="x", alpha=0.3)


def _gap(axes: Any, found: dict[str, Any]) -> None:
    gap = found["gap"].get("validation") or found["gap"]["estimation"]
    names = list(gap["noise_floor"])
    width = 0.2
    for i, (stage, label, colour) in enumerate(zip(_STAGES, _LABELS, _COLOURS, strict=True)):
        heights = [gap[stage].get(name, float("nan")) / gap["noise_floor"][name] for name in names]
        axes.bar([k + (i - 1.5) * width for k in range(len(names))], heights, width, label=label, color=colour)
    axes.set_xticks(range(len(names)), names)
    axes.set_yscale("log")
    axes.set_ylabel("RMS gap over 5 s windows, in units of the noise floor")
    effects = ", ".join(f"{e['title']} ({percent_text(e['probability'])})" for e in found["effects"]) or "no effect"
    title = "\n".join(textwrap.wrap(f"Missing effect found: {effects}", 70))
    axes.set_title(f"{title}\n(gap on a flight that nothing was fitted to)", fontsize=11)
    # Above the highest bar: the legend hid the output with the largest gap.
    axes.set_ylim(top=4.0 * axes.get_ylim()[1])
    axes.legend(fontsize=8, ncols=2, loc="upper center")
    axes.grid(axis="y", alpha=0.3)
