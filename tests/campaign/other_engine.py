"""How true identification is to another engine: flights made by JSBSim, identified. Run: make campaign NAME=jsbsim

Scenarios: `linear` (aerodynamics of the default structure, nothing told), `tables` (aerodynamics in tables, the
structure extended by what the tables depend on) and `tables-linear` (the same flights, nothing told: what a linear
model of it is worth). Each line of the store is one identified flight; a run that is broken off goes on where it
stopped. Truth is what JSBSim's own six coefficients give by least squares along the true motion. The bound is Cramer
and Rao's for the true coefficients and the true noise, given the same starts and sensor errors to estimate.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from jsbsim_flight import NOISE, Aircraft, fly, linear_aircraft, measure, slopes, table_aircraft
from own_bars import own_bar

from sim_vehicle.model.model_file import Coefficient, Model
from sysid.errors import SysidError
from sysid.identify import Identification, identify
from sysid.output_error.from_problem import build
from sysid.problem.formulation import make_problem
from sysid.problem.model_structure import default_structure
from sysid.signals.record import OUTPUTS

ROOT = Path(__file__).parents[2]
LINEAR = default_structure(("de", "da", "dr"))
# Each dependence that a table holds, to second order in angle of attack (drag is then no parabola in lift).
TABLES = (
    *(name for name in LINEAR if name != "CD_k"),
    *("CL_alpha2", "CD_alpha", "CD_alpha2", "Cm_alpha2", "Cm_alpha_de", "Cl_alpha_beta", "Cl_alpha_p", "Cn_alpha_beta"),
)
SCENARIOS = {
    "linear": (linear_aircraft, None),
    "tables": (table_aircraft, TABLES),
    "tables-linear": (table_aircraft, None),
}
MAIN = ("CL_alpha", "Cm_alpha", "Cm_de", "Cm_q", "Cl_p", "Cl_da", "Cn_beta", "Cn_dr")
# Derivatives that the extended structure makes a line in angle of attack: their slope term and its factor.
ALONG_ALPHA = {
    "CL_alpha": ("CL_alpha2", 2.0),
    "Cm_alpha": ("Cm_alpha2", 2.0),
    "Cm_de": ("Cm_alpha_de", 1.0),
    "Cl_p": ("Cl_alpha_p", 1.0),
    "Cn_beta": ("Cn_alpha_beta", 1.0),
}


def version() -> str:
    """Short digest of the sources that the estimates depend on."""
    paths = sorted(path for package in ("sysid", "sim_vehicle") for path in (ROOT / package).rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()[:12]


def bounds(
    found: Identification, aircraft: Aircraft, truth: dict[str, float], hidden: dict[str, float]
) -> dict[str, float]:
    """Cramer-Rao bound of each coefficient: information at the truth with the true noise, no prior."""
    problem = make_problem(found.flights, aircraft.vehicle, found.compatibility, ground=True)
    sigma = np.array([NOISE[name][0] for name in OUTPUTS])
    model = Model("truth", {name: Coefficient(value) for name, value in truth.items()})
    names = {"accel_bias_": "a", "gyro_bias_": ""}
    values = dict(truth)
    for name in problem.sensors:
        start = next((key for key in names if name.startswith(key)), None)
        values[name] = hidden[f"{names[start]}{name.removeprefix(start)}_bias"] if start else hidden.get(name, 0.0)
    result = build(problem, model, list(truth), sigma=sigma).solve(values, max_iterations=0)
    return {name: result.std_white(name) for name in truth}


def one(scenario: str, seed: int) -> dict[str, Any]:
    """Fly, identify and judge one flight: a line of the store."""
    make, structure = SCENARIOS[scenario]
    aircraft = make()
    with tempfile.TemporaryDirectory() as folder:
        flown = fly(Path(folder), aircraft, seed)
    names = structure or LINEAR
    truth = slopes(flown, aircraft.vehicle, names)
    signals, hidden = measure(flown, seed, f"{scenario}-{seed}")
    line: dict[str, Any] = {"scenario": scenario, "seed": seed, "version": version(), "truth": truth}
    line["alpha"] = float(np.mean(flown.true["true_alpha"]))
    told = None if structure is None else Model("told", {name: Coefficient(0.0) for name in structure})
    began = time.process_time()
    try:
        found = identify([signals], aircraft.vehicle, structure=told)
    except SysidError as error:
        return {**line, "error": str(error)}
    line["seconds"] = time.process_time() - began
    line["bound"] = bounds(found, aircraft, truth, hidden)
    line["estimate"] = {
        name: [entry.value, own_bar(entry)]
        for name, entry in found.model.coefficients.items()
        if entry.value is not None
    }
    line["refused"] = [refusal.name for refusal in found.refused]
    line["warnings"] = list(found.warnings)
    return line


def read(store: Path) -> dict[tuple[str, int], dict[str, Any]]:
    """Lines of the store; a last line that was cut off is left out."""
    lines: dict[tuple[str, int], dict[str, Any]] = {}
    for text in store.read_text(encoding="utf-8").splitlines() if store.exists() else ():
        try:
            line = json.loads(text)
        except json.JSONDecodeError:
            continue
        lines[line["scenario"], line["seed"]] = line
    return lines


def identifiable(name: str, bound: float, truth: float) -> bool:
    """Whether the bound is below a fifth of the value, or 0.02 where the value is 0."""
    return bound < (0.2 * abs(truth) if abs(truth) > 1e-6 else 0.02)


def at_mean_alpha(values: dict[str, float], name: str, alpha: float) -> float:
    """A derivative at the flight's mean angle of attack."""
    slope, factor = ALONG_ALPHA.get(name, ("", 0.0))
    return values[name] + factor * values.get(slope, 0.0) * alpha


