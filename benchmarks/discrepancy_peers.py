"""What a missing effect leaves, by PySINDy, a Gaussian process and this project. Run: make bench-discrepancy-peers

The discrepancy campaign's flights: an effect hidden at its greatest size, a baseline whose coefficients are off by up
to 10 %, one flight to fit and another to judge by. The peers learn residual coefficients of the re-fitted baseline,
seen with the sensor errors that kinematics alone tell: those of the re-fit hold a share of what is missing. This
project gets the signals. Every model then flies the other flight freely, with its sensors' biases fitted to its own
runs; what it leaves is told over what the true model leaves. One line per flight is kept in
campaign-output/discrepancy-peers/, so that a run that was stopped goes on where it was.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from corrected_flight import Array, Correction, judged_gap, residual_coefficients
from discrepancy_cases import Case, baseline_model, fly_case, gust_for, kind_for, the_vehicle, true_model
from peer_table import RIGHT_TERMS, report
from residual_peers import GaussianProcess, Sindy
from seed_lines import end_line, fingerprint, keyed_lines, progress

from sim_vehicle.model.model_file import Model, model_from_json
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.compatibility.reconstruction import check_compatibility
from sysid.discrepancy import discrepancy
from sysid.discrepancy.innovations.candidate_fits import fitted
from sysid.discrepancy.innovations.posed_flights import BENCH, NUISANCE, SUB_STEPS
from sysid.problem.estimation_problem import MAX_RUN_S, free_coefficients, model_of
from sysid.problem.formulation import make_problem
from sysid.problem.free_run import Fixed
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import Prepared, prepare

OUTPUT = Path(__file__).resolve().parents[1] / "campaign-output" / "discrepancy-peers"
# The campaign's first seeds: calm, then turbulence.
FIRST_SEED = 20_000
SOURCES = (
    "sysid", "sim_vehicle", "discrepancy_cases", "effect_sizes", "simulated", "corrected_flight", "residual_peers",
)  # fmt: skip


def refitted(prepared: Sequence[Prepared], vehicle: Vehicle, baseline: Model) -> tuple[Model, Fixed]:
    """The baseline with its own parameters fitted again, alone and with the sensor errors that kinematics tell."""
    compatible = check_compatibility(prepared)
    problem = make_problem(prepared, vehicle, compatible, [*NUISANCE, *BENCH], MAX_RUN_S)
    start = {name: 0.0 if name in BENCH else value for name, value in problem.sensors.items()}
    priors = {name: (0.0, std) for name, std in BENCH.items() if name in start}
    problem = replace(problem, sensors=start, priors=priors, sub_steps=SUB_STEPS)
    names = free_coefficients(list(baseline.coefficients), problem.motion)
    effects = [(effect.name, name) for effect in baseline.effects for name in effect.parameters]
    found = fitted(problem, baseline, names, effects, {}, compatible.gust_sigma)
    model = model_of(baseline, baseline.name, found, names, effects, (), baseline.validity)
    errors = {name: error.value for name, error in compatible.parameters.items()}
    return model, Fixed(flatten(vehicle, model), errors, problem.command_first)


def contest(case: Case, vehicle: Vehicle) -> dict[str, Any]:
    """One case: gaps per output on the flight not used, names, terms and CPU seconds of every contestant."""
    used, other = (fly_case(case, vehicle, held_out=held_out)[0] for held_out in (False, True))
    baseline, seconds = baseline_model(case), {}

    def timed(name: str, work: Callable[[], Any]) -> Any:
        begin = time.process_time()
        found = work()
        seconds[name] = time.process_time() - begin
        return found

    model, x, residuals = timed("refit", lambda: learnable(used, vehicle, baseline))
    sindy = timed("sindy", lambda: Sindy(x, residuals, sparse=False))
    sparse = timed("sindy_sparse", lambda: Sindy(x, residuals, sparse=True))
    process = timed("gp", lambda: GaussianProcess(x, residuals))
    found = timed("ours", lambda: discrepancy([used], vehicle, baseline))
    models: dict[str, tuple[Model, Correction | None]] = {
        "before": (model, None), "sindy": (model, sindy), "sindy_sparse": (model, sparse), "gp": (model, process),
        "ours": (model_from_json(found["model"]), None), "true": (true_model(case, air=False), None),
    }  # fmt: skip
    return {
        "baseline": list(baseline.coefficients),
        "terms": {"sindy": sindy.told(), "sindy_sparse": sparse.told()},
        "verdict": found["verdict"],
        "named": [[entry["name"], entry["probability"]] for entry in found["effects"]],
        "seconds": {name: round(value, 2) for name, value in seconds.items()},
        "gap": judged(other, vehicle, models),
    }


def learnable(flight: FlightSignals, vehicle: Vehicle, baseline: Model) -> tuple[Model, Array, Array]:
    """The re-fitted baseline, and what `residual_coefficients` makes of it on the same flight."""
    prepared = [prepare(flight, vehicle)]
    model, fixed = refitted(prepared, vehicle, baseline)
    return model, *residual_coefficients(prepared, vehicle, fixed)


def judged(
    flight: FlightSignals, vehicle: Vehicle, models: Mapping[str, tuple[Model, Correction | None]]
) -> dict[str, dict[str, float]]:
    """Gap per output of every model on a flight, sensor errors starting from what its kinematics tell."""
    prepared = [prepare(flight, vehicle)]
    compatible = check_compatibility(prepared)
    errors = {name: error.value for name, error in compatible.parameters.items()}
    at_once = make_problem(prepared, vehicle, compatible).command_first
    records, layout = [stretch.record for one in prepared for stretch in one.stretches], prepared[0].layout
    return {
        name: judged_gap(records, layout, Fixed(flatten(vehicle, model), errors, at_once), correction)
        for name, (model, correction) in models.items()
    }


def quietly(case: Case, vehicle: Vehicle) -> dict[str, Any]:
    """`contest` without warnings of searches that overflow on their way."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return contest(case, vehicle)


