"""Discrepancy: where simulation and measurement disagree, which effect is missing, and how the gap shrinks with it.

One search and one verdict (sysid.discrepancy.forward_selection, .verdict), under one of two noise models: flights of
the textbooks are compared by filter error (.innovations), which is nearer to the bound there, all others with an
estimated noise spectrum (.spectrum), and those of the textbooks too that filter error cannot follow; it tries what the
other named. Which they are is seen as `identify` sees it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from sim_vehicle.effects import effect_called
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.discrepancy.candidate_fit import Fit
from sysid.discrepancy.comparison import MAX_EFFECTS, Asked, Compared, Comparison, Outcome, Progress
from sysid.discrepancy.forward_selection import SelectionState, select
from sysid.discrepancy.gap import stage_gaps
from sysid.discrepancy.identified_effect import effect_json
from sysid.discrepancy.innovations import comparison as innovations
from sysid.discrepancy.localisation import locate
from sysid.discrepancy.summary import sentence
from sysid.discrepancy.verdict import outcome
from sysid.errors import SysidError
from sysid.identification.repaired_flight import read_flights
from sysid.numerics.threads import single_threaded
from sysid.problem.coefficient_residuals import CoefficientPath, coefficient_path
from sysid.quality.flight_quality import CARE, Reason
from sysid.signal_check.corrected_faults import require_searched
from sysid.signals.flight import FlightSignals
from sysid.validation.simulation_series import simulation_series

__all__ = ["MAX_EFFECTS", "discrepancy"]

_COMPARED = 0.8  # of the progress
_NOTHING_NAMED = "flight and model disagree in a way that nothing in the catalogue names"


@single_threaded
def discrepancy(
    flights: Sequence[FlightSignals],
    vehicle: Vehicle,
    model: Model,
    *,
    validate_on: Sequence[FlightSignals] = (),
    start_s: float | None = None,
    stop_s: float | None = None,
    ruled_out: Sequence[str] = (),
    as_recorded: Sequence[str] = (),
    method: str = "auto",
    progress: Progress = lambda share, text: None,
    seed: int = 0,
) -> dict[str, Any]:
    """Compare a model with flights.

    flights: used to fit. validate_on: used only to show the gap. model: the baseline, every coefficient with a value.
    ruled_out: effects that are known not to be there, because the aircraft was weighed or a sensor was on the bench.
    as_recorded: signals that are right as recorded, whatever seems.
    method: "map" by the posterior with an estimated noise spectrum, "fe" by filter error; "auto" is "map", and "fe" for
    flights of the textbooks. seed: of the noise in the noise floor. Returns the result file
    (schema discrepancy/1). Raises SysidError subclasses, and ModelFileError for a model without a needed value or an
    effect that nobody knows, in one line.
    """
    flatten(vehicle, model)
    for name in ruled_out:
        effect_called(name)
    require_searched(as_recorded)
    asked = Asked(flights, vehicle, model, validate_on, start_s, stop_s, ruled_out, as_recorded, progress)
    return _result(_compared(asked, method), vehicle, progress, np.random.default_rng(seed))


def _compared(asked: Asked, method: str) -> Outcome:
    from sysid.discrepancy.spectrum import comparison as spectrum  # slow to import

    asked.progress(0.02, "units, signs and axes")
    read = read_flights(asked.flights, asked.validate_on, asked.vehicle, asked.as_recorded, asked.start_s, asked.stop_s)
    asked = replace(asked, vehicle=read.doubted(asked.vehicle))
    if method == "fe":
        return outcome(*_searched(asked, innovations.begin(asked, read)))
    field = spectrum.begin(asked, read)
    if field is not None:
        return outcome(*_searched(asked, field))
    if method == "map":
        within = _between(0.28, _COMPARED, asked)
        return outcome(*_searched(within, spectrum.begin_textbook(within, read)))
    other = None
    with suppress(SysidError):
        within = _between(0.28, 0.4, asked)
        other = _searched(within, spectrum.begin_textbook(within, read))
    within = _between(0.4, _COMPARED, asked)
    try:
        comparison, search = _searched(within, innovations.begin(within, read, other[1].named if other else ()))
        lost = comparison.lost(search.fit) if search.named and other is not None else ""
        found = outcome(comparison, search)
        return (_named_by(other, lost) if other and lost else None) or found
    except SysidError as error:
        if other is None:
            raise
        with suppress(SysidError):
            return _instead(other, error)
        raise


def _instead(other: tuple[Comparison[Fit], SelectionState[Fit]], why: object) -> Outcome:
    """What another search comes to, and why it is taken."""
    found = outcome(*other)
    return replace(found, warnings=(f"filter error cannot be used: {why}", *found.warnings))


def _named_by(other: tuple[Comparison[Fit], SelectionState[Fit]], why: str) -> Outcome | None:
    """What another search comes to where that has a name; None else."""
    with suppress(SysidError):
        found = _instead(other, why)
        return found if found.named else None
    return None


def _searched(asked: Asked, comparison: Comparison[Fit]) -> tuple[Comparison[Fit], SelectionState[Fit]]:
    """A comparison with the effects that are found."""
    ruled_out = frozenset(asked.ruled_out)
    return comparison, select(comparison.base, ruled_out, lambda share, text: asked.progress(0.28 + 0.42 * share, text))


def _between(begin: float, end: float, asked: Asked) -> Asked:
    """What is asked, of a comparison that is so much of all."""
    width = (end - begin) / _COMPARED
    return replace(asked, progress=lambda share, text: asked.progress(begin + width * share, text))


def _result(found: Outcome, vehicle: Vehicle, progress: Progress, generator: np.random.Generator) -> dict[str, Any]:
    progress(_COMPARED, "the gap on the flights used")
    verdict, explained = found.verdict.name, found.verdict.explained
    shown = ("before", "after") if found.named else ("given", "before")
    sets = {"estimation": found.used} | ({} if found.judged is None else {"validation": found.judged})
    gaps, series = {}, {}
    for name, of in sets.items():
        if name == "validation":
            progress(0.88, "the gap on the other flights")
        gaps[name] = stage_gaps(of, generator)
        series[name] = simulation_series(of.flights, of.stages, shown)
    # What coefficients fitted again explain is not where an effect is missing.
    stage_before = "given" if verdict == "parameter_error" else "before"
    where = _where(found.used, vehicle, stage_before) if verdict != "none" else []
    progress(1.0, "done")
    quality = found.quality
    if verdict == "unexplained":
        quality = replace(quality, reasons=(*quality.reasons, Reason(CARE, _NOTHING_NAMED)))
    result = {
        "schema": "discrepancy/1",
        "flights": [flight.data.name for flight in found.used.flights],
        "method": found.method,
        "ruled_out": sorted(found.ruled_out),
        "verdict": verdict,
        "complete": explained.complete,
        "left": explained.left_json(),
        "nearest": explained.nearest_json() if verdict == "unexplained" else None,
        "reasons": list(found.verdict.reasons),
        "where": where,
        "effects": [effect_json(named, found.model) for named in found.named],
        "gap": gaps,
        "series": series,
        "model": found.model.to_json(),
        "turbulence": found.turbulence,
        "quality": quality.to_json(),
        "warnings": list(dict.fromkeys(found.warnings)),
    }
    return {"schema": result["schema"], "sentence": sentence(result), **result}


def _where(used: Compared, vehicle: Vehicle, stage_before: str) -> list[dict[str, Any]]:
    axes = [a for a in ("CL", "CD", "Cm") if used.motion.longitudinal]
    axes += [a for a in ("CY", "Cl", "Cn") if used.motion.lateral]
    stages: Mapping[str, Any] = used.stages
    paths: dict[str, list[tuple[str, CoefficientPath]]] = {stage_before: [], "after": []}
    for flight in used.flights:
        for stretch in flight.stretches:
            for stage, found in paths.items():
                along = coefficient_path(stretch.record, flight.layout, vehicle, stages[stage])
                found.append((flight.data.name, along))
    found_better = stages[stage_before] is not stages["after"]
    return locate(paths[stage_before], [path for _, path in paths["after"]] if found_better else (), axes)
