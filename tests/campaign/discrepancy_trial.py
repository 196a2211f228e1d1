"""One trial of the discrepancy campaign: the job run on a flight's signals, and the gap that the true model leaves."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from smaller_catalogue import catalogue_without

from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.compatibility.reconstruction import CompatibilityResult, check_compatibility
from sysid.discrepancy import discrepancy
from sysid.discrepancy.gap import fixed_model
from sysid.discrepancy.innovations.posed_flights import BENCH, NUISANCE
from sysid.errors import SysidError
from sysid.output_error.from_problem import fit
from sysid.problem.estimation_problem import Problem
from sysid.problem.formulation import make_problem
from sysid.problem.free_run import gap
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import Prepared, prepare

# Short free runs follow the flight even where the true model's simulation has steps of its own, s.
_RUN_S = 6.0


def judged(
    fit_on: Sequence[FlightSignals],
    judge_on: Sequence[FlightSignals],
    vehicle: Vehicle,
    baseline: Model,
    true: Model | None,
    unlisted: Sequence[str] = (),
    ruled_out: Sequence[str] = (),
    method: str = "auto",
) -> dict[str, Any]:
    """What the job says of a baseline and the flights, and what the truth leaves on the flights to judge by.

    The job gets signals, vehicle, baseline and method, a catalogue without the effects `unlisted`, and what is
    `ruled_out`. "true_gap": output -> gap of the true model, its sensor errors fitted; {} where there is none.
    """
    line: dict[str, Any] = {"failure": None, "verdict": None, "named": [], "reasons": [], "gap": {}}
    begin, begin_cpu = time.monotonic(), time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with catalogue_without(unlisted):
                found = discrepancy(fit_on, vehicle, baseline, validate_on=judge_on, ruled_out=ruled_out, method=method)
        except SysidError as error:
            line["failure"] = str(error)
        else:
            line |= {"verdict": found["verdict"], "named": found["effects"], "reasons": found["reasons"]}
            line |= {"gap": found["gap"], "turbulence": found["turbulence"]}
            line["told"] = {name: entry["value"] for name, entry in found["model"]["coefficients"].items()}
        line["seconds"] = round(time.monotonic() - begin, 2)
        line["cpu_seconds"] = round(time.process_time() - begin_cpu, 2)
        line["true_gap"] = {} if true is None else _true_gap(judge_on, vehicle, true)
    return line


def _true_gap(flights: Sequence[FlightSignals], vehicle: Vehicle, true: Model) -> dict[str, float]:
    """Gap per output of the true model with the flights' own sensor errors fitted; {} where that fails."""
    prepared = [prepare(flight, vehicle) for flight in flights]
    try:
        problem, compatible = _sensors_free(prepared, vehicle)
        own = fit(problem, true, ())
    except SysidError:
        return {}
    records = [stretch.record for flight in prepared for stretch in flight.stretches]
    found = gap(records, prepared[0].layout, fixed_model(problem, true, own, compatible))
    return {name: value for name, value in found.items() if math.isfinite(value)}


def _sensors_free(prepared: Sequence[Prepared], vehicle: Vehicle) -> tuple[Problem, CompatibilityResult]:
    """The problem in which nothing but the sensors' errors is unknown."""
    compatible = check_compatibility(prepared)
    return make_problem(prepared, vehicle, compatible, [*NUISANCE, *BENCH], _RUN_S), compatible


def gap_ratio(over: dict[str, float], under: dict[str, float]) -> float:
    """Quadratic mean over the outputs of one gap over another; NaN where there is none."""
    ratios = [over[name] / value for name, value in under.items() if name in over and value > 0.0]
    return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else math.nan
