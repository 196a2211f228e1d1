"""Whether flights keep what `gcs design` promised. Run: make campaign NAME=design

Designs a plan, flies it once per seed in the simulator (other noise and other integration steps than the design's) and
identifies each flight. Prints per coefficient the standard error predicted before the first flight, the RMS error of
the estimates over it, and the median of the standard errors reported over it. Exit code 1 where the pooled ratios lie
outside what chance allows: the RMS error's between 0.9 and 1.1, the reported one's between 0.95 and 1.05.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from dataclasses import dataclass

import numpy as np
from own_bars import own_bar

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.design import predict
from sysid.design.manoeuvre_sizing import tuned_plan
from sysid.design.simulated_flight import rehearse
from sysid.identify import identify

FIRST_SEED = 30_000
SIMULATION_STEP_S = 0.0021
ERROR_RANGE, REPORTED_RANGE = (0.9, 1.1), (0.95, 1.05)


@dataclass(frozen=True)
class Scenario:
    """A vehicle, the manoeuvres that are tuned for it, and their spectrum."""

    vehicle: str
    manoeuvres: tuple[str, ...]
    spectrum: str = "flat"


SCENARIOS = {
    "multisine": Scenario("iitb-mav", ("multisine",), "d-optimal"),
    "3211": Scenario("iitb-mav", ("elevator-3211", "aileron-3211", "rudder-3211")),
    "ultrastick25e": Scenario("ultrastick25e", ("multisine",), "d-optimal"),
}


def run(name: str, seeds: int) -> bool:
    """Fly and print one scenario; whether the promise was kept."""
    scenario = SCENARIOS[name]
    vehicle, model = load_vehicle(scenario.vehicle), read_model(scenario.vehicle)
    # The structure is the aircraft's own, so that nothing that is left out moves what is estimated.
    plan = tuned_plan(vehicle, model, scenario.manoeuvres, spectrum=scenario.spectrum, structure=model)
    promised = predict(vehicle, model, plan, structure=model)
    names = [entry.name for entry in promised.coefficients]
    truth = np.array([model.values()[n] for n in names])
    std = np.array([promised.std(n) for n in names])
    misses, reported = [], []
    for number in range(seeds):
        signals, _ = rehearse(vehicle, model, plan, seed=FIRST_SEED + number, max_step=SIMULATION_STEP_S)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = identify([signals], vehicle, structure=model, systematic=False).model.coefficients
        row = [(np.nan, np.nan) if (e := found[n]).value is None else (e.value, own_bar(e)) for n in names]
        values, errors = np.array(row, dtype=np.float64).T
        misses.append((values - truth) / std)
        reported.append(errors / std)
        if (number + 1) % 8 == 0:
            print(f"{name}: {number + 1} of {seeds} flights", file=sys.stderr, flush=True)
    return _tell(name, names, std, np.array(misses), np.array(reported))


def _tell(name: str, names: list[str], std: np.ndarray, misses: np.ndarray, reported: np.ndarray) -> bool:
    rms = np.sqrt(np.nanmean(misses**2, axis=0))
    median = np.nanmedian(reported, axis=0)
    print(f"\n{name}, {misses.shape[0]} flights")
    print(f"{'coefficient':<12}{'predicted':>12}{'RMS error/pred.':>17}{'reported/pred.':>16}{'refused':>9}")
    for i, coefficient in enumerate(names):
        refused = int(np.isnan(misses[:, i]).sum())
        print(f"{coefficient:<12}{std[i]:>12.3g}{rms[i]:>17.2f}{median[i]:>16.3f}{refused:>9}")
    pooled, told = float(np.sqrt(np.nanmean(misses**2))), float(np.nanmedian(reported))
    print(f"{'all':<12}{'':>12}{pooled:>17.2f}{told:>16.3f}")
    return ERROR_RANGE[0] <= pooled <= ERROR_RANGE[1] and REPORTED_RANGE[0] <= told <= REPORTED_RANGE[1]


def main() -> int:
    """Run the scenarios asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--scenarios", default=",".join(SCENARIOS), help="names, comma between")
    given = parser.parse_args()
    kept = [run(name, given.seeds) for name in given.scenarios.split(",")]
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())