def report(scenario: str, lines: Iterable[dict[str, Any]]) -> None:
    """Print the table of one scenario."""
    lines = list(lines)
    good = [line for line in lines if "error" not in line]
    versions = sorted({line["version"] for line in lines})
    print(
        f"\n{scenario}: {len(lines)} flights, {len(lines) - len(good)} without a result, sources {', '.join(versions)}"
    )
    if not good:
        return
    heads = (f"{head:>10}" for head in ("truth", "bias", "bound", "rms/bound", "std/bound"))
    print(f"{'':<14}{''.join(heads)}{'held':>7}{'refused':>9}")
    inside, ratios = [], []
    for name in good[0]["truth"]:
        told = [line for line in good if name in line["estimate"]]
        refused = [line for line in good if name not in line["estimate"]]
        missed = [line for line in refused if identifiable(name, line["bound"][name], line["truth"][name])]
        if not told:
            print(f"{name:<14}{np.median([line['truth'][name] for line in good]):>10.4f}{'refused throughout':>20}")
            continue
        truth, bound = (np.array([line[key][name] for line in told]) for key in ("truth", "bound"))
        value, std = np.array([line["estimate"][name] for line in told]).T
        held = np.abs(value - truth) < 1.96 * std
        inside += held.tolist()
        ratios += (std / bound).tolist()
        print(
            f"{name:<14}{np.median(truth):>10.4f}{np.mean(value - truth):>10.5f}{np.median(bound):>10.5f}"
            f"{np.sqrt(np.mean(((value - truth) / bound) ** 2)):>10.2f}{np.median(std / bound):>10.2f}"
            f"{held.mean():>7.0%}"
            f"{f'{len(refused)} ({len(missed)})':>9}"
        )
    print(
        f"all 95 % intervals: {np.mean(inside):.1%} of {len(inside)} hold the truth; "
        f"median std {np.median(ratios):.2f} bounds"
    )
    for name in MAIN:
        errors = [
            at_mean_alpha({key: pair[0] for key, pair in line["estimate"].items()}, name, line["alpha"])
            / at_mean_alpha(line["truth"], name, line["alpha"])
            - 1.0
            for line in good
            if name in line["estimate"] and ALONG_ALPHA.get(name, (name,))[0] in {*line["estimate"], *_absent(line)}
        ]
        if errors:
            print(f"  {name:<9} at the mean angle of attack: median error {np.median(np.abs(errors)):.2%}")
    print(f"CPU of an identification: median {np.median([line['seconds'] for line in good]):.1f} s")


def _absent(line: dict[str, Any]) -> set[str]:
    """Slope terms that the structure does not have."""
    return {slope for slope, _ in ALONG_ALPHA.values() if slope not in line["truth"]}


def main() -> None:
    """Fly what is missing and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--scenario", choices=(*SCENARIOS, "all"), default="all")
    parser.add_argument("--store", type=Path, default=Path("campaign-output/other-engine.jsonl"))
    parser.add_argument("--table", action="store_true", help="print the tables of what is there, fly nothing")
    options = parser.parse_args()
    scenarios = list(SCENARIOS) if options.scenario == "all" else [options.scenario]
    options.store.parent.mkdir(parents=True, exist_ok=True)
    lines = read(options.store)
    wanted = [(name, seed) for seed in range(options.seeds) for name in scenarios if (name, seed) not in lines]
    for place, (name, seed) in enumerate([] if options.table else wanted, 1):
        line = one(name, seed)
        lines[name, seed] = line
        with options.store.open("a", encoding="utf-8") as store:
            store.write(json.dumps(line) + "\n")
        print(f"{place}/{len(wanted)} {name} {seed} {line.get('error', '')}", file=sys.stderr, flush=True)
    for name in scenarios:
        report(name, [line for (of, _), line in sorted(lines.items()) if of == name])


if __name__ == "__main__":
    main()
