"""How near to the Cramer-Rao bound identification comes, and whether its intervals hold.

Run: make campaign NAME=identification

Flies every scenario once per seed, identifies, and keeps one line per flight in
campaign-output/identification/SCENARIO-FINGERPRINT.jsonl, so that a campaign that was stopped goes on where it was. The
fingerprint is that of the estimator's and simulator's sources: other sources start other files. Ends with a table for
each scenario: bias, RMS error over the bound, coverage of the 95 % intervals and share refused, per parameter.

`--method map` asks the estimator with an estimated noise spectrum, with servos and sensors described as Table II knows
them; the sensors' zeros and the vanes' scales are unknown to the bound as well then.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from scenarios import SCENARIOS, Scenario, bounds_of, fly_scenario, true_values
from seed_lines import end_line, fingerprint, one_thread_each, progress, read_lines
from tables import overview, render

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from own_bars import own_bar
from table_two import with_table_two

import sysid.identification.identify as estimator
from sysid.errors import SysidError

ROOT = Path(__file__).resolve().parents[2]
OUTPUT = ROOT / "campaign-output" / "identification"
# Seeds that no test uses.
FIRST_SEED = 10_000
# The estimator's, the simulator's and this campaign's flights: what a flight kept rests on.
SOURCES = ("sysid", "sim_vehicle", "scenarios", "flight_bounds", "gust_bounds")
UNKNOWN_TO_MAP = {*(f"accel_bias_{axis}" for axis in "xyz"), *(f"gyro_bias_{rate}" for rate in "pqr")} | {
    "alpha_scale", "beta_scale"
}  # fmt: skip


def trial(name: str, seed: int, asked: str = "auto") -> dict[str, Any]:
    """Fly and identify once: {"seed", "seconds", "failure", "estimates": name -> [value, std, low, high], ...}.

    asked: the method; "method" is the one that was taken.
    """
    scenario = SCENARIOS[name]
    begin = time.monotonic()
    signals, flown, plain = fly_scenario(scenario, seed)
    vehicle = with_table_two(plain) if asked == "map" else plain
    line: dict[str, Any] = {"seed": seed, "failure": None, "estimates": {}, "refused": {}}
    fitted: set[str] = set(scenario.sensors or ())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = estimator.identify(
                [signals], vehicle, structure=scenario.asked(), sensors=scenario.sensors,
                start_s=0.0 if name == "pulse" else None, systematic=False, method=asked,
            )  # fmt: skip
    except SysidError as error:
        line["failure"] = str(error)
    else:
        line["estimates"] = estimates_of(found, scenario)
        line["refused"] = {refusal.name: refusal.reason for refusal in found.refused}
        line["warnings"] = list(found.warnings)
        if found.likeliest is not None:
            line["method"] = found.likeliest.method
            fitted = {parameter.name for parameter in found.likeliest.estimate.parameters}
        if found.posterior is not None:
            line["method"], fitted = "map", UNKNOWN_TO_MAP
    bounds = bounds_of(scenario, seed, flown, plain, fitted)
    true = true_values(scenario, flown)
    wanted = {*line["estimates"], *bounds}
    return {
        **line,
        "bounds": bounds,
        "true": {key: value for key, value in true.items() if key in wanted},
        "seconds": round(time.monotonic() - begin, 2),
    }


def estimates_of(found: estimator.Identification, scenario: Scenario) -> dict[str, list[float]]:
    """Value, standard error and 95 % interval of every number that the result tells."""
    told: dict[str, list[float]] = {}
    for name, entry in found.model.coefficients.items():
        if entry.value is not None and entry.std is not None:
            bar = own_bar(entry)
            told[name] = [entry.value, bar, entry.value - 1.96 * bar, entry.value + 1.96 * bar]
    errors = found.sensor_errors if found.posterior is None else found.posterior.sensor_errors()
    for name, (value, std, *_) in errors.items():
        if scenario.sensors is None or name in scenario.sensors:
            told[name] = [value, std, value - 1.96 * std, value + 1.96 * std]
    return told


def run(names: Sequence[str], seeds: Iterable[int], workers: int, mark: str, method: str) -> None:
    """Fly what is missing, scenarios in turn for each seed, so that all grow alike."""
    OUTPUT.mkdir(parents=True, exist_ok=True)
    files = {name: OUTPUT / f"{name}-{mark}.jsonl" for name in names}
    done = {name: read_lines(path) for name, path in files.items()}
    jobs = [(name, seed) for seed in seeds for name in names if seed not in done[name]]
    if not jobs:
        return
    for path in files.values():
        end_line(path)
    begin = time.monotonic()
    one_thread_each()
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        pending = {pool.submit(trial, *job, method): job for job in jobs}
        try:
            for count, future in enumerate(as_completed(pending), 1):
                name, _ = pending[future]
                with files[name].open("a", encoding="utf-8") as sink:
                    sink.write(json.dumps(future.result()) + "\n")
                progress(count, len(jobs), time.monotonic() - begin)
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            raise


def main() -> int:
    """Fly, then print the tables of the flights of these sources."""
    parser = argparse.ArgumentParser(description="Identification against the Cramer-Rao bound, over many flights.")
    parser.add_argument("--seeds", type=int, default=400, help="flights of each scenario (default 400)")
    parser.add_argument("--scenarios", default="all", help="names with commas between: " + ", ".join(SCENARIOS))
    parser.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--method", default="auto", choices=("auto", "map"), help="asked for (default auto)")
    parser.add_argument("--tables", action="store_true", help="fly nothing, print what is there of those flights")
    given = parser.parse_args()
    names = list(SCENARIOS) if given.scenarios in ("", "all") else given.scenarios.split(",")
    unknown = [name for name in names if name not in SCENARIOS]
    if unknown:
        parser.error(f"no scenario {unknown[0]!r}; there are {', '.join(SCENARIOS)}")
    if given.seeds < 1 or given.workers < 1:
        parser.error("--seeds and --workers must be at least 1")
    mark = fingerprint(SOURCES) + ("" if given.method == "auto" else f"-{given.method}")
    seeds = range(FIRST_SEED, FIRST_SEED + given.seeds)
    if not given.tables:
        try:
            run(names, seeds, given.workers, mark, given.method)
        except KeyboardInterrupt:
            print("stopped; the same command goes on from here", file=sys.stderr)
            return 1
    found = {}
    for name in names:
        lines = [line for seed, line in read_lines(OUTPUT / f"{name}-{mark}.jsonl").items() if seed in seeds]
        if lines:
            gusty = SCENARIOS[name].gust > 0.0
            found[name] = lines
            print(render(SCENARIOS[name].title, lines, gusty), end="\n\n")
    print(overview(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
