"""Is the missing effect named where the flight can tell it, and nothing named where not?

Run: make campaign NAME=discrepancy

Each case hides an effect of the catalogue, of some size, in a flight of the simulator; the job is handed the signals in
another process and a baseline that lacks the effect and whose coefficients are off. One line per case is kept in
campaign-output/discrepancy/PART-FINGERPRINT.jsonl, so that a campaign that was stopped goes on where it was; what the
flights can tell at all, by the truth, is kept beside it. Ends with the confusion matrix and the figures, printed and
written as markdown beside the lines.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import numpy as np
from discrepancy_cases import (
    Case,
    baseline_model,
    fly_case,
    gust_for,
    kind_for,
    ruled_out,
    the_vehicle,
    true_model,
)
from discrepancy_scores import IN_A_SET, class_of
from discrepancy_tables import report
from discrepancy_trial import judged
from discrepancy_truth import Truths
from effect_sizes import RANGES, SHARES
from made_up import MADE_UP
from seed_lines import end_line, fingerprint, keyed_lines, one_thread_each, progress
from separating_flights import bench_named, plan_named

from sim_vehicle.effects import EFFECTS, Stage
from sim_vehicle.errors import SimVehicleError

ROOT = Path(__file__).resolve().parents[2]
OUTPUT = ROOT / "campaign-output" / "discrepancy"
# Seeds that no test uses; even ones are calm.
FIRST_SEED = 20_000
PARTS = ("single", "none", "pairs", "off-list", "separating")
# What a line rests on: estimator, simulator and this campaign's flights; what the truth tells rests on less.
SOURCES = (
    "sysid", "sim_vehicle", "discrepancy_cases", "discrepancy_trial", "effect_sizes", "made_up", "separating_flights",
    "simulated",
)  # fmt: skip
TRUE_SOURCES = (
    "sim_vehicle", "discrepancy_cases", "discrepancy_truth", "effect_responses", "effect_sizes", "flight_bounds",
    "gust_bounds",
)  # fmt: skip


def cases_of(part: str, effects: Sequence[str], seeds: int, sizes: int, flights: int) -> list[Case]:
    """All cases of a part, in the order in which they are flown: largest first, all effects of a seed in turn."""
    every = range(FIRST_SEED, FIRST_SEED + seeds)
    if part == "none":
        return [Case((), FIRST_SEED + n, gust_for(FIRST_SEED + n), exact=n // 2 % 2 == 0) for n in range(flights)]
    if part == "pairs":
        return pairs_of(effects, flights)
    off_list = part == "off-list"
    found = [
        Case(((name, share),), seed, gust_for(seed), kind_for(name), unlisted=off_list)
        for share in SHARES[sizes]
        for seed in every
        for name in effects
    ]
    made_up = [Case((), seed, gust_for(seed), made_up=name) for seed in every for name in MADE_UP] if off_list else []
    return made_up + found


def pairs_of(effects: Sequence[str], flights: int) -> list[Case]:
    """As many flights with two effects at their greatest size, drawn at random where one kind of flight shows both."""
    generator = np.random.default_rng(FIRST_SEED)
    told = [name for name in effects if not EFFECTS[name].alias and EFFECTS[name].stage is not Stage.ENVIRONMENT]
    found: list[Case] = []
    while len(found) < flights:
        first, second = (str(name) for name in generator.choice(told, 2, replace=False))
        kinds = {kind_for(first), kind_for(second)} - {"multisine"}
        if len(kinds) < 2:
            seed = FIRST_SEED + len(found)
            pair = ((first, 1.0), (second, 1.0))
            found.append(Case(pair, seed, gust_for(seed), kinds.pop() if kinds else "multisine"))
    return found


def to_separate(cases: Sequence[Case], done: Mapping[str, Mapping[str, Any]], truths: Truths) -> list[Case]:
    """Cases that the flight cannot tell alone by the truth, each with the manoeuvre that the job has named for it."""
    found = []
    for case in cases:
        named = done.get(case.key, {}).get("named")
        if not named:
            continue
        (name, told), *_ = truths.of(case)["effects"].items()
        if class_of(told, name)[0] == IN_A_SET:
            words = named[0]["separating_manoeuvre"]
            bench = bench_named(words)
            found.append(replace(case, bench=bench, also="" if bench else plan_named(words)))
    return found


def run(cases: Sequence[Case], path: Path, workers: int, minutes: float, method: str) -> None:
    """Fly and judge what is missing; a flight is made here while the workers judge those before it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    done = keyed_lines(path, "key")
    missing = [case for case in cases if case.key not in done]
    if not missing:
        return
    end_line(path)
    begin = time.monotonic()
    one_thread_each()
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        try:
            for count, (case, line) in enumerate(_judged(missing, pool, workers, begin + 60.0 * minutes, method), 1):
                with path.open("a", encoding="utf-8") as sink:
                    sink.write(json.dumps(described(case) | line) + "\n")
                progress(count, len(missing), time.monotonic() - begin)
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            raise