def main() -> int:
    """Fly, contest, print."""
    parser = argparse.ArgumentParser(description="Missing effects by PySINDy, a Gaussian process and this project.")
    parser.add_argument("--effects", default=",".join(RIGHT_TERMS), help="names with commas between")
    parser.add_argument("--seeds", type=int, default=2, help="flights of each effect, every other one calm (default 2)")
    parser.add_argument("--tables", action="store_true", help="fly nothing, print what is there of these sources")
    given = parser.parse_args()
    effects = given.effects.split(",")
    unknown = [name for name in effects if name not in RIGHT_TERMS]
    if unknown:
        parser.error(f"no right term is known for {unknown[0]!r}; there are {', '.join(RIGHT_TERMS)}")
    if given.seeds < 1:
        parser.error("--seeds must be at least 1")
    seeds = range(FIRST_SEED, FIRST_SEED + given.seeds)
    cases = [Case(((name, 1.0),), seed, gust_for(seed), kind_for(name)) for seed in seeds for name in effects]
    path, vehicle = OUTPUT / f"{fingerprint(SOURCES)}.jsonl", the_vehicle()
    path.parent.mkdir(parents=True, exist_ok=True)
    end_line(path)
    done = keyed_lines(path, "key")
    missing = [] if given.tables else [case for case in cases if case.key not in done]
    if missing:
        print("the first flight once, so that all is compiled", file=sys.stderr)
        quietly(missing[0], vehicle)
    begin = time.monotonic()
    for count, case in enumerate(missing, 1):
        line = {"key": case.key, "effect": case.effects[0][0], "gust": case.gust} | quietly(case, vehicle)
        done[case.key] = line
        with path.open("a", encoding="utf-8") as sink:
            sink.write(json.dumps(line) + "\n")
        progress(count, len(missing), time.monotonic() - begin)
    lines = [done[case.key] for case in cases if case.key in done]
    if not lines:
        print("no flight was flown with these sources: run without --tables", file=sys.stderr)
        return 1
    print(report(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
