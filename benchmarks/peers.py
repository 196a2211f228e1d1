"""Identification of the same flights by this project, scipy, AeroID and statsmodels. Run: make bench-peers

The flights: the reference paper's aircraft flies multisines of all surfaces in calm air, with the sensors' noise and
biases of Table II. Unknown are 28 coefficients, six biases of the IMU and the scales of both vanes. This project gets
the sensors' signals and the vehicle file. The others are given more than a real flight gives: the true noise of every
sensor, true thrust and density, sensors moved to the centre of gravity, which sensor errors there are, and compiled
equations of motion. All searches start from the same equation error, with the motion's first sample.

AeroID interpolates commands between samples and starts from a state that is given: here it is told commands half a
sample late, which is what a held command comes to, and its states are distances from a start that counts among its
parameters. statsmodels fits the columns that this project's equation error makes.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import aeroid
import numpy as np
import statsmodels.api as sm
from numpy.typing import NDArray
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from flight_bounds import (
    LATERAL_OUTPUTS,
    LONGITUDINAL_OUTPUTS,
    Experiment,
    bounds,
    calm_information,
    slopes,
    true_model,
)
from peer_equations import (
    COEFFICIENTS,
    OUTPUTS,
    SENSORS,
    STARTS,
    STATES,
    PeerFlight,
    peer_flight,
    rates,
    readings,
    simulated,
)
from simulated import fly_mav
from table_two import with_table_two

from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.compatibility.reconstruction import CompatibilityResult, check_compatibility
from sysid.equation_error.coefficients import body_of
from sysid.equation_error.equations import CUTOFF_HZ, axes_of
from sysid.equation_error.time_domain import settled_equations
from sysid.identification.equation_error import diffuse
from sysid.identify import identify
from sysid.problem.formulation import corrected_parts, make_problem
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import Prepared, prepare

Array = NDArray[np.float64]
Estimates = dict[str, tuple[float, float]]  # coefficient -> value and standard error

MAIN = (
    *("CL_alpha", "CL_de", "CD_0", "Cm_alpha", "Cm_q", "Cm_de"),
    *("CY_beta", "CY_dr", "Cl_beta", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr"),
)
FIRST_SEED = 70_000
_SIGMA = np.array(list(OUTPUTS.values()))


@dataclass(frozen=True)
class Case:
    """One flight: as recorded, as the peers get it, and the Cramer-Rao bound of each coefficient."""

    signals: FlightSignals
    peer: PeerFlight
    bound: Mapping[str, float]


def bound_of_flight(flown: FlownFlight, vehicle: Vehicle) -> dict[str, float]:
    """Smallest standard error of each coefficient, from the truth; what the peers are told counts as unknown."""
    outputs = (*LONGITUDINAL_OUTPUTS, *LATERAL_OUTPUTS)
    told = slopes(Experiment(flown, vehicle, true_model(read_model("iitb-mav"), COEFFICIENTS), outputs, True))
    return bounds(told.names, calm_information(told), [*COEFFICIENTS, *SENSORS])


def by_output_error(case: Case, vehicle: Vehicle) -> Estimates:
    """This project's identification, as `gcs identify` runs it, without the systematic column."""
    found = identify([case.signals], vehicle, systematic=False)
    return _told(found.model.coefficients)


def by_equation_error(case: Case, vehicle: Vehicle) -> Estimates:
    """The same with --method ee."""
    return _told(identify([case.signals], vehicle, method="ee", systematic=False).model.coefficients)


def by_posterior(case: Case, vehicle: Vehicle) -> Estimates:
    """The same with --method map, the vehicle file saying what Table II says of servos and sensors."""
    found = identify([case.signals], with_table_two(vehicle), method="map", systematic=False)
    return _told(found.model.coefficients)


def _told(entries: Mapping[str, object]) -> Estimates:
    given = {name: (getattr(one, "value", None), getattr(one, "std", None)) for name, one in entries.items()}
    return {name: (float(v), float(s)) for name, (v, s) in given.items() if v is not None and s is not None}


