"""Live identification over many flights: errors, coverage, changes that are told and alarms that are false.

Run: make campaign NAME=live (SEEDS=10). One line per seed is kept in campaign-output/live/FINGERPRINT.jsonl, so that a
run that was stopped goes on where it was. Each seed is a flight of 46 s of multisines with the sensors of Table II,
identified live; told once more with an elevator that answers at half from 40 s on; one whose elevator is stuck; and one
in turbulence of an intensity and a length of its own.
With POST=1 the flight is identified afterwards as well, and the live estimates are compared with those.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT / "benchmarks")]

from live_flights import half_elevator, pieces, stuck_elevator  # noqa: E402
from seed_lines import fingerprint, fly_missing  # noqa: E402
from simulated import fly_mav  # noqa: E402

from sim_vehicle.model.model_file import BUILT_IN  # noqa: E402
from sim_vehicle.vehicle.vehicle_file import load_vehicle  # noqa: E402
from sysid.identify import identify  # noqa: E402
from sysid.live.identifier import LiveIdentifier, LiveReport  # noqa: E402
from sysid.signals.flight import FlightSignals  # noqa: E402

OUTPUT = ROOT / "campaign-output" / "live"
FIRST_SEED = 30_000  # no other run's
DURATION_S = 46.0
MAIN = ("CL_alpha", "Cm_alpha", "Cm_de", "Cl_p", "Cl_da", "Cn_beta")
AT_S = (6.0, 11.0, 21.0, 45.6)  # the excitation begins at 1 s
BREAKS_S = 40.0
STUCK_S = 26.0  # the first multisine and the recovery from it are over
EVERY_S = 0.4
GUSTS_M_S, GUSTS_M = (0.1, 0.8), (20.0, 200.0)
MODEL = json.loads((BUILT_IN / "iitb-mav.model.json").read_text(encoding="utf-8"))["coefficients"]


def truth(name: str) -> float:
    """What the simulator flies; a term that is not in its model is 0."""
    return float(MODEL.get(name, {"value": 0.0})["value"])


def flown_live(signals: FlightSignals) -> tuple[list[LiveReport], float]:
    """Reports every 0.4 s, and CPU seconds for each second of the flight."""
    live, reports = LiveIdentifier(load_vehicle("iitb-mav")), []
    begin = time.process_time()
    for count, samples in enumerate(pieces(signals, EVERY_S / 8.0), 1):
        live.take(samples)
        if count % 8 == 0:
            reports.append(live.report())
    return reports, (time.process_time() - begin) / reports[-1].time_s


def first_change(reports: Sequence[LiveReport], after_s: float) -> dict[str, Any] | None:
    """The first change told of what happens at `after_s`, and any that was told before."""
    for report in reports:
        for change in report.changes:
            if change.time_s >= after_s - 3.0:
                return {"told": report.time_s, "since": change.time_s, "coefficient": change.coefficient,
                        "share": change.after / change.before}  # fmt: skip
    return None


def gusts(seed: int) -> str:
    """Turbulence of this seed: intensity and length evenly spread in their logarithms."""
    generator = np.random.default_rng(seed)
    sigma, length = (math.exp(generator.uniform(*np.log(bounds))) for bounds in (GUSTS_M_S, GUSTS_M))
    return f"turbulence:sigma={sigma:.4g},length={length:.4g}"


def by_time(reports: Sequence[LiveReport]) -> dict[str, dict[str, list[float]]]:
    """Value and standard error of what is estimated, by the times of the tables."""
    found = {}
    for at in AT_S:
        report = min(reports, key=lambda one: abs(one.time_s - at))
        found[str(at)] = {
            name: [one.value, one.std] for name, one in report.coefficients.items() if math.isfinite(one.std)
        }
    return found


def trial(seed: int, post: bool) -> dict[str, Any]:
    """One seed: estimates by time, alarms, when breaks were told, and the estimates after the flight."""
    signals, _ = fly_mav("multisine", seed, duration=DURATION_S)
    reports, cpu = flown_live(signals)
    line: dict[str, Any] = {"seed": seed, "cpu": cpu, "alarms": reports[-1].sentences(), "at": by_time(reports)}
    line["warnings"] = list(reports[-1].warnings)
    blown = flown_live(fly_mav("multisine", seed, duration=DURATION_S, effects=(gusts(seed),))[0])[0]
    line["gusts"] = {"at": by_time(blown), "alarms": blown[-1].sentences(), "warnings": list(blown[-1].warnings)}
    line["half"] = first_change(flown_live(half_elevator(signals, BREAKS_S))[0], BREAKS_S)
    resting, _ = fly_mav("multisine,aileron-multisine", seed, duration=40.0)
    line["stuck"] = first_change(flown_live(stuck_elevator(resting, signals, STUCK_S))[0], STUCK_S)
    if post:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = identify([signals], load_vehicle("iitb-mav"), systematic=False, method="oe")
        line["post"] = {
            name: entry.value for name, entry in found.model.coefficients.items() if entry.value is not None
        }
    return line


def estimate_table(lines: Sequence[dict[str, Any]]) -> None:
    """Errors against the truth, and coverage, by time and coefficient."""
    print(f"{'':<10}" + "".join(f"{f'{at - 1.0:.0f} s':>21}" for at in AT_S) + "   (of excitation)")
    print(f"{'':<10}" + f"{'rms %':>8}{'max %':>7}{'in':>6}" * len(AT_S))
    for name in MAIN:
        row = f"{name:<10}"
        for at in AT_S:
            told = np.array([line["at"][str(at)][name] for line in lines])
            error = np.abs(told[:, 0] - truth(name))
            share = 100.0 * error / abs(truth(name))
            inside = np.mean(error < 1.96 * told[:, 1])
            row += f"{np.sqrt(np.mean(share**2)):>8.2f}{share.max():>7.2f}{inside:>6.0%}"
        print(row)
    row = f"{'all':<10}"
    for at in AT_S:
        row += f"{'':>8}{'':>7}{covered(lines, str(at)):>6.0%}"
    print(row)


def break_table(lines: Sequence[dict[str, Any]]) -> None:
    """What was told of what breaks, how late, and false alarms."""
    for kind, at in (("half", BREAKS_S), ("stuck", STUCK_S)):
        told = [line[kind] for line in lines if line[kind] and line[kind]["coefficient"].endswith("_de")]
        late = np.array([entry["told"] - at for entry in told])
        since = np.array([entry["since"] - at for entry in told])
        text = f"{kind} elevator: told in {len(told)} of {len(lines)} flights"
        if told:
            text += f", {np.median(late):.1f} s late (at most {late.max():.1f} s)"
            text += f"; its time is off by {np.median(np.abs(since)):.1f} s (at most {np.abs(since).max():.1f} s)"
        print(text)
    print(f"share of one core, estimator alone: {np.median([line['cpu'] for line in lines]):.1%}")


def alarm_table(lines: Sequence[dict[str, Any]]) -> None:
    """What was told that was not so."""
    alarms = [text for line in lines for text in line["alarms"]]
    print(f"false alarms in {len(lines)} flights of {DURATION_S:.0f} s: {len(alarms)}", *alarms[:5], sep="\n  ")
    warned = [text for line in lines for text in line["warnings"]]
    print(f"warnings: {len(warned)}", *warned[:5], sep="\n  ")


def post_table(lines: Sequence[dict[str, Any]]) -> None:
    """How far the last live estimates lie from those after the flight, in live standard errors."""
    with_post = [line for line in lines if "post" in line]
    if not with_post:
        return
    print("from the estimate after the flight, in live standard errors: rms, share within 2")
    for name in MAIN:
        z = np.array([
            (line["at"][str(AT_S[-1])][name][0] - line["post"][name]) / line["at"][str(AT_S[-1])][name][1]
            for line in with_post
        ])  # fmt: skip
        print(f"{name:<10}{np.sqrt(np.mean(z**2)):>7.2f}{np.mean(np.abs(z) < 2.0):>6.0%}")


def goals(lines: Sequence[dict[str, Any]], blown: Sequence[dict[str, Any]]) -> list[tuple[bool, str]]:
    """What is asked of the flights, and whether it is so."""
    ten = str(AT_S[1])
    found = [
        (
            all(abs(line["at"][ten][name][0] - truth(name)) < 0.05 * abs(truth(name)) for line in lines),
            f"{name} within 5 % of the truth after 10 s of excitation",
        )
        for name in MAIN
    ]
    for at in map(str, AT_S):
        found.append((0.9 <= covered(lines, at) <= 0.98, f"bars hold 90 to 98 % at {at} s"))
        found.append((covered(blown, at) >= 0.9, f"bars hold 90 % at {at} s in turbulence"))
    for kind, at in (("half", BREAKS_S), ("stuck", STUCK_S)):
        told = [line[kind] is not None and line[kind]["coefficient"].endswith("_de") for line in lines]
        soon = [bool(line[kind]) and line[kind]["told"] - at < 3.0 for line in lines]
        found.append((all(told) and all(soon), f"{kind} elevator told within 3 s in every flight"))
    false = [text for line in (*lines, *blown) for text in (*line["alarms"], *line["warnings"])]
    return [*found, (not false, "no false alarm and no warning")]


def covered(lines: Sequence[dict[str, Any]], at: str) -> float:
    """Share of all coefficients of all flights whose 95 % interval holds the truth."""
    told = [(name, *one) for line in lines for name, one in line["at"][at].items()]
    return float(np.mean([abs(value - truth(name)) < 1.96 * std for name, value, std in told]))


def main() -> int:
    """Fly what is missing, then print the tables."""
    parser = argparse.ArgumentParser(description="Live identification over many flights.")
    parser.add_argument("--seeds", type=int, default=100, help="flights (default 100)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--post", action="store_true", help="identify each flight afterwards as well, and compare")
    given = parser.parse_args()
    if given.seeds < 1 or given.workers < 1:
        parser.error("--seeds and --workers must be at least 1")
    mark = fingerprint(("sysid", "sim_vehicle", "live_flights", "simulated")) + ("-post" if given.post else "")
    seeds = range(FIRST_SEED, FIRST_SEED + given.seeds)
    lines = fly_missing(trial, seeds, given.workers, OUTPUT / f"{mark}.jsonl", given.post)
    blown = [line["gusts"] for line in lines]
    estimate_table(lines)
    alarm_table(lines)
    break_table(lines)
    post_table(lines)
    print("\nin turbulence of {:g} to {:g} m/s and {:g} to {:g} m:".format(*GUSTS_M_S, *GUSTS_M))
    estimate_table(blown)
    alarm_table(blown)
    missed = [text for goal, text in goals(lines, blown) if not goal]
    print("\nevery goal is met" if not missed else "\nmissed:", *missed, sep="\n  ")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
