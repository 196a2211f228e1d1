"""How far a flight on its model strays in a minute without GPS, and whether the ellipse holds that.

Run: make campaign NAME=coast

Flights of tests/support/field_flight.py (JSBSim, with the sensors, servos and air of the field) of at least 150 s, each
identified by `auto` and then without GPS for a minute, twice: from 35 s before the middle on, and at its end. Every cut
is a line of JSON in --store; what is there already is not run again.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent / "support"))

import numpy as np
from field_flight import fly_plan, plan_of
from resumable import resumable

from sim_vehicle.vehicle.packed_model import flatten
from sysid.errors import SysidError
from sysid.identification.repaired_flight import meant
from sysid.identify import identify
from sysid.problem.free_run import Fixed
from sysid.validation.coasting import coast

FAMILIES = ("mild", "typical", "rough", "closed-loop", "slow")
SECONDS, LEAST_S = 60.0, 150.0
Line = dict[str, Any]


def cuts(family: str, seed: int) -> list[Line]:
    """Both cuts of a flight."""
    plan = plan_of(family, seed)
    plan = replace(plan, seconds=max(plan.seconds, LEAST_S))
    try:
        with tempfile.TemporaryDirectory() as folder:
            flight = fly_plan(plan, seed, Path(folder), "flight")
        found = identify([flight.signals], flight.vehicle)
        model = Fixed(flatten(flight.vehicle, found.model.with_starts()), {})
        prepared = meant(flight.signals, flight.vehicle).prepared
        lines = []
        for start in (0.5 * plan.seconds - 35.0, None):
            one = coast(prepared, flight.vehicle, model, SECONDS, start)
            off = (one.by_model - one.aircraft)[-1]
            lines.append({
                "drift": float(one.drift[-1]), "inertial": float(one.inertial_drift[-1]), "inside": one.inside,
                "chi2": float(off @ np.linalg.solve(one.covariance[-1], off)), "distance": one.distance,
            })  # fmt: skip
    except SysidError as error:
        return [{"error": str(error)}]
    return lines


def report(lines: Sequence[Line]) -> None:
    """By family: cuts, the median drift on the model and by inertia, and how many ellipses hold."""
    head = ("cuts", "flown, m", "model, m", "inertia, m", "ratio", "hold")
    print(f"{'':<14}" + "".join(f"{one:>12}" for one in head))
    for family in (*dict.fromkeys(line["family"] for line in lines), "all"):
        group = [one for line in lines if family in (line["family"], "all") for one in line["cuts"] if "drift" in one]
        if not group:
            continue
        flown, model, inertia = (np.median([one[key] for one in group]) for key in ("distance", "drift", "inertial"))
        held = np.mean([one["inside"] for one in group])
        drifts = f"{flown:>12.0f}{model:>12.1f}{inertia:>12.0f}{model / inertia:>12.3f}"
        print(f"{family:<14}{len(group):>12}{drifts}{held:>12.1%}")
    for line in lines:
        for one in line["cuts"]:
            if "error" in one:
                print(f"{line['family']} {line['seed']}: {one['error']}")


if __name__ == "__main__":
    resumable("coast", __doc__, FAMILIES, 6, lambda family, seed: {"cuts": cuts(family, seed)}, report)
