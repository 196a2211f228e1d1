"""Bias and coverage of equation error over many simulated flights. Run: make campaign NAME=equation-error

Two ways of pairing a held command with a derivative stand side by side: the mean of two samples, with rates taken
as a series through the samples, and what sysid.equation_error.equations does.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from simulated import fly_mav

import sysid.equation_error.equations
import sysid.equation_error.time_domain
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.compatibility.reconstruction import CompatibilityResult, check_compatibility
from sysid.equation_error.coefficients import body_of
from sysid.equation_error.time_domain import equation_values
from sysid.identification.equation_error import diffuse, estimate_by_equations
from sysid.problem.estimation_problem import excited_motion, free_coefficients
from sysid.problem.formulation import corrected_parts, make_problem
from sysid.problem.model_structure import default_structure
from sysid.signals.preparation import Prepared, prepare

# Seeds that no test uses.
FIRST_SEED = 20_000


def former(
    prepared: list[Prepared], vehicle: Vehicle, compatible: CompatibilityResult, names: list[str]
) -> list[float]:
    """Estimates with the mean of two commands and nothing for how they bend the rates."""
    kept = sysid.equation_error.equations.PAIRING, sysid.equation_error.time_domain.JUMP_ROUNDS
    sysid.equation_error.equations.PAIRING, sysid.equation_error.time_domain.JUMP_ROUNDS = (0.0, 0.5, 0.5, 0.0), 0
    try:
        parts = corrected_parts(prepared, vehicle, compatible)
        told = equation_values(parts, body_of(vehicle), names, prior=diffuse(names))
    finally:
        sysid.equation_error.equations.PAIRING, sysid.equation_error.time_domain.JUMP_ROUNDS = kept
    return [told[name] for name in names]


def main() -> None:
    """Print one row per coefficient and the coverage over all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--manoeuvre", default="multisine")
    chosen = parser.parse_args()
    vehicle, true = load_vehicle("iitb-mav"), read_model("iitb-mav").values()
    before: dict[str, list[float]] = {}
    errors: dict[str, list[float]] = {}
    stds: dict[str, list[float]] = {}
    false_terms = 0
    for seed in range(FIRST_SEED, FIRST_SEED + chosen.seeds):
        prepared = [prepare(fly_mav(chosen.manoeuvre, seed)[0], vehicle)]
        compatible = check_compatibility(prepared)
        motion = excited_motion([stretch.record for flight in prepared for stretch in flight.stretches])
        names = free_coefficients(default_structure(("de", "da", "dr")), motion)
        at_once = make_problem(prepared, vehicle, compatible).command_first
        found = estimate_by_equations(prepared, vehicle, compatible, names, at_once, None, corrected_parts, False)
        for name, value in zip(names, former(prepared, vehicle, compatible, names), strict=True):
            before.setdefault(name, []).append(value - true.get(name, 0.0))
        for name, (value, std) in found.joint.entries().items():
            errors.setdefault(name, []).append(value - true.get(name, 0.0))
            stds.setdefault(name, []).append(std)
        false_terms += any("supports" in warning for warning in found.warnings)
        print(f"{seed - FIRST_SEED + 1} of {chosen.seeds}", file=sys.stderr, end="\r")
    print(f"{chosen.manoeuvre}, {chosen.seeds} flights")
    print("  name           true    bias, two      bias       RMS       std  within 95 %")
    inside = []
    for name, told in errors.items():
        error, std = np.array(told), np.array(stds[name])
        inside.append(float(np.mean(np.abs(error) < 1.96 * std)))
        print(
            f"  {name:9s} {true.get(name, 0.0):9.4f} {np.mean(before[name]):12.5f} {error.mean():9.5f}"
            f" {np.sqrt(np.mean(error**2)):9.5f} {np.median(std):9.5f} {100 * inside[-1]:12.0f}"
        )
    print(f"  intervals that hold the truth, over all: {100 * np.mean(inside):.1f} %")
    print(f"  flights said to support a term that the aircraft does not have: {false_terms}")


if __name__ == "__main__":
    main()
