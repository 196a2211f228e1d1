"""Flights as the field has them: whether the bars of sensor errors, wind and dimensional derivatives hold.

Run: make campaign NAME=sensor-bars

Flights of tests/support/field_flight.py, identified by `auto` with the inertia as a builder knows it ("given"), guessed
to 70 % ("guessed") or left out of the vehicle file ("left out"). Every flight is a line of JSON in --store; what is
there already is not run again.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent / "support"))

import numpy as np
from field import read
from field_errors import dimensional_truth, sensor_truth
from field_flight import FAMILIES, FieldFlight, field_flight
from other_engine import version

from sim_vehicle.vehicle.mass_properties import usual_inertia
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.errors import SysidError
from sysid.identification.result_file import result_json
from sysid.identify import identify

KNOWN = ("given", "guessed", "left out")
GUESS = 0.7
Line = dict[str, Any]


def known_so(vehicle: Vehicle, how: str, seed: int) -> Vehicle:
    """The vehicle with its inertia given, off by a draw and stated so, or usual for its mass and span."""
    mass = vehicle.mass
    if how == "given":
        return vehicle
    if how == "guessed":
        off = np.exp(0.5 * GUESS * np.random.default_rng([seed, 31]).standard_normal(3))
        moments = {key: float(f) * getattr(mass, key) for key, f in zip(("Ixx", "Iyy", "Izz"), off, strict=True)}
        stds = {f"{key}_std": GUESS * value for key, value in moments.items()}
        return replace(vehicle, mass=replace(mass, **moments, **stds))
    usual = usual_inertia(mass.mass, vehicle.geometry.b)
    given = {key: value for key, (value, _) in usual.items()} | {f"{key}_std": std for key, (_, std) in usual.items()}
    return replace(vehicle, mass=replace(mass, **given, estimated=True))


def judge(family: str, seed: int, how: str, flight: FieldFlight) -> Line:
    """What goes into the store of one flight: estimate, standard error and the range that is true."""
    try:
        found = result_json(identify([flight.signals], known_so(flight.vehicle, how, seed)))
    except SysidError as error:
        return {"error": str(error)}
    sensors, derivatives = sensor_truth(family, seed, flight), dimensional_truth(seed, flight)
    told = {
        name: [entry["value"], entry["std"], sensors[name], sensors[name]]
        for name, entry in found["sensor_errors"].items()
        if name in sensors
    }
    of_aircraft = {
        name: [found["dimensional"][name]["value"], found["dimensional"][name]["std"], low, high]
        for name, (low, high) in derivatives.items()
        if name in found["dimensional"]
    }
    return {"method": found["method"], "sensors": told, "dimensional": of_aircraft}


def row(entries: Iterable[Sequence[float]]) -> str:
    """How many numbers, how many bars hold, the worst miss, and the median bar over the median size of the truth."""
    every = np.array(list(entries))
    if not every.size:
        return f"{0:>8}"
    value, std, low, high = every.T
    off = np.maximum(np.maximum(low - value, value - high), 0.0) / std
    size = np.median(std) / max(float(np.median(np.abs(low + high) / 2.0)), 1e-9)
    return f"{len(value):>8}{np.mean(off <= 1.96):>9.1%}{np.max(off):>9.1f}{size:>12.2f}"


def report(lines: Sequence[Line]) -> None:
    """Print the tables: by family and what was known, and by name."""
    head = f"{'':<32}{'numbers':>8}{'hold':>9}{'worst':>9}{'bar/size':>12}"
    for kind, title in (("sensors", "sensor errors and wind"), ("dimensional", "dimensional derivatives")):
        print(f"\n{title}\n{head}")
        groups: dict[str, list[Sequence[float]]] = defaultdict(list)
        for line in lines:
            for name, entry in line.get(kind, {}).items():
                for group in (line["family"], f"inertia {line['known']}", name, "all"):
                    groups[group].append(entry)
        for group, entries in groups.items():
            print(f"{group:<32}{row(entries)}")
    for line in lines:
        if "error" in line:
            print(f"{line['family']} {line['seed']} {line['known']}: {line['error']}")


def main() -> None:
    """Fly and estimate what is missing, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", default=",".join(one for one in FAMILIES if one != "stock"))
    parser.add_argument("--seeds", type=int, default=3, help="flights of each family")
    parser.add_argument("--known", default="all", help=f"of {', '.join(KNOWN)}")
    parser.add_argument("--store", type=Path, default=Path("campaign-output/sensor-bars/flights.jsonl"))
    options = parser.parse_args()
    options.store.parent.mkdir(parents=True, exist_ok=True)
    lines, now = read(options.store, "known"), version()
    known = KNOWN if options.known == "all" else tuple(options.known.split(","))
    flights = [(family, seed) for seed in range(options.seeds) for family in options.families.split(",")]
    for family, seed in flights:
        missing = [how for how in known if (family, seed, how, now) not in lines]
        if not missing:
            continue
        with tempfile.TemporaryDirectory() as folder:
            flight = field_flight(family, seed, Path(folder))
        for how in missing:
            key = {"family": family, "seed": seed, "known": how, "version": now}
            line = lines[family, seed, how, now] = {**key, **judge(family, seed, how, flight)}
            with options.store.open("a", encoding="utf-8") as store:
                store.write(json.dumps(line) + "\n")
            print(f"{family} {seed} {how}", file=sys.stderr, flush=True)
    report([lines[f, s, how, now] for f, s in flights for how in known if (f, s, how, now) in lines])


if __name__ == "__main__":
    main()
