"""A flight without satellites: the page's figures."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gcs.report.svg import MEASURED, PREDICTED, Drawing

Result = Mapping[str, Any]
_INERTIAL = "#e0a030"
# Ellipses are drawn so often, s.
_EVERY_S = 10.0
# Inertia alone is followed beyond the others by this share of their extent.
_BEYOND = 0.6


def every(result: Result) -> list[Drawing]:
    """The track from above, and the drift over time."""
    seconds = result["seconds"]
    return [
        Drawing("coast-track", f"{seconds:.0f} s without GPS: where the aircraft was (GPS), where the model has it with"
                " its 95 % ellipses, and where inertia alone has it", (7.5, 6.0), partial(_track, result)),
        Drawing("coast-drift", "Drift over time, and the longer half axis of the 95 % ellipse", (7.5, 3.2),
                partial(_drift, result)),
    ]  # fmt: skip


def _columns(result: Result) -> dict[str, Any]:
    return {name: np.array(values) for name, values in result["series"].items()}


def _track(result: Result, made: Figure) -> None:
    columns = _columns(result)
    plot = made.subplots()
    plot.plot(columns["aircraft"][:, 1], columns["aircraft"][:, 0], color=MEASURED, label="GPS")
    plot.plot(columns["model"][:, 1], columns["model"][:, 0], color=PREDICTED, label="model")
    time_s = columns["time_s"] - columns["time_s"][0]
    from sysid.validation.coasting import CHI2_95

    shown = {*np.searchsorted(time_s, np.arange(_EVERY_S, time_s[-1], _EVERY_S)).tolist(), time_s.size - 1}
    round_ = np.linspace(0.0, 2.0 * np.pi, 73)
    circle = np.array([np.cos(round_), np.sin(round_)])
    ellipses = []
    for k in sorted(shown):
        root = np.linalg.cholesky(columns["covariance"][k] + 1e-9 * np.eye(2))
        ellipses.append(columns["model"][k][:, None] + np.sqrt(CHI2_95) * root @ circle)
        plot.plot(ellipses[-1][1], ellipses[-1][0], color=PREDICTED, linewidth=0.7, alpha=0.6)
    near = np.vstack([columns["aircraft"], columns["model"], *(one.T for one in ellipses)])
    low, high = near.min(axis=0), near.max(axis=0)
    far = _BEYOND * float(np.max(high - low))
    beyond = columns["inertial"].clip(low - far, high + far)
    low, high = np.minimum(low, beyond.min(axis=0)), np.maximum(high, beyond.max(axis=0))
    margin = 0.05 * float(np.max(high - low))
    plot.plot(columns["inertial"][:, 1], columns["inertial"][:, 0], color=_INERTIAL, label="inertia alone")
    plot.set_aspect("equal")
    plot.set_xlim(low[1] - margin, high[1] + margin)
    plot.set_ylim(low[0] - margin, high[0] + margin)
    plot.set_xlabel("east, m")
    plot.set_ylabel("north, m")
    plot.legend(loc="best")


def _drift(result: Result, made: Figure) -> None:
    columns = _columns(result)
    plot = made.subplots()
    time_s = columns["time_s"] - columns["time_s"][0]
    from sysid.validation.coasting import CHI2_95

    longest = np.sqrt(CHI2_95 * np.linalg.eigvalsh(columns["covariance"])[:, 1].clip(min=0.0))
    plot.fill_between(time_s, 0.0, longest, color=PREDICTED, alpha=0.2, linewidth=0.0, label="95 % of the model's")
    for name, colour, label in (("model", PREDICTED, "model"), ("inertial", _INERTIAL, "inertia alone")):
        plot.plot(time_s, np.hypot(*(columns[name] - columns["aircraft"]).T), color=colour, label=label)
    plot.set_xlabel("time without GPS, s")
    plot.set_ylabel("drift, m")
    plot.legend(loc="best")
