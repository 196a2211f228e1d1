"""Whether the methods agree: flights of JSBSim's with textbook sensors, each identified by ee, oe, fe and map.

Inputs: doublets, 3-2-1-1, multisines, and small movements of a hand at random; logged as positions or as commands, in
whole microseconds, at 25, 50 or 100 Hz; by turns the aircraft with linear aerodynamics and the one of tables. Nothing
lags, nothing blows: what methods differ by is theirs. Printed: each method against the truth, every two of them against
each other, in units of their bars, and what all coefficients of an axis have in common. Each line of the store is one
flight by one method; a run that is broken off goes on where it stopped. Run: make campaign NAME=methods
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import signal

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from field import Line, digest, judge, read, report
from field_flight import LATERAL, LONGITUDINAL, FieldFlight, at_rate, textbook
from field_inputs import SIZE, STICK, inputs_of
from field_plant import STEP, Inputs, fly_field
from field_sensors import sense
from field_truth import truth_of
from jsbsim_flight import linear_aircraft, table_aircraft
from other_engine import version

METHODS = ("ee", "oe", "fe", "map")
KINDS, RATES_HZ = ("doublet", "3211", "multisine", "sticks"), (25.0, 50.0, 100.0)
PULSE = float(np.radians(45.0)) / 500.0  # rad, of one microsecond
SECONDS, FLIGHTS, LIMIT_S = 30.0, 60, 240.0
AXES = ("CL", "Cm", "CY", "Cl", "Cn")


def sticks(generator: np.random.Generator) -> Inputs:
    """Small movements of a hand on all sticks at once, at random: a second or two in one place, then in another."""
    still = inputs_of("multisine", SECONDS, generator, surfaces=())
    count = still.throttle.size
    moves = {}
    for name, largest in SIZE.items():
        edges = np.sort(generator.integers(0, count, int(SECONDS * 0.8)))
        places = generator.uniform(-1.0, 1.0, edges.size + 1) * 0.6 * largest
        stepped = places[np.searchsorted(edges, np.arange(count), side="right")]
        left = float(np.exp(-STEP / STICK))
        moves[name] = np.asarray(signal.lfilter([1.0 - left], [1.0, -left], stepped))
    return replace(still, surfaces=moves)


def flight_of(number: int, folder: Path) -> FieldFlight:
    """One flight; `folder` takes JSBSim's files. Of each kind, rate and log there are as many."""
    kind, hz = KINDS[number % 4], RATES_HZ[number // 4 % 3]
    aircraft = table_aircraft() if number // 12 % 2 else linear_aircraft()
    generator = np.random.default_rng([number, 57])
    size = float(generator.uniform(0.5, 1.0))
    inputs = sticks(generator) if kind == "sticks" else inputs_of(kind, SECONDS, generator, size=size)
    log = fly_field(folder, aircraft, inputs, number, resolution=PULSE)
    field = replace(at_rate(textbook(), hz), positions=number // 2 % 2 == 0, pulse=PULSE)
    signals = sense(log, aircraft.vehicle, field, number, f"{kind}-{number}")
    excited = (*LONGITUDINAL, *LATERAL)
    return FieldFlight(signals, aircraft.vehicle, truth_of(log, aircraft), excited, float(log.time_s[-1]), log)


def differences(one: Iterable[Line], other: Iterable[Line]) -> np.ndarray:
    """Between what two methods say of the same flights, in units of the larger bar."""
    found = []
    for a, b in zip(one, other, strict=True):
        for name in a.get("estimate", {}).keys() & b.get("estimate", {}).keys():
            (va, sa), (vb, sb) = a["estimate"][name], b["estimate"][name]
            found.append(abs(va - vb) / max(sa, sb))
    return np.array(found)


def common(line: Line, axis: str) -> float:
    """The factor by which all coefficients of an axis are off, by weighted least squares; NaN where none is told."""
    values = [
        (value, np.hypot(std, (high - low) / 2.0), (low + high) / 2.0)
        for name, (value, std) in line.get("estimate", {}).items()
        if name.startswith(f"{axis}_") and name != f"{axis}_0" and name in line["truth"]
        for low, high in (line["truth"][name],)
    ]
    if len(values) < 2:
        return float("nan")
    value, std, truth = np.array(values).T
    return float(np.sum(value * truth / std**2) / np.sum(truth**2 / std**2)) - 1.0


def tables(lines: Mapping[str, list[Line]]) -> None:
    """Print each method against the truth, and what they differ by."""
    for method, found in lines.items():
        report(method, found)
    print(f"\n{'two methods':<14}{'compared':>9}{'median':>9}{'beyond 2':>10}{'beyond 5':>10}   bars apart")
    for one, other in itertools.combinations(lines, 2):
        apart = differences(lines[one], lines[other])
        if apart.size:
            print(
                f"{one + ' - ' + other:<14}{apart.size:>9}{np.median(apart):>9.2f}{np.mean(apart > 2):>10.1%}"
                f"{np.mean(apart > 5):>10.1%}"
            )
    print(f"\n{'common factor':<14}" + "".join(f"{axis:>16}" for axis in AXES) + "   median (half of all within)")
    for method, found in lines.items():
        cells = []
        for axis in AXES:
            factors = np.array([f for line in found if np.isfinite(f := common(line, axis))])
            half = np.median(np.abs(factors - np.median(factors))) if factors.size else np.nan
            cells.append(f"{np.median(factors):+.2%} ({half:.2%})" if factors.size else "")
        print(f"{method:<14}" + "".join(f"{cell:>16}" for cell in cells))


def main() -> None:
    """Fly and estimate what is missing, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--flights", type=int, default=FLIGHTS)
    parser.add_argument("--first", type=int, default=0, help="number of the first flight")
    parser.add_argument("--store", type=Path, default=Path("campaign-output/methods/flights.jsonl"))
    options = parser.parse_args()
    options.store.parent.mkdir(parents=True, exist_ok=True)
    lines, sources, methods = read(options.store), f"{version()}-{digest()}", options.methods.split(",")
    numbers = range(options.first, options.first + options.flights)
    for number in numbers:
        family = KINDS[number % 4]
        missing = [method for method in methods if (family, number, method, sources) not in lines]
        if not missing:
            continue
        with tempfile.TemporaryDirectory() as folder:
            flight = flight_of(number, Path(folder))
        for method in missing:
            key = {"family": family, "seed": number, "method": method, "version": sources}
            line = lines[family, number, method, sources] = {**key, **judge(flight, method, LIMIT_S)}
            with options.store.open("a", encoding="utf-8") as store:
                store.write(json.dumps(line) + "\n")
            print(f"{family} {number} {method}: {line['cpu']:.1f} s {line.get('error', '')[:100]}", file=sys.stderr)
    tables({m: [lines[KINDS[n % 4], n, m, sources] for n in numbers] for m in methods})


if __name__ == "__main__":
    main()
