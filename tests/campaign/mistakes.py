"""Mistakes put into the signals of simulated flights: which are named, and what they do.

Run: make campaign NAME=mistakes

Every kind of mistake of tests/support/signal_mistakes.py, flight by flight, identified as a user does who knows of
nothing. A mistake harms if a coefficient that is reported changes by five of its bars from the flight without it, noise
and all else the same. Clean flights in calm air and gusts show the false alarms. Every result is a line of JSON in
--out; what is there already is not run again.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
import warnings
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent / "support"))

import numpy as np
from own_bars import own_bar
from signal_mistakes import Injection, injections
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.errors import SysidError
from sysid.identify import identify
from sysid.signals.flight import FlightSignals

VEHICLES = ("iitb-mav", "ultrastick25e")
MANOEUVRES = ("multisine", "elevator-3211", "elevator-3211,aileron-doublet,rudder-doublet", "elevator-pulse")
GUSTS = (0.0, 0.3, 1.0)
CLEAN_SEEDS = range(100, 113)
BIG = 5.0
# The hardest to tell first.
KINDS = ("delay", "scale", "axis", "sign", "unit")
# What the estimate finds between aircraft and log: kind of mistake, signals, value of none, least that is told.
NUISANCES = {
    "servo_delay": ("delay", ("de", "da", "dr"), 0.01, 0.012),
    "command_clock": ("delay", ("de", "da", "dr"), 0.0, 0.004),
    "vane_clock": ("delay", ("alpha", "beta"), 0.0, 0.004),
    "airspeed_lag": ("delay", ("airspeed",), 0.0, 0.004), "alpha_scale": ("scale", ("alpha",), 1.0, 0.03),
    "beta_scale": ("scale", ("beta",), 1.0, 0.03), "airspeed_error": ("scale", ("airspeed",), 0.0, 0.03),
}  # fmt: skip
NUISANCE_SEEN = 3.0
LATERAL = ("da", "dr", "beta")
# Scale errors that the estimate corrects are a mistake told from this size on.
SCALE_TOLD = 0.03


def fly(vehicle: str, manoeuvres: str, gusts: float, seed: int) -> FlightSignals:
    """One flight with sensors of Table II, with a steady wind that the seed chooses."""
    effects = [f"steady_wind:north={seed % 5 - 2},east={seed % 3 - 1},down=0"]
    effects += [f"turbulence:sigma={gusts:g},length=30"] if gusts else []
    craft, model = load_vehicle(vehicle), read_model(vehicle)
    return fly_mav(manoeuvres, seed, effects=tuple(effects), vehicle=craft, model=model)[0]


@dataclass(frozen=True)
class Told:
    """What an identification without an option says of a flight.

    line: what it stops with, empty where it does not. findings: of mistakes, and of what the estimate found between
    aircraft and log. values: coefficient -> value, standard error.
    """

    line: str
    findings: list[dict[str, Any]]
    values: dict[str, tuple[float, float]]


def told(flight: FlightSignals, vehicle: str) -> Told:
    """Identify as a user does who knows of nothing."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = identify([flight], load_vehicle(vehicle), systematic=False)
    except SysidError as error:
        return Told(str(error).partition(": ")[2], [], {})
    findings = [one.to_json() for one in found.mistakes]
    for name, (value, std, _) in found.sensor_errors.items():
        if name.endswith("_scale") and abs(value) > max(2.0 * std, SCALE_TOLD):
            findings.append(_finding("scale", name.removesuffix("_scale"), f"reads {1.0 + value:.3g} of true"))
    for one in () if found.posterior is None else found.posterior.nuisances:
        kind, signals, null, least = NUISANCES.get(one.name, ("", (), 0.0, 0.0))
        if kind and abs(one.value - null) > max(NUISANCE_SEEN * one.std, least):
            mine = [name for name in signals if one.group == "both" or (name in LATERAL) == (one.group == "lateral")]
            findings += [_finding(kind, name, f"{one.name} {one.value:.3g}") for name in mine]
    entries = found.model.coefficients.items()
    values = {n: (e.value, own_bar(e)) for n, e in entries if e.value is not None and e.std is not None}
    return Told("", findings, values)


def _finding(kind: str, signal: str, text: str) -> dict[str, Any]:
    return {"kind": kind, "signals": [signal], "sentence": f"{signal} {text}"}


def harm(wrong: Told, clean: Told) -> float:
    """Largest change of a coefficient that is reported with and without the mistake, in its bars of both."""
    both = wrong.values.keys() & clean.values.keys()
    return max(
        (abs(wrong.values[n][0] - clean.values[n][0]) / np.hypot(wrong.values[n][1], clean.values[n][1]) for n in both),
        default=0.0,
    )


def named(one: Injection, line: str, findings: list[dict[str, Any]]) -> bool:
    """Whether a mistake is found under its kind and for its signals."""
    if line:
        return any(re.search(rf"\b{name}\b", line) for name in one.signals)
    return any(entry["kind"] == one.kind and set(entry["signals"]) & set(one.signals) for entry in findings)


