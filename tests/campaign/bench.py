"""Do the intervals hold when every aircraft has its own bench? `make campaign NAME=bench` [SEEDS=40].

Each seed calibrates the paper's analogue sensors anew, from bench points drawn from the hidden curves with a bench's
scatter, flies with those sensors, and identifies from the raw channels. Printed: pooled coverage of the 95 % intervals
and the root mean square of error over standard error, with the bench's part in it and without.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from own_bars import own_bar
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.adc_curves import load_analogue
from sim_vehicle.vehicle.bench_points import BENCHES, bench_points
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.calibration import BenchPoints, calibrate
from sysid.identify import identify
from sysid.signals.flight import FlightSignals, Signal

MANOEUVRES = "multisine"
DURATION_S = 30.0


def calibrated_flight(seed: int) -> FlightSignals:
    """A flight of the paper's aircraft through channels that were calibrated on this seed's bench."""
    vehicle = load_vehicle("iitb-mav")
    board = load_analogue(vehicle.path)
    if board is None:
        raise SystemExit("the vehicle has no analogue channels")
    signals, _ = fly_mav(MANOEUVRES, seed, duration=DURATION_S)
    generator = np.random.default_rng(10_000 + seed)
    found = dict(signals.signals)
    for channel in board.channels:
        reference, reading, direction = zip(*bench_points(channel, generator), strict=True)
        source = vehicle.calibration[channel.signal]
        points = BenchPoints(np.array(reference), np.array(reading), direction, channel.signal)
        curve = calibrate(points, source.form, BENCHES[channel.signal].unit)
        raw = signals.signals[f"adc{channel.adc}"]
        found[channel.signal] = Signal(raw.time_s, curve.apply(raw.values)[0], "SI", "adc calibrated", curve)
    return FlightSignals(f"bench-{seed}", found)


def main() -> None:
    """Fly, identify and print."""
    true, vehicle = read_model("iitb-mav").values(), load_vehicle("iitb-mav")
    seeds = int(os.environ.get("SEEDS", "40"))
    scores: dict[str, list[tuple[float, float]]] = {}
    for seed in range(seeds):
        model = identify([calibrated_flight(seed)], vehicle, systematic=False).model
        for name, entry in model.coefficients.items():
            if entry.value is None or not entry.std:
                continue
            error = entry.value - true.get(name, 0.0)
            bench = sum(share**2 for share in entry.extra.get("bench", {}).values())
            bar = own_bar(entry)
            flight = max(bar**2 - bench, 1e-30) ** 0.5
            scores.setdefault(name, []).append((error / bar, error / flight))
        print(f"seed {seed + 1} of {seeds}", file=sys.stderr, flush=True)
    print(f"{'':<12}{'rms z':>8}{'covered':>9}{'rms z without bench':>22}{'covered':>9}")
    pooled = [score for of_one in scores.values() for score in of_one]
    for name, rows in (*scores.items(), ("all", pooled)):
        z = np.array(rows)
        rms, held = np.sqrt(np.mean(z**2, axis=0)), np.mean(np.abs(z) < 1.96, axis=0)
        print(f"{name:<12}{rms[0]:>8.2f}{held[0]:>9.2f}{rms[1]:>22.2f}{held[1]:>9.2f}")


if __name__ == "__main__":
    main()
