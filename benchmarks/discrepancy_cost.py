"""CPU time of the discrepancy job over flight length and number of candidates. Run: make bench-discrepancy-cost

One flight with a hidden effect, the campaign's multisine four times over with rests between, is cut to an eighth, a
quarter and so on; then the first quarter is looked at with a catalogue cut to some effects, evenly spread over it. To
each a power law is fitted (its exponent is 1 where cost grows linearly, below that where a part is fixed), and a
straight line.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import statistics
import sys
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
from discrepancy_cases import STEP_S, Case, baseline_model, plan_for, the_vehicle, true_model
from simulated import signals_of

from sim_vehicle.effects import EFFECTS
from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.manoeuvres.plan import Plan
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.discrepancy import discrepancy
from sysid.signals.flight import FlightSignals

CASE = Case((("pitch_curvature", 1.0),), 20_000, 0.0)
REPEATS = 4
# Halves of the flight's multisines, s: each is 20 s of signal and 3 s of rest.
LENGTHS_S = (11.5, 23.0, 46.0, 92.0)
CANDIDATES = (10, 20, 40)
# Stage by the beginning of what the job says of its progress.
STAGES = {
    "signals": "preparation", "units": "preparation", "data": "preparation", "its coefficients": "re-fit",
    "timing": "re-fit", "the model as": "re-fit", "a first look": "first look", "trying": "trials",
    "fitting the": "trials", "the gap": "gap",
}  # fmt: skip
SHOWN = ("preparation", "re-fit", "first look", "trials", "gap")


def long_flight(vehicle: Vehicle) -> FlightSignals:
    """The case's multisine REPEATS times over."""
    (segment,) = plan_for(CASE.kind, held_out=False).segments
    generator = np.random.default_rng(CASE.seed)
    suite = SensorSuite(vehicle, generator=generator)
    plant = Plant(vehicle, true_model(CASE), max_step=STEP_S)
    flown = fly(plant, Plan((segment,) * REPEATS), suite=suite, generator=generator)
    return signals_of(flown, vehicle, "long")


@contextmanager
def catalogue_of(count: int) -> Iterator[int]:
    """The catalogue cut to `count` effects, evenly spread, with the hidden one and the baseline's own among them."""
    whole = dict(EFFECTS)
    needed = {name for name, _ in CASE.effects} | {effect.name for effect in baseline_model(CASE).effects}
    others = [name for name in whole if name not in needed]
    kept = {others[i] for i in spread_over(len(others), count - len(needed))} | needed
    for name in set(whole) - kept:
        del EFFECTS[name]
    try:
        yield len(EFFECTS)
    finally:
        EFFECTS.clear()
        EFFECTS.update(whole)


def spread_over(size: int, count: int) -> list[int]:
    """`count` places among `size`, evenly apart; all where there are no more."""
    return [] if count <= 0 else sorted({round(i) for i in np.linspace(0, size - 1, min(count, size))})


def timed(flight: FlightSignals, vehicle: Vehicle, stop_s: float) -> dict[str, float]:
    """CPU seconds of the job by stage, "total" among them, on the first `stop_s` seconds."""
    begin, now = time.process_time(), "preparation"
    spent: dict[str, float] = dict.fromkeys((*SHOWN, "total"), 0.0)

    def turn(share: float, text: str) -> None:
        nonlocal begin, now
        seconds = time.process_time() - begin
        spent[now] += seconds
        spent["total"] += seconds
        begin, now = time.process_time(), stage_of(text, now)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = discrepancy([flight], vehicle, baseline_model(CASE), stop_s=stop_s, progress=turn)
    turn(1.0, "end")
    names = [entry["name"] for entry in found["effects"]]
    if names != [name for name, _ in CASE.effects]:
        print(f"  {stop_s:g} s: named {', '.join(names) or 'nothing'}", file=sys.stderr)
    return spent


def stage_of(text: str, before: str) -> str:
    """The stage that a word of progress begins; the one before where it begins none."""
    return next((stage for start, stage in STAGES.items() if text.startswith(start)), before)


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """k of the power law seconds ~ sizes^k, by least squares on logarithms; NaN where a time is nothing."""
    if min(seconds) <= 0.0:
        return float("nan")
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def straight(sizes: Sequence[float], seconds: Sequence[float]) -> tuple[float, float]:
    """Fixed seconds, and seconds for each unit of size, of the straight line by least squares."""
    each, fixed = np.polyfit(sizes, seconds, 1)
    return float(fixed), float(each)


def table(first: str, sizes: Sequence[float], rows: Sequence[Mapping[str, float]]) -> str:
    """Markdown: CPU seconds by stage over sizes, and below the exponents and straight lines."""
    columns = ("total", *SHOWN)
    lines = [f"| {first} | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for size, row in zip(sizes, rows, strict=True):
        lines.append(f"| {size:g} | " + " | ".join(f"{row[name]:.1f}" for name in columns) + " |")
    powers = [exponent(sizes, [row[name] for row in rows]) for name in columns]
    lines.append("| exponent | " + " | ".join(f"{power:.2f}" for power in powers) + " |")
    fits = [straight(sizes, [row[name] for row in rows]) for name in columns]
    lines.append("| straight line | " + " | ".join(f"{fixed:.1f} + {each:.3f} n" for fixed, each in fits) + " |")
    return "\n".join(lines)


def median_of(runs: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Median of every stage over runs."""
    return {name: statistics.median(run[name] for run in runs) for name in runs[0]}


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description="CPU time of the discrepancy job, over flight length and candidates.")
    parser.add_argument("--rounds", type=int, default=1, help="runs of each, of which the median counts (default 1)")
    rounds = range(parser.parse_args().rounds)
    vehicle = the_vehicle()
    flight = long_flight(vehicle)
    timed(flight, vehicle, LENGTHS_S[0])  # compiled, as on every call but the first
    by_length = [median_of([timed(flight, vehicle, length) for _ in rounds]) for length in LENGTHS_S]
    print(table("flight, s", LENGTHS_S, by_length) + "\n", flush=True)
    sizes, by_count = [], []
    for count in (*CANDIDATES, len(EFFECTS)):
        with catalogue_of(count) as size:
            sizes.append(float(size))
            by_count.append(median_of([timed(flight, vehicle, LENGTHS_S[1]) for _ in rounds]))
    print(table("effects in the catalogue", sizes, by_count))


if __name__ == "__main__":
    main()
