"""Time histories of an identification: what was measured, what the model makes of the same inputs, and those."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gcs.report.discrepancy_figures import OUTPUTS, VARIABLES, within_reach
from gcs.report.svg import MEASURED, PREDICTED, Drawing, pages
from sysid.arrays import Array

Result = Mapping[str, Any]
# Three in a row, what moves the aircraft below what it does.
_ROWS = (
    ("V", "alpha", "beta"), ("p", "q", "r"), ("phi", "theta", "throttle"), ("ax", "ay", "az"), ("de", "da", "dr"),
)  # fmt: skip
_USES = {"estimation": "that the model was fitted to", "validation": "that the model was not fitted to"}


def every(series: Result) -> list[Drawing]:
    """A figure for each flight of the block `series`."""
    found = []
    for index, flight in enumerate(series.get("simulated") or []):
        caption = (
            f"Flight {flight['flight']}, {_USES.get(series.get('use', ''), '')}: measured (blue), and simulated by the"
            " model from the same inputs (red) over windows of 5 s; the inputs as they are taken"
        )
        found.append(Drawing(f"history{index}", caption, (7.4, 8.4), partial(draw, flight=flight)))
    return found


def draw(made: Figure, flight: Result) -> None:
    """Outputs and inputs over time."""
    time = _floats(flight["time_s"])
    drive = "thrust" if "thrust" in flight["inputs"] else "throttle"
    names = [drive if name == "throttle" else name for row in _ROWS for name in row]
    plots = pages(made, len(names), 3)
    for plot, name in zip(plots, names, strict=True):
        label, factor = {**VARIABLES, **OUTPUTS}.get(name, (name, 1.0))
        plot.set_ylabel(label)
        plot.sharex(plots[0])
        if name in flight["inputs"]:
            plot.plot(time, factor * _floats(flight["inputs"][name]), color="black", linewidth=0.7)
        elif (entry := flight["outputs"].get(name)) is None:
            plot.text(0.5, 0.5, "not measured", ha="center", va="center", transform=plot.transAxes)
        else:
            measured = factor * _floats(entry["measured"])
            plot.plot(time, measured, color=MEASURED, linewidth=1.6, alpha=0.6, label="measured")
            plot.plot(time, factor * _floats(entry["model"]), color=PREDICTED, linewidth=0.7, label="model")
            within_reach(plot, measured)
    for plot in plots[-3:]:
        plot.set_xlabel("time, s")
    made.legend(*plots[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)


def _floats(values: list[float | None]) -> Array:
    return np.array(values, dtype=np.float64)