def blamed(one: Injection, findings: list[dict[str, Any]]) -> list[str]:
    """Signals without a mistake that are said to have one. A group against all else is all else against the group."""
    told = {name for entry in findings for name in entry["signals"]}
    return sorted(told - set(one.signals))


class Results:
    """Lines of JSON, by key; of several lines with a key the last one counts."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        self.rows = {row["key"]: row for row in map(json.loads, lines)}

    def add(self, row: dict[str, Any]) -> None:
        """Keep a row and write it at once."""
        self.rows[row["key"]] = row
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


def run_clean(results: Results, seeds: range, vehicles: Sequence[str], deadline: float) -> None:
    """False alarms."""
    for seed in seeds:
        for vehicle in vehicles:
            for manoeuvres in MANOEUVRES:
                for gusts in GUSTS:
                    key = f"clean|{vehicle}|{manoeuvres}|{gusts:g}|{seed}"
                    if key in results.rows or time.monotonic() > deadline:
                        continue
                    found = told(fly(vehicle, manoeuvres, gusts, seed), vehicle)
                    # Scale errors of Table II are true, and what is found between aircraft and log is no claim.
                    claims = [str(one["sentence"]) for one in found.findings if "found" in one]
                    said = found.line or "; ".join(claims)
                    results.add({"key": key, "kind": "clean", "gusts": gusts, "said": said})


def run_injected(results: Results, seeds: range, vehicles: Sequence[str], stride: int, deadline: float) -> None:
    """Each mistake in one flight: whether it is named, and what it does to the coefficients that are reported."""
    for seed in seeds:
        for vehicle in vehicles:
            flight = fly(vehicle, "multisine", 0.0, seed)
            clean = told(flight, vehicle)
            for number, one in sorted(enumerate(injections()), key=lambda entry: KINDS.index(entry[1].kind)):
                key = f"{one.name}|{vehicle}|{seed}"
                if (number + seed) % stride or key in results.rows or time.monotonic() > deadline:
                    continue
                found = told(one.apply(flight), vehicle)
                said = found.line or "; ".join(str(entry["sentence"]) for entry in found.findings)
                results.add(
                    {
                        "key": key, "kind": one.kind, "signals": list(one.signals), "stopped": bool(found.line),
                        "found": named(one, found.line, found.findings), "harm": harm(found, clean), "said": said,
                        "blamed": blamed(one, found.findings),
                    }
                )  # fmt: skip


def table(results: Results) -> None:
    """The figures."""
    rows = list(results.rows.values())
    clean = [row for row in rows if row["kind"] == "clean"]
    print(f"\nclean flights: {len(clean)}, false alarms: {sum(bool(row['said']) for row in clean)}")
    for row in clean:
        if row["said"]:
            print(f"  {row['key']}: {row['said']}")
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        if row["kind"] != "clean":
            groups[row["kind"]].append(row)
            groups["all"].append(row)
    print(f"{'kind':<8} {'tried':>6} {'named':>7} {'stopped':>8} {'harmed':>7} {'harmed and not named':>21}")
    for kind, entries in sorted(groups.items()):
        share = sum(row["found"] for row in entries) / len(entries)
        harmed = [row for row in entries if row["harm"] >= BIG]
        silent = [row for row in harmed if not row["found"]]
        stopped = sum(row["stopped"] for row in entries)
        print(f"{kind:<8} {len(entries):>6} {share:>7.1%} {stopped:>8} {len(harmed):>7} {len(silent):>21}")
    for row in groups["all"]:
        if not row["found"] and row["harm"] >= BIG:
            print(f"  missed: {row['key']} ({row['harm']:.3g} sigma): {row['said'] or 'nothing said'}")


def main() -> None:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("campaign-output/mistakes.jsonl"))
    parser.add_argument("--seeds", type=int, default=2, help="flights with mistakes per vehicle")
    parser.add_argument("--quick", action="store_true", help="a sample of all")
    parser.add_argument("--minutes", type=float, help="end after so long; the next run goes on from there")
    parser.add_argument("--table", action="store_true", help="print what is there, run nothing")
    parser.add_argument("--vehicle", choices=VEHICLES, action="append", help="one of both, or both")
    parser.add_argument("--only", choices=("clean", "injected"))
    options = parser.parse_args()
    results = Results(options.out)
    if not options.table:
        minutes = options.minutes or (3.0 if options.quick else 1e6)
        deadline = time.monotonic() + 60.0 * minutes
        vehicles = options.vehicle or VEHICLES
        seeds = range(500, 500 + (1 if options.quick else options.seeds))
        if options.only in (None, "clean"):
            run_clean(results, range(100, 101) if options.quick else CLEAN_SEEDS, vehicles, deadline)
        if options.only in (None, "injected"):
            run_injected(results, seeds, vehicles, 12 if options.quick else 1, deadline)
    table(results)


if __name__ == "__main__":
    main()
