"""Mistakes put into the signals of simulated flights: which are found and named. Run: make campaign-mistakes

Every kind of mistake of tests/support/signal_mistakes.py, flight by flight. A mistake counts if it changes the fit by
at least 5 standard errors of a coefficient: its estimate by equation error (--fit oe: output error) is compared with
that from the flight without the mistake, noise and all else the same. Clean flights in calm air and gusts show the
false alarms. Every result is a line of JSON in --out; what is there already is not run again.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent / "support"))

from signal_mistakes import Injection, injections
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.errors import SysidError
from sysid.identify import identify
from sysid.signal_check.check import SignalCheck, check_signals
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import prepare

VEHICLES = ("iitb-mav", "ultrastick25e")
MANOEUVRES = ("multisine", "elevator-3211", "elevator-3211,aileron-doublet,rudder-doublet", "elevator-pulse")
GUSTS = (0.0, 0.3, 1.0)
CLEAN_SEEDS = range(100, 113)
BIG = 5.0
# The hardest to tell first.
KINDS = ("delay", "scale", "axis", "sign", "unit")
# Scale errors that the estimate corrects are a mistake told from this size on.
SCALE_TOLD = 0.03


def fly(vehicle: str, manoeuvres: str, gusts: float, seed: int) -> FlightSignals:
    """One flight with sensors of Table II, with a steady wind that the seed chooses."""
    effects = [f"steady_wind:north={seed % 5 - 2},east={seed % 3 - 1},down=0"]
    effects += [f"turbulence:sigma={gusts:g},length=30"] if gusts else []
    craft, model = load_vehicle(vehicle), read_model(vehicle)
    return fly_mav(manoeuvres, seed, effects=tuple(effects), vehicle=craft, model=model)[0]


def checked(flight: FlightSignals, vehicle: str) -> tuple[str, list[dict[str, Any]]]:
    """What is said of a flight: the line it stops with, and its findings."""
    craft = load_vehicle(vehicle)
    try:
        check = check_signals([prepare(flight, craft)], craft)
    except SysidError as error:
        return str(error).partition(": ")[2], []
    return "", [one.to_json() for one in check.findings()]


def estimates(flight: FlightSignals, vehicle: str, method: str) -> dict[str, tuple[float, float]]:
    """Coefficients as if nothing were wrong."""
    craft = load_vehicle(vehicle)
    found = identify([flight], craft, method=method, check=SignalCheck(), systematic=False)
    entries = found.model.coefficients.items()
    return {n: (e.value, e.std) for n, e in entries if e.value is not None and e.std is not None}


def change_of(flight: FlightSignals, vehicle: str, clean: dict[str, tuple[float, float]], method: str) -> float:
    """Largest change of a coefficient in its clean standard errors; very large where nothing can be estimated."""
    try:
        wrong = estimates(flight, vehicle, method)
    except SysidError:
        return 1e9
    return max((abs(wrong[n][0] - v) / s if n in wrong else 1e9 for n, (v, s) in clean.items()), default=0.0)


def flown_through(flight: FlightSignals, vehicle: str) -> tuple[str, list[dict[str, Any]], bool]:
    """What an identification by output error says: its stop, its findings, whether kinematics saw calm air."""
    try:
        found = identify([flight], load_vehicle(vehicle), method="oe", systematic=False)
    except SysidError as error:
        return str(error).partition(": ")[2], [], True
    findings = [one.to_json() for one in found.check.findings()]
    for name, (value, std, _) in found.sensor_errors.items():
        if name.endswith("_scale") and abs(value) > max(2.0 * std, SCALE_TOLD):
            text = f"{name.removesuffix('_scale')} reads {1.0 + value:.3g} of true: corrected"
            findings.append({"kind": "scale", "signals": [name.removesuffix("_scale")], "sentence": text})
    return "", findings, found.compatibility.gust_sigma == 0.0


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


def clean_flight(vehicle: str, manoeuvres: str, gusts: float, seed: int) -> tuple[str, bool]:
    """What is said of a flight without a mistake, and whether the estimation was asked too, as in calm air."""
    flight = fly(vehicle, manoeuvres, gusts, seed)
    if gusts > 0.0:
        line, findings = checked(flight, vehicle)
    else:
        line, findings, _ = flown_through(flight, vehicle)
        # Scale errors of Table II's sensors are true, and corrected.
        findings = [one for one in findings if "corrected" not in one["sentence"] or one["kind"] != "scale"]
    return line or "; ".join(str(one["sentence"]) for one in findings), gusts == 0.0


def run_clean(results: Results, seeds: range, vehicles: Sequence[str], deadline: float) -> None:
    """False alarms."""
    for seed in seeds:
        for vehicle in vehicles:
            for manoeuvres in MANOEUVRES:
                for gusts in GUSTS:
                    key = f"clean|{vehicle}|{manoeuvres}|{gusts:g}|{seed}"
                    if key in results.rows or time.monotonic() > deadline:
                        continue
                    said, estimated = clean_flight(vehicle, manoeuvres, gusts, seed)
                    results.add({"key": key, "kind": "clean", "gusts": gusts, "said": said, "estimated": estimated})


def run_injected(results: Results, seeds: range, vehicles: Sequence[str], stride: int, deadline: float) -> None:
    """Found and named: by the check, which takes a second, or else by the estimation after it."""
    for seed in seeds:
        for vehicle in vehicles:
            flight = fly(vehicle, "multisine", 0.0, seed)
            for number, one in sorted(enumerate(injections()), key=lambda entry: KINDS.index(entry[1].kind)):
                key = f"{one.name}|{vehicle}|{seed}"
                if (number + seed) % stride or key in results.rows or time.monotonic() > deadline:
                    continue
                wrong = one.apply(flight)
                line, findings = checked(wrong, vehicle)
                if not named(one, line, findings) and not line:
                    line, findings, _ = flown_through(wrong, vehicle)
                hit = named(one, line, findings)
                said = line or "; ".join(str(entry["sentence"]) for entry in findings)
                row = {"key": key, "kind": one.kind, "signals": list(one.signals), "change": None, "found": hit}
                results.add({**row, "said": said, "blamed": blamed(one, findings)})


def run_changes(results: Results, seeds: range, method: str, deadline: float) -> None:
    """What the mistakes change in the fit: first those that were missed, which take an estimation each."""
    by_name = {one.name: one for one in injections()}
    for found in (False, True):
        for seed in seeds:
            for vehicle in VEHICLES:
                rows = [row for row in results.rows.values() if row["key"].endswith(f"|{vehicle}|{seed}")]
                rows = [row for row in rows if row["kind"] != "clean" and row["found"] == found]
                rows = [row for row in rows if row["change"] is None]
                if not rows:
                    continue
                flight = fly(vehicle, "multisine", 0.0, seed)
                clean = estimates(flight, vehicle, method)
                for row in rows:
                    if time.monotonic() > deadline:
                        return
                    wrong = by_name[row["key"].partition("|")[0]].apply(flight)
                    results.add({**row, "change": change_of(wrong, vehicle, clean, method)})


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
    print(f"{'kind':<8} {'tried':>6} {'found':>7} {'weighed':>8} {'5 sigma or more':>16} {'of those found':>15}")
    for kind, entries in sorted(groups.items()):
        weighed = [row for row in entries if row["change"] is not None]
        big = [row for row in weighed if row["change"] >= BIG]
        share = f"{sum(row['found'] for row in big) / len(big):.1%}" if big else "-"
        told = sum(row["found"] for row in entries) / len(entries)
        print(f"{kind:<8} {len(entries):>6} {told:>7.1%} {len(weighed):>8} {len(big):>16} {share:>15}")
    for row in groups["all"]:
        if not row["found"] and (row["change"] is None or row["change"] >= BIG):
            size = "not weighed" if row["change"] is None else f"{row['change']:.3g} sigma"
            print(f"  missed: {row['key']} ({size}): {row['said'] or 'nothing said'}")


def main() -> None:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("campaign-output/mistakes.jsonl"))
    parser.add_argument("--seeds", type=int, default=2, help="flights with mistakes per vehicle")
    parser.add_argument("--quick", action="store_true", help="a sample of all")
    parser.add_argument("--minutes", type=float, help="end after so long; the next run goes on from there")
    parser.add_argument(
        "--fit", choices=("ee", "oe"), default="ee", help="whose change counts; oe takes ten times as long"
    )
    parser.add_argument("--table", action="store_true", help="print what is there, run nothing")
    parser.add_argument("--vehicle", choices=VEHICLES, action="append", help="one of both, or both")
    parser.add_argument("--only", choices=("clean", "injected", "changes"))
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
        if options.only in (None, "changes"):
            run_changes(results, seeds, options.fit, deadline)
    table(results)


if __name__ == "__main__":
    main()