def _judged(
    cases: Sequence[Case], pool: ProcessPoolExecutor, workers: int, until: float, method: str
) -> Iterator[tuple[Case, dict[str, Any]]]:
    """Cases with their lines as they are finished; none is begun after `until`."""
    vehicle = the_vehicle()
    waiting: dict[Future[dict[str, Any]], Case] = {}
    for case in cases:
        if time.monotonic() > until:
            break
        try:
            flights = [fly_case(case, vehicle, held_out=held_out)[0] for held_out in (False, True)]
            also = [fly_case(case, vehicle, also=True)[0]] if case.also else []
        except SimVehicleError as error:
            yield case, {"failure": f"not flown: {error}", "verdict": None, "named": []}
            continue
        models = baseline_model(case), None if case.made_up else true_model(case, air=False)
        unlisted = [name for name, _ in case.effects] if case.unlisted else []
        known = unlisted, ruled_out(case)
        waiting[pool.submit(judged, flights[:1] + also, flights[1:], vehicle, *models, *known, method)] = case
        while len(waiting) > workers:
            yield from _finished(waiting)
    while waiting:
        yield from _finished(waiting)


def _finished(waiting: dict[Future[dict[str, Any]], Case]) -> Iterator[tuple[Case, dict[str, Any]]]:
    for future in wait(waiting, return_when=FIRST_COMPLETED).done:
        yield waiting.pop(future), future.result()


def described(case: Case) -> dict[str, Any]:
    """What the line says of the case itself."""
    return {
        "key": case.key,
        "truth_key": case.truth_key,
        "hidden": case.values(),
        "shares": dict(case.effects),
        "seed": case.seed,
        "gust": case.gust,
        "kind": case.kind,
        "exact": case.exact,
        "made_up": case.made_up,
        "also": case.also,
        "bench": case.bench,
    }


def main() -> int:
    """Fly, judge, ask the truth, print."""
    parser = argparse.ArgumentParser(description="Naming of missing effects, over many flights.")
    parser.add_argument("--part", default="single", choices=PARTS, help="which cases (default single: one effect each)")
    parser.add_argument("--effects", default="all", help="names with commas between")
    parser.add_argument("--seeds", type=int, default=5, help="flights of each effect and size (default 5)")
    parser.add_argument("--sizes", type=int, default=2, choices=sorted(SHARES), help="sizes of each effect (default 2)")
    parser.add_argument("--flights", type=int, default=500, help="of the parts `none` and `pairs` (default 500)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--method", default="auto", choices=("auto", "map", "fe"), help="of the job (default auto)")
    parser.add_argument("--minutes", type=float, default=1e9, help="begin no case after so many")
    parser.add_argument("--tables", action="store_true", help="fly nothing, print what is there of these sources")
    given = parser.parse_args()
    known = [name for name in RANGES if name in EFFECTS]
    effects = known if given.effects in ("", "all") else given.effects.split(",")
    unknown = [name for name in effects if name not in known]
    if unknown:
        parser.error(f"no sizes for an effect {unknown[0]!r}; there are {', '.join(known)}")
    if min(given.seeds, given.workers, given.flights) < 1:
        parser.error("--seeds, --workers and --flights must be at least 1")
    cases = cases_of(given.part, effects, given.seeds, given.sizes, given.flights)
    mark = fingerprint(SOURCES) + ("" if given.method == "auto" else f"-{given.method}")
    path = OUTPUT / f"{given.part}-{mark}.jsonl"
    truths = Truths(OUTPUT / f"truth-{fingerprint(TRUE_SOURCES)}.jsonl")
    if given.part == "separating":
        tied = to_separate(cases, keyed_lines(OUTPUT / f"single-{mark}.jsonl", "key"), truths)
        cases = [case for case in tied if case.also or case.bench]
        print(
            f"{len(tied)} cases of the part `single` cannot be told alone; {sum(bool(c.also) for c in cases)} have a "
            f"manoeuvre to fly, {sum(bool(c.bench) for c in cases)} a test on the ground"
        )
    if not given.tables:
        try:
            run(cases, path, given.workers, given.minutes, given.method)
        except KeyboardInterrupt:
            print("stopped; the same command goes on from here", file=sys.stderr)
            return 1
    done = keyed_lines(path, "key")
    lines = [done[case.key] for case in cases if case.key in done]
    flown = [case for case in cases if case.key in done]
    if not lines:
        print(f"no case of the part `{given.part}` was flown with these sources: run without --tables", file=sys.stderr)
        return 1
    text = report(given.part, lines, {case.key: truths.of(case) for case in flown if not case.made_up})
    (OUTPUT / f"{given.part}.md").write_text(text + "\n", encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
