"""What an identification reports of its estimates: the model with its refusals, ranges and what stands beside."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.errors import SimVehicleError
from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.model_file import Coefficient, Correlation, Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.compatibility.reconstruction import CompatibilityResult, Refusal
from sysid.equation_error.dead_surfaces import part_of
from sysid.identification.dimensional import dimensional_derivatives
from sysid.identification.equation_error import EquationEstimate
from sysid.identification.linear_model import LinearModel, linearise
from sysid.problem.estimation_problem import coefficient_entries, flying
from sysid.problem.model_structure import helpful_manoeuvre, is_longitudinal
from sysid.quality.estimate_rules import with_no_aircraft
from sysid.quality.flight_quality import Quality
from sysid.signals.preparation import Prepared
from sysid.uncertainty.systematic import LATE
from sysid.uncertainty.total import error_parts, with_total_errors


def unique_refusals(refused: Sequence[Refusal], estimated: Mapping[str, object]) -> tuple[Refusal, ...]:
    """Every refusal once, and none of what another method could estimate after all."""
    return tuple({entry.name: entry for entry in reversed(refused) if entry.name not in estimated}.values())[::-1]


def reported(
    model: Model,
    refused: Sequence[Refusal],
    flown: Quality,
    held: Callable[[str], bool],
    prior: Model | None,
    any_aircraft: bool = False,
) -> tuple[Model, list[Refusal], Quality]:
    """Model, refusals and verdict of the flights as every method's result has them: whole errors, and no numbers of
    axes that the recording makes too poor, or of which one is that of no aircraft.

    flown: what the flights are worth, before what was estimated. held: see `with_total_errors`. prior: what was known
    before flies on. any_aircraft: whether also what no aircraft has is reported, as one of several flights to compare.
    """
    model, refused = _withheld(model, refused, flown, prior)
    model = with_total_errors(model, held)
    if not any_aircraft:
        flown = with_no_aircraft(flown, model)
    return *_withheld(model, refused, flown, prior), flown


def _withheld(
    model: Model, refused: Sequence[Refusal], flown: Quality, prior: Model | None
) -> tuple[Model, list[Refusal]]:
    """Model and refusals without the numbers that no bar makes true."""
    found = {name: flown.refusal(parse_term(name).axis) for name in model.coefficients}
    reasons = {name: why for name, why in found.items() if why}
    before = {} if prior is None else prior.coefficients
    nothing = Coefficient(None)
    entries = {
        name: Coefficient(None, refused=why, mean=before.get(name, nothing).flown,
                          mean_std=before.get(name, nothing).flown_std)
        for name, why in reasons.items()
    }  # fmt: skip
    return (
        replace(
            model,
            coefficients={**model.coefficients, **entries},
            correlation=_without(model.correlation, reasons),
        ),
        [
            *(Refusal(name, why, "") for name, why in reasons.items()),
            *(one for one in refused if one.name not in reasons),
        ],
    )


def _without(known: Correlation | None, names: Container[str]) -> Correlation | None:
    """The correlations of the others; None where there are no others."""
    if known is None:
        return None
    place = [i for i, name in enumerate(known.names) if name not in names]
    rows = tuple(tuple(known.matrix[i][k] for k in place) for i in place)
    return Correlation(tuple(known.names[i] for i in place), rows) if place else None


@dataclass(frozen=True)
class MeanMotion:
    """A model about the flights' mean airspeed and density: linear, or in words why it cannot be had, and its
    dimensional derivatives (sysid.identification.dimensional).
    """

    linear: LinearModel | str
    derivatives: Mapping[str, Mapping[str, float | str]]


def mean_motion(
    vehicle: Vehicle,
    model: Model,
    prepared: Sequence[Prepared],
    compatible: CompatibilityResult,
    read: float | None = None,
) -> MeanMotion:
    """The model about the flights' mean airspeed and density. read: true airspeed over what its sensor reads, as the
    estimate of the model has it; without it the airspeed is that of the kinematics, which run away in rough air.
    """
    stretches = [stretch for flight in prepared for stretch in flight.stretches]
    if read is None:
        airspeed = float(np.mean(np.concatenate([states["V"] for states in compatible.states])))
    else:
        factors = [flight.layout.airspeed_factor for flight in prepared for _ in flight.stretches]
        speeds = [factor * s.data["airspeed"] for factor, s in zip(factors, stretches, strict=True)]
        airspeed = read * float(np.nanmean(np.concatenate(speeds)))
    density = float(np.mean(np.concatenate([stretch.record.rho for stretch in stretches])))
    errors = error_parts(model)
    derivatives = dimensional_derivatives(vehicle, model, airspeed, density, errors)
    try:
        return MeanMotion(linearise(vehicle, model, airspeed, density, errors), derivatives)
    except SimVehicleError as error:
        return MeanMotion(str(error), derivatives)


def with_extra(model: Model, key: str, found: Mapping[str, Mapping[str, float]]) -> Model:
    """The model with something reported beside each estimate under `key`."""

    def beside(name: str, entry: Coefficient) -> Coefficient:
        if entry.flown is None or not found.get(name):
            return entry
        return replace(entry, extra={**entry.extra, key: dict(found[name])})

    effects = tuple(
        replace(e, parameters={key: beside(f"{e.name}.{key}", entry) for key, entry in e.parameters.items()})
        for e in model.effects
    )
    entries = {name: beside(name, entry) for name, entry in model.coefficients.items()}
    return replace(model, coefficients=entries, effects=effects)


def with_sources(model: Model, found: Mapping[str, Mapping[str, float]]) -> Model:
    """The model with `systematic` beside each estimate: what usual or stated errors of the vehicle file change.

    Late commands are none of them, for nothing says that they are late: what they would change stands apart, as `late`.
    """
    known = {name: {k: v for k, v in shifts.items() if k != LATE.name} for name, shifts in found.items()}
    late = {
        name: {LATE.name: shifts[LATE.name]}
        for name, shifts in found.items()
        if math.isfinite(shifts.get(LATE.name, math.nan))
    }
    return with_extra(with_extra(model, "systematic", known), "late", late)


def refuse_unexcited(structure: Sequence[str], names: Sequence[str], dead: Sequence[str] = ()) -> list[Refusal]:
    """Refusals of what no surface excited, or one that was not recorded (`dead`, of de, da, dr)."""
    lost: dict[str, list[str]] = {}
    for surface in dead:
        lost.setdefault(part_of(surface), []).append(surface)
    refused = []
    for name in structure:
        surfaces = " and ".join(lost.get("longitudinal" if is_longitudinal(name) else "lateral", []))
        if name not in names and surfaces:
            reason = f"the channel of {surfaces} is dead, and what it did to the motion would pass for this"
            refused.append(Refusal(name, reason, f"the same with {surfaces} recorded"))
        elif name not in names:
            refused.append(Refusal(name, "the surfaces that would excite it did not move", helpful_manoeuvre(name)))
    return refused


def equation_model(
    start: Model, found: EquationEstimate, refused: Sequence[Refusal], validity: Mapping[str, tuple[float, float]]
) -> Model:
    """The model that equation error estimates."""
    joint = flying(found.joint, refused)
    entries = coefficient_entries(start.coefficients, {} if joint is None else joint.entries(), refused)
    correlation = None if joint is None else joint.correlation()
    return replace(start, coefficients=entries, validity=validity, correlation=correlation)


def validity_of(prepared: Sequence[Prepared], compatible: CompatibilityResult) -> dict[str, tuple[float, float]]:
    """Range of angle of attack and airspeed that the stretches covered (1st to 99th percentile)."""
    alpha = np.concatenate([states["alpha"] for states in compatible.states])
    speed = np.concatenate([states["V"] for states in compatible.states])
    return {
        "alpha": (round(float(np.percentile(alpha, 1)), 4), round(float(np.percentile(alpha, 99)), 4)),
        "airspeed": (round(float(np.percentile(speed, 1)), 2), round(float(np.percentile(speed, 99)), 2)),
    }
