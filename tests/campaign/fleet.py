"""Hundreds of flights on a Dask cluster: the same as here, how much faster two workers are, what a flight costs beside.

Run: make campaign NAME=fleet, or for fewer flights make campaign NAME=fleet FLIGHTS=40

Flights of three aircraft are flown once and kept (campaign-output/fleet); the elevator of the second loses a tenth
half-way. They are identified by one process of this machine, by one worker of a cluster and by two, of which a third
run kills one. With --namespaces (root) the workers are in network namespaces of their own, as on other machines.
On standard output: times, differences, and what the fleet's report says. 1 where anything differs.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from dask_cluster import cluster
from network_namespaces import Machine, machines

AIRCRAFT = ("alpha", "bravo", "charlie")
BESIDE = ("cost_s", "made")
VEHICLES = Path(__file__).resolve().parents[2] / "sim_vehicle" / "vehicles"


def fly_fleet(folder: Path, count: int) -> None:
    """The flights that are not there yet; those of an aircraft a day apart by their names."""
    for place, aircraft in enumerate(AIRCRAFT):
        own = folder / aircraft
        own.mkdir(parents=True, exist_ok=True)
        for file in VEHICLES.glob("iitb-mav*"):
            shutil.copy(file, own / ("vehicle.toml" if file.name == "iitb-mav.toml" else file.name))
        each = count // len(AIRCRAFT) + (place < count % len(AIRCRAFT))
        for k in range(each):
            target = own / f"{aircraft}-{k:03d}.tlog"
            if target.exists():
                continue
            hidden = ["--effect", "elevator_gain:scale=-0.1"] if aircraft == "bravo" and k >= each // 2 else []
            command = [sys.executable, "-m", "sim_vehicle", "fly", "--manoeuvre", "multisine", "--duration", "12",
                       "--seed", str(1000 * place + k), *hidden, "--record", str(target)]  # fmt: skip
            subprocess.run(command, check=True, stderr=subprocess.DEVNULL)


def batch(folder: Path, output: Path, *options: str, kill: subprocess.Popen[bytes] | None = None) -> tuple[float, str]:
    """Seconds, and what was printed."""
    shutil.rmtree(output, ignore_errors=True)
    begun = time.monotonic()
    running = subprocess.Popen(
        [sys.executable, "-m", "gcs", "batch", str(folder), "-o", str(output), "--quiet", *options],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    if kill is not None:
        while len(list((output / "results").glob("*.json"))) < 5:
            time.sleep(0.1)
        kill.kill()
    said, _ = running.communicate()
    return time.monotonic() - begun, said


def results(output: Path) -> dict[str, dict[str, Any]]:
    found = {path.name: json.loads(path.read_text()) for path in (output / "results").glob("*.json")}
    return {name: {key: value for key, value in one.items() if key not in BESIDE} for name, one in found.items()}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--namespaces", action="store_true")
    given = parser.parse_args()
    with machines(2 if given.namespaces else 0) as apart:
        return compared(given.flights, apart)


def compared(count: int, apart: Sequence[Machine]) -> int:
    """Do it all. apart: the machines of the workers, this one without."""
    base = Path("campaign-output/fleet")
    flights = base / f"flights-{count}"
    fly_fleet(flights, count)
    here, said = batch(flights, base / "here", "--workers", "1")
    print(said)
    cost = sum(json.loads(path.read_text())["cost_s"] for path in (base / "here" / "results").glob("*.json"))
    with cluster(1, apart) as (address, _):
        one, _ = batch(flights, base / "one", "--scheduler", address)
    with cluster(2, apart) as (address, _):
        two, _ = batch(flights, base / "two", "--scheduler", address)
    with cluster(2, apart) as (address, workers):
        killed, _ = batch(flights, base / "killed", "--scheduler", address, kill=workers[0])
    wanted = results(base / "here")
    same = {name: results(base / name) == wanted for name in ("one", "two", "killed")}
    each = cost / count
    print(f"{count} flights: here {here:.1f} s, one worker {one:.1f} s, two {two:.1f} s")
    print(f"two workers take {two / one:.2f} of one; two of which one is killed {killed:.1f} s")
    print(f"identification itself: {each:.2f} s a flight")
    print(f"beside it: {here / count - each:.3f} s here, {one / count - each:.3f} s by the cluster")
    for name, good in same.items():
        print(f"{name}: {'the same to the last digit' if good else 'DIFFERS'}")
    return 0 if all(same.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
