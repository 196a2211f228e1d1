"""Bench points of a vehicle's analogue sensors, as a person with a manometer, a protractor and weights writes
them down.

`python -m sim_vehicle.vehicle.bench_points VEHICLE.toml` writes NAME-airspeed.csv, NAME-alpha.csv, NAME-beta.csv and
NAME-thrust.csv beside the vehicle file, from the true curves of NAME.analogue.json with reading errors and
rounding. Run once: the points are data of the vehicle, and the simulator flies the true curves, not the
points.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.constants import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from sim_vehicle.errors import SimVehicleError, VehicleFileError
from sim_vehicle.vehicle.adc_curves import AnalogueChannel, load_analogue

Array = NDArray[np.float64]
_VOLTMETER = 0.001  # V, last digit of a hand-held multimeter


@dataclass(frozen=True)
class Bench:
    """References set on the bench (in `unit`), how finely they are read, and what the sensor then feels (SI)."""

    unit: str
    references: Array
    error: float  # 1 sigma of setting the reference
    rounding: float
    decimals: int


BENCHES = {
    # U-tube with a vernier: 0.1 mm of water is 1 Pa.
    "airspeed": Bench("Pa", np.linspace(0.0, 400.0, 21), 0.5, 1.0, 0),
    "alpha": Bench("deg", np.linspace(-25.0, 25.0, 21), 0.1, 0.1, 1),
    "beta": Bench("deg", np.linspace(-25.0, 25.0, 21), 0.1, 0.1, 1),
    # Weights on a thread; the pre-compression (125 gf) lets the sensor read drag as well.
    "thrust": Bench("gf", np.linspace(-100.0, 900.0, 21), 1.0, 1.0, 0),
}


def felt(signal: str, reference: Array) -> Array:
    """The signal in SI (calibrated airspeed m/s, rad, N) that a bench reference stands for."""
    if signal == "airspeed":
        return np.asarray(np.sqrt(2.0 * np.maximum(reference, 0.0) / SEA_LEVEL_DENSITY))
    if signal == "thrust":
        return np.asarray(reference * 1e-3 * STANDARD_GRAVITY)
    return np.asarray(np.radians(reference))


def bench_points(channel: AnalogueChannel, generator: np.random.Generator) -> list[tuple[float, float, str]]:
    """(reference, volts, direction) up the range and down again, with errors of setting, rounding and
    reading.
    """
    bench = BENCHES[channel.signal]
    rows: list[tuple[float, float, str]] = []
    for direction, order in (("up", bench.references), ("down", bench.references[::-1])):
        true = order + bench.error * generator.standard_normal(order.size)
        if channel.signal == "airspeed":
            true = np.where(order == 0.0, 0.0, true)  # no flow is exact
        volts = channel.volts(felt(channel.signal, true)) + 0.5 * _VOLTMETER * generator.standard_normal(order.size)
        noted = np.round(order / bench.rounding) * bench.rounding
        read = np.round(volts / _VOLTMETER) * _VOLTMETER
        rows += [(float(a), float(b), direction) for a, b in zip(noted, read, strict=True)]
    return rows


def write_bench_files(vehicle_path: Path, seed: int = 1) -> list[Path]:
    """Write one CSV (reference,reading,direction) for each analogue channel; their paths."""
    board = load_analogue(vehicle_path)
    if board is None:
        raise VehicleFileError(f"{vehicle_path.with_suffix('.analogue.json')}: no such file; it holds the true curves")
    generator = np.random.default_rng(seed)
    paths = []
    for channel in board.channels:
        bench = BENCHES[channel.signal]
        path = vehicle_path.with_name(f"{vehicle_path.stem}-{channel.signal}.csv")
        lines = ["reference,reading,direction"]
        lines += [f"{a:.{bench.decimals}f},{b:.3f},{d}" for a, b, d in bench_points(channel, generator)]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        paths.append(path)
    return paths


def main() -> int:
    """Command line: the vehicle file's path."""
    if len(sys.argv) != 2:
        print("usage: python -m sim_vehicle.vehicle.bench_points VEHICLE.toml", file=sys.stderr)
        return 2
    try:
        for path in write_bench_files(Path(sys.argv[1])):
            print(path)
    except SimVehicleError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
