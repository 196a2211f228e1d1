"""A flight without satellites for a while, on a model: the JSON and the lines of `gcs coast`."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gcs.analysis.postflight import load_flown, read_flights
from gcs.analysis.provenance import made
from gcs.errors import SettingsError
from sim_vehicle.model.model_file import Model
from sysid.arrays import Array

_WITHOUT = re.compile(r"gps:(\d+(?:\.\d+)?)")
_LEAST_S, _MOST_S = 5.0, 600.0


def seconds_without(text: str) -> float:
    """How long there is no GPS, s, of "gps:60". Raises SettingsError."""
    found = _WITHOUT.fullmatch(text)
    seconds = float(found[1]) if found else math.nan
    if not _LEAST_S <= seconds <= _MOST_S:
        raise SettingsError(f"--without {text}: give gps: and the seconds, from {_LEAST_S:g} to {_MOST_S:g}, as gps:60")
    return seconds


def coast(
    path: Path,
    vehicle: Path,
    model: Model,
    seconds: float,
    *,
    start_s: float | None = None,
    system: int | None = None,
    progress: Callable[[float, str], None] = lambda share, text: None,
) -> dict[str, Any]:
    """Coast on a model; the JSON of schema coast/1. Raises GcsError, SysidError, SimVehicleError in one line."""
    from sim_vehicle.vehicle.packed_model import flatten
    from sysid.identification.repaired_flight import meant
    from sysid.problem.free_run import Fixed
    from sysid.validation.coasting import coast as run

    craft = load_flown(vehicle, [path], system)
    progress(0.0, "reading the recording")
    (flight,) = read_flights([path], craft, system)
    progress(0.3, "units, signs and axes")
    prepared = meant(flight, craft).prepared
    doubtful = model.refused()
    progress(0.6, "flying on without GPS")
    found = run(prepared, craft, Fixed(flatten(craft, model.with_starts()), {}), seconds, start_s)
    ends = found.covariance[-1]
    return {
        "schema": "coast/1", "flight": flight.name, "model": model.name, "vehicle": craft.name,
        "start": float(found.time_s[0]), "seconds": float(found.time_s[-1] - found.time_s[0]),
        "before": found.before_s, "distance": found.distance, "wind": list(found.wind),
        "drift": float(found.drift[-1]), "inertial_drift": float(found.inertial_drift[-1]),
        "ellipse": ellipse(ends), "inside": found.inside,
        "series": {
            "time_s": _rounded(found.time_s), "aircraft": _rounded(found.aircraft), "model": _rounded(found.by_model),
            "inertial": _rounded(found.by_inertia), "covariance": _rounded(found.covariance),
        },
        "warnings": [*craft.warnings, *prepared.warnings, *(
            [f"not identified, and flown by the mean of a refused estimate: {', '.join(doubtful)}"] if doubtful else []
        )],
        "made": made({"vehicle": craft.name, "without": f"gps:{seconds:g}", "at": start_s, "system": system},
                     [path, craft.path]),
    }  # fmt: skip


def ellipse(covariance: Array) -> dict[str, float]:
    """The 95 % ellipse: half of its axes, m, and where the longer one points, rad from north to east."""
    from sysid.validation.coasting import CHI2_95

    sizes, axes = np.linalg.eigh(covariance)
    half = np.sqrt(CHI2_95 * np.maximum(sizes, 0.0))
    north, east = axes[:, 1]
    return {"semi_major": float(half[1]), "semi_minor": float(half[0]), "direction": math.atan2(east, north) % math.pi}


def _rounded(values: Array) -> Any:
    return np.round(values, 3).tolist()


def coast_text(found: Mapping[str, Any]) -> str:
    """What is said of it."""
    size, where = found["ellipse"], "within" if found["inside"] else "OUTSIDE"
    wind = math.hypot(*found["wind"])
    lines = [
        f"{found['flight']}: {found['seconds']:.0f} s without GPS from {found['start']:.0f} s on,"
        f" {found['distance']:.0f} m flown",
        f"  on {found['model']}: {found['drift']:.1f} m from where it was, {where} its 95 % ellipse"
        f" ({size['semi_major']:.0f} m by {size['semi_minor']:.0f} m)",
        f"  by inertia alone: {found['inertial_drift']:.0f} m",
        f"  wind of {wind:.1f} m/s as the {found['before']:.0f} s before showed it",
    ]
    return "\n".join([*lines, *(f"warning: {one}" for one in found["warnings"])])
