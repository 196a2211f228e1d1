"""The estimator for real flights (`map`) against scipy's least squares and against output error, one run, medians.

A flight of 40 s in gusts. First the search alone: from the same start, with the noise's spectrum as `map` found it held
for both, scipy's `least_squares` (trust region, differences for slopes) takes the same residuals to the same minimum.
Then whole identifications: `map` and `oe`, over the length of the flight.
Run: make bench-posterior
"""

from __future__ import annotations

import statistics
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from simulated import fly_mav

from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.errors import EstimationError
from sysid.identify import identify
from sysid.posterior.estimator import Posterior

Array = NDArray[np.float64]
ROUNDS = 3
MANOEUVRES = "elevator-3211,aileron-doublet,rudder-doublet,multisine"


def cpu(work: Callable[[], object]) -> float:
    """CPU time of one call, s, all threads."""
    began = time.process_time()
    work()
    return time.process_time() - began


def searches(flight: object, vehicle: object) -> list[tuple[Posterior, Array]]:
    """The posteriors that an identification searched last, of each group of axes, and where it began."""
    found: dict[str, tuple[Posterior, Array]] = {}
    search = Posterior.search

    def noted(self: Posterior, start: Array, max_passes: int) -> Array:
        found.setdefault(self.model.group, (self, start.copy()))
        return search(self, start, max_passes)

    Posterior.search = noted  # type: ignore[method-assign]
    try:
        identify([flight], vehicle, method="map", systematic=False)  # type: ignore[list-item, arg-type]
    finally:
        Posterior.search = search  # type: ignore[method-assign]
    return list(found.values())


def by_scipy(posterior: Posterior, start: Array) -> float:
    """Cost that scipy reaches, the noise held."""
    root = np.linalg.cholesky(posterior.prior.information).T

    def residuals(theta: Array) -> Array:
        try:
            at = posterior.point(theta)
        except EstimationError:
            return np.full(size, 1e6)
        parts = [posterior.whitened(i, one[:, :, None])[:, 0] for i, one in enumerate(at.residuals)]
        return np.concatenate((*parts, root @ (theta - posterior.prior.mean)))

    first = posterior.point(start)
    size = sum(posterior.whitened(i, one[:, :, None]).shape[0] for i, one in enumerate(first.residuals)) + start.size
    inside = np.clip(start, posterior.low + 1e-9, posterior.high - 1e-9)
    done = least_squares(residuals, inside, bounds=(posterior.low, posterior.high), x_scale="jac", ftol=1e-6)
    return float(done.cost)


def main() -> None:
    """Print the table."""
    warnings.filterwarnings("ignore", category=RuntimeWarning)
    vehicle = load_vehicle("iitb-mav")
    flight = fly_mav(MANOEUVRES, 3, settings={})[0]
    seconds = float(np.ptp(flight.signals["q"].time_s))
    found = searches(flight, vehicle)  # compiles what there is to compile
    print(f"flight of {seconds:.0f} s, medians of {ROUNDS}\n")
    print(f"{'search':<16}{'unknowns':>10}{'map, s':>10}{'scipy, s':>10}{'ratio':>8}{'cost, scipy over map':>24}")
    for posterior, start in found:
        own, other, ratios = [], [], []
        for _ in range(ROUNDS):
            mine = posterior.of(posterior.model)
            began = time.process_time()
            reached = mine.search(start, 12)  # and leaves the spectrum of where it ended
            own.append(time.process_time() - began)
            began = time.process_time()
            cost = by_scipy(mine, start)
            other.append(time.process_time() - began)
            ratios.append(cost / mine.cost(mine.point(reached)))
        ours, theirs, ratio = (statistics.median(one) for one in (own, other, ratios))
        name = posterior.model.group
        print(f"{name:<16}{start.size:>10}{ours:>10.2f}{theirs:>10.2f}{theirs / ours:>8.1f}{ratio:>24.4f}")
    print(f"\n{'identification':<16}{'CPU, s':>10}{'s per s of flight':>20}{'over oe':>10}")
    spent = {
        method: statistics.median(cpu(lambda m=method: identify([flight], vehicle, method=m)) for _ in range(ROUNDS))  # type: ignore[misc]
        for method in ("oe", "map")
    }
    for method, one in spent.items():
        print(f"{method:<16}{one:>10.2f}{one / seconds:>20.3f}{one / spent['oe']:>10.2f}")


if __name__ == "__main__":
    main()
