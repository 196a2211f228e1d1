"""How an aircraft performs: the page's figures and its table."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gcs.report.markup import NONE, number, table, text
from gcs.report.svg import LIMIT, MEASURED, PREDICTED, Drawing
from gcs.text.performance_words import WORDS

Result = Mapping[str, Any]


def figures(result: Result) -> str:
    """Each figure with its interval, or why there is none."""
    rows = []
    for name, entry in result["figures"].items():
        if "refused" in entry:
            rows.append([text(WORDS[name]), NONE, NONE, NONE, text(entry["refused"])])
            continue
        ends = entry.get("interval")
        between = NONE if ends is None else f"{number(ends[0], 3)} … {number(ends[1], 3)}"
        unit = "" if entry["unit"] == "1" else text(entry["unit"])
        beyond = "beyond what was flown" if entry["extrapolated"] else ""
        rows.append([text(WORDS[name]), number(entry["value"], 3), between, unit, beyond])
    return table("Figures", ("", "Value", "95 % interval", "Unit", "Remark"), rows)


def every(result: Result) -> list[Drawing]:
    """Drag and thrust over airspeed, and the polar."""
    known = any(row.get("thrust_available") is not None for row in result["speeds"])
    thrust = ", and thrust at full throttle" if known else ""
    return [
        Drawing("performance-drag", f"Drag in level flight over airspeed with its 95 % interval{thrust}; dashed: beyond"
                " what was flown", (7.5, 3.6), partial(_drag, result)),
        Drawing("performance-polar", "Polar of level flight; dashed: beyond what was flown", (7.5, 3.6),
                partial(_polar, result)),
    ]  # fmt: skip


def _columns(result: Result, *names: str) -> list[np.ndarray]:
    rows = result["speeds"]
    return [np.array([np.nan if row.get(name) is None else row[name] for row in rows], np.float64) for name in names]


def _both(plot: Any, result: Result, along: np.ndarray, values: np.ndarray, label: str) -> None:
    """A curve, dashed where it was not flown."""
    flown = np.array([row["extrapolated"] is not True for row in result["speeds"]])
    plot.plot(along, values, color=PREDICTED, linestyle="--", linewidth=0.9)
    plot.plot(np.where(flown, along, np.nan), values, color=PREDICTED, label=label)


def _drag(result: Result, made: Figure) -> None:
    speed, drag, thrust = _columns(result, "speed", "drag", "thrust_available")
    plot = made.subplots()
    ends = np.array([row.get("drag_interval") or (np.nan, np.nan) for row in result["speeds"]], np.float64)
    if np.isfinite(ends).any():
        plot.fill_between(speed, *ends.T, color=PREDICTED, alpha=0.2, linewidth=0.0, label="95 % interval")
    _both(plot, result, speed, drag, "drag in level flight")
    if np.isfinite(thrust).any():
        plot.plot(speed, thrust, color=MEASURED, label="thrust at full throttle")
    for name, words in (("best_glide_speed", "best glide"), ("min_sink_speed", "least sink")):
        entry = result["figures"].get(name, {})
        if "value" in entry:
            plot.axvline(entry["value"], color=LIMIT, linewidth=0.7)
            plot.annotate(words, (entry["value"], 0.02), xycoords=("data", "axes fraction"), rotation=90, fontsize=8)
    plot.set_xlabel("airspeed, m/s")
    plot.set_ylabel("N")
    plot.legend(loc="best")


def _polar(result: Result, made: Figure) -> None:
    lift, drag = _columns(result, "CL", "CD")
    plot = made.subplots()
    _both(plot, result, drag, lift, "level flight")
    plot.set_xlim(left=0.0)
    plot.set_xlabel("CD")
    plot.set_ylabel("CL")
    plot.legend(loc="best")