def prepared_columns(case: Case, vehicle: Vehicle) -> dict[str, tuple[list[str], Array, Array]]:
    """Per axis the names, regressand and regressors of this project's equation error."""
    prepared: list[Prepared] = [prepare(case.signals, vehicle)]
    compatible: CompatibilityResult = check_compatibility(prepared)
    at_once = make_problem(prepared, vehicle, compatible).command_first
    parts, body = corrected_parts(prepared, vehicle, compatible), body_of(vehicle)
    equations = settled_equations(parts, body, COEFFICIENTS, CUTOFF_HZ, at_once, diffuse(COEFFICIENTS))
    columns = {}
    for axis, terms in axes_of([parse_term(name) for name in COEFFICIENTS]):
        columns[axis] = [term.name for term in terms], equations.regressand(axis), equations.matrix(terms)
    return columns


def by_statsmodels(case: Case, vehicle: Vehicle) -> Estimates:
    """Ordinary least squares, axis by axis, its own standard errors."""
    found: Estimates = {}
    for names, y, X in prepared_columns(case, vehicle).values():
        fitted = sm.OLS(y, X).fit()
        found |= dict(zip(names, zip(fitted.params.tolist(), fitted.bse.tolist(), strict=True), strict=True))
    return found


def by_scipy(case: Case, vehicle: Vehicle) -> Estimates:
    """least_squares with differences for slopes; bars from the Jacobian."""
    flight = case.peer

    def residuals(theta: Array) -> Array:
        flown = simulated(theta, flight.commands, flight.air, flight.interval_s, flight.body)
        return np.asarray(((flown - flight.measured) / _SIGMA).ravel())

    found = least_squares(residuals, flight.start, x_scale="jac", method="trf")
    variance = 2.0 * found.cost / (found.fun.size - found.x.size)
    std = np.sqrt(variance * np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    return {name: (float(found.x[i]), float(std[i])) for i, name in enumerate(COEFFICIENTS)}


def by_aeroid(case: Case, vehicle: Vehicle) -> Estimates:
    """AeroID's output error with its own integrator and standard errors."""
    flight = case.peer
    names = (*COEFFICIENTS, *SENSORS, *STARTS)
    count, first = len(COEFFICIENTS), len(COEFFICIENTS) + len(SENSORS)

    def values(p: Mapping[str, float]) -> Array:
        return np.array([p[name] for name in names])

    def dynamics(t: float, x: Array, u: Array, p: Mapping[str, float]) -> Array:
        theta = values(p)
        return rates(x + theta[first:], u[:3], u[6:], theta[:count], flight.body)

    def measurement(t: float, x: Array, u: Array, p: Mapping[str, float]) -> Array:
        theta = values(p)
        return readings(x + theta[first:], u[3:6], u[6:], theta[:count], theta[count:first], flight.body)

    before = np.vstack([flight.commands[:1], flight.commands[:-1]])
    inputs = np.column_stack([0.5 * (flight.commands + before), before, flight.air])
    controls = ("de", "da", "dr", "de_seen", "da_seen", "dr_seen", "thrust", "density")
    # AeroID divides by the first guesses.
    start = np.where(flight.start == 0.0, 1e-3, flight.start)
    model = aeroid.Model(
        states=tuple(f"d_{name}" for name in STATES), controls=controls, outputs=tuple(OUTPUTS),
        parameters=dict(zip(names, start.tolist(), strict=True)), dynamics=dynamics, measurement=measurement,
    )  # fmt: skip
    channels = dict(zip(OUTPUTS, flight.measured.T, strict=True)) | dict(zip(controls, inputs.T, strict=True))
    found = aeroid.identify(
        model, aeroid.FlightData(flight.time_s, channels), list(names), x0=np.zeros(len(STATES)),
        weights={name: 1.0 / sigma for name, sigma in OUTPUTS.items()},
        simulate_options={"rtol": 1e-6, "atol": 1e-8},
    )  # fmt: skip
    return {name: (float(found.parameters[name]), float(found.stderr[name])) for name in COEFFICIENTS}


CONTESTANTS: dict[str, Callable[[Case, Vehicle], Estimates]] = {
    "ours": by_output_error, "ours, map": by_posterior, "ours, ee": by_equation_error, "statsmodels": by_statsmodels,
    "scipy": by_scipy, "AeroID": by_aeroid,
}  # fmt: skip


@dataclass
class Account:
    """What one contestant did over the flights: errors and bars by coefficient, in bounds; CPU seconds."""

    errors: dict[str, list[float]] = field(default_factory=dict)
    inside: list[bool] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    refused: int = 0

    def take(self, found: Estimates, case: Case, true: Mapping[str, float], seconds: float) -> None:
        """Add one flight."""
        self.seconds.append(seconds)
        for name in COEFFICIENTS:
            if name not in found:
                self.refused += 1
                continue
            value, std = found[name]
            error = value - true.get(name, 0.0)
            self.errors.setdefault(name, []).append(error / case.bound[name])
            self.inside.append(abs(error) < 1.96 * std)

    def rms(self, name: str) -> float:
        """RMS error of a coefficient over its bound."""
        return float(np.sqrt(np.mean(np.square(self.errors[name])))) if name in self.errors else np.nan

    def total(self) -> float:
        """The same over all coefficients."""
        return float(np.sqrt(np.mean(np.square(np.concatenate(list(self.errors.values()))))))


def cases(seeds: int, seconds: float, vehicle: Vehicle) -> list[Case]:
    """The flights; every search starts from ordinary least squares on this project's columns."""
    made = []
    for seed in range(FIRST_SEED, FIRST_SEED + seeds):
        signals, flown = fly_mav("multisine", seed, duration=seconds)
        blank = Case(signals, peer_flight(flown, vehicle, np.zeros(len(COEFFICIENTS)).tolist()), {})
        guess = by_statsmodels(blank, vehicle)
        peer = peer_flight(flown, vehicle, [guess[name][0] for name in COEFFICIENTS])
        made.append(Case(signals, peer, bound_of_flight(flown, vehicle)))
    return made


def table(accounts: Mapping[str, Account]) -> str:
    """Rows of main coefficients, then what holds over all 28."""
    width = 14
    lines = [f"{'RMS error / bound':<26}" + "".join(f"{name:>{width}}" for name in accounts)]
    lines += [f"  {name:<24}" + "".join(f"{a.rms(name):>{width}.2f}" for a in accounts.values()) for name in MAIN]
    lines.append(f"{'all 28 coefficients':<26}" + "".join(f"{a.total():>{width}.2f}" for a in accounts.values()))
    shares = (f"{np.mean(a.inside):>{width}.0%}" for a in accounts.values())
    lines.append(f"{'95 % intervals that hold':<26}" + "".join(shares))
    lines.append(f"{'refused':<26}" + "".join(f"{a.refused:>{width}}" for a in accounts.values()))
    medians = {name: statistics.median(a.seconds) for name, a in accounts.items()}
    lines.append(f"{'CPU s, median':<26}" + "".join(f"{s:>{width}.2f}" for s in medians.values()))
    lines.append(f"{'CPU over ours':<26}" + "".join(f"{s / medians['ours']:>{width}.2f}" for s in medians.values()))
    lines.append(f"{'flights':<26}" + "".join(f"{len(a.seconds):>{width}}" for a in accounts.values()))
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Identification of the same flights by this project and its peers.")
    parser.add_argument("--seeds", type=int, default=8, help="flights (default 8)")
    parser.add_argument(
        "--aeroid-seeds", type=int, default=2, help="of these, flights that AeroID gets too (default 2)"
    )
    parser.add_argument("--seconds", type=float, default=12.0, help="length of a flight (default 12)")
    options = parser.parse_args()
    vehicle, true = load_vehicle("iitb-mav"), read_model("iitb-mav").values()
    flights = cases(options.seeds, options.seconds, vehicle)
    accounts = {name: Account() for name in CONTESTANTS}
    for name in ("ours", "ours, map", "ours, ee", "scipy"):
        CONTESTANTS[name](flights[0], vehicle)  # compiled, as on every call but the first
    for i, case in enumerate(flights):
        turn = list(CONTESTANTS) if i % 2 == 0 else list(CONTESTANTS)[::-1]
        for name in turn:
            if name == "AeroID" and i >= options.aeroid_seeds:
                continue
            began = time.process_time()
            found = CONTESTANTS[name](case, vehicle)
            accounts[name].take(found, case, true, time.process_time() - began)
            print(f"flight {i + 1} of {len(flights)}: {name}, {accounts[name].seconds[-1]:.1f} s", file=sys.stderr)
    print(table({name: account for name, account in accounts.items() if account.seconds}))


if __name__ == "__main__":
    main()
