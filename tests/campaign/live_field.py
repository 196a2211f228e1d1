"""Live estimates on flights of JSBSim's as the field sees them, at 10, 20 and 30 s, against the truth.

Flights are those of the campaign `field`. Beside what is reported, the recursive regression that watches for
changes. A line of the store is one flight; a run that is broken off goes on where it stopped.
Run: make campaign NAME=live-field FAMILIES=mild,typical,stock SEEDS=6
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from field_flight import FieldFlight, field_flight
from live_flights import Here, pieces

from sysid.live.identifier import LiveIdentifier

AT_S = (10.0, 20.0, 30.0)
EVERY_S = 0.4
Line = dict[str, Any]


def flown(flight: FieldFlight, live: LiveIdentifier) -> Line:
    """What is known so long after the first row: time -> coefficient -> value and standard error; changes; CPU."""
    found: dict[str, dict[str, tuple[float, float]]] = {}
    begun, began = np.nan, time.process_time()
    changes: list[str] = []
    for count, samples in enumerate(pieces(flight.signals, EVERY_S / 8.0), 1):
        live.take(samples)
        if count % 8:
            continue
        report = live.report()
        changes = report.sentences()
        if np.isnan(begun) and np.isfinite(report.time_s):
            begun = report.time_s
        for at in AT_S:
            if str(at) not in found and report.time_s >= begun + at:
                known = {name: one for name, one in report.coefficients.items() if one.known}
                found[str(at)] = {name: (one.value, one.std) for name, one in known.items()}
    return {"found": found, "changes": changes, "cpu": (time.process_time() - began) / flight.seconds}


def row(lines: list[Line], way: str, at: float) -> str:
    """One row of the table."""
    asked, scores = 0, []
    for line in lines:
        known = line[way]["found"].get(str(at))
        if known is None:
            continue
        asked += len(line["excited"])
        for name in line["excited"]:
            if name in known:
                (value, std), (low, high) = known[name], line["truth"][name]
                scores.append((max(low - value, value - high, 0.0), std, max(abs(low + high) / 2.0, 1e-6)))
    if not scores:
        return ""
    off, std, size = np.array(scores).T
    return (
        f"{len(scores) / asked:>8.0%}{np.mean(off <= 1.96 * std):>8.0%}{np.median(off / size):>9.1%}"
        f"{np.mean(off > 5 * std):>10.1%}"
    )


def main() -> None:
    """Fly what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", default="mild,typical,stock")
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--store", type=Path, default=Path("campaign-output/live-field/flights.jsonl"))
    options = parser.parse_args()
    options.store.parent.mkdir(parents=True, exist_ok=True)
    lines: dict[tuple[str, int], Line] = {}
    for text in options.store.read_text(encoding="utf-8").splitlines() if options.store.exists() else ():
        line = json.loads(text)
        lines[line["family"], line["seed"]] = line
    wanted = [(family, seed) for family in options.families.split(",") for seed in range(options.seeds)]
    for family, seed in wanted:
        if (family, seed) in lines:
            continue
        with tempfile.TemporaryDirectory() as folder:
            flight = field_flight(family, seed, Path(folder))
        line = {"family": family, "seed": seed, "truth": flight.truth, "excited": list(flight.excited)}
        line["window"] = flown(flight, LiveIdentifier(flight.vehicle, Here()))
        line["recursive"] = flown(flight, LiveIdentifier(flight.vehicle))
        lines[family, seed] = line
        with options.store.open("a", encoding="utf-8") as store:
            store.write(json.dumps(line) + "\n")
        print(f"{family} {seed}: {line['window']['changes']}", file=sys.stderr, flush=True)
    by_family = defaultdict(list)
    for family, seed in wanted:
        by_family[family].append(lines[family, seed])
    for way in ("window", "recursive"):
        print(f"\n{way:<20}{'known':>8}{'hold':>8}{'error':>9}{'beyond 5':>10}")
        for family, every in by_family.items():
            for at in AT_S:
                print(f"{family + f', {at:.0f} s':<20}{row(every, way, at)}")
    cpu = np.median([line["window"]["cpu"] for line in lines.values()])
    changes = sum(bool(line["window"]["changes"]) for line in lines.values())
    print(f"\nCPU of both {cpu:.3f} s/s (median); flights with a change told, where none is: {changes} of {len(lines)}")


if __name__ == "__main__":
    main()
