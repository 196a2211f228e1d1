"""The comparison by the posterior: the model fitted again, effects named, the gap with and without them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sim_vehicle.effects import EFFECTS
from sim_vehicle.effects.thrust_scale import THRUST_SCALE
from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.compatibility.reconstruction import CompatibilityResult
from sysid.discrepancy.by_posterior.forward_selection import SelectionState, search
from sysid.discrepancy.by_posterior.group_fits import fit_of
from sysid.discrepancy.by_posterior.ideal_sensors import (
    has_actuator_lag_and_coloured_noise,
    with_airspeed_at_once,
    with_ideal_sensors,
)
from sysid.discrepancy.by_posterior.verdict import verdict_of
from sysid.discrepancy.comparison_types import MAX_EFFECTS, Asked, Compared, Outcome
from sysid.discrepancy.identified_effect import Named
from sysid.errors import EstimationError
from sysid.identification.posterior_method import Flown, effects_with, flown, with_thrust_line
from sysid.identification.repaired_flight import FlightsRead
from sysid.identification.result_model import with_extra
from sysid.numerics.dryden import Turbulence
from sysid.posterior.analysis import estimate
from sysid.posterior.estimates import PosteriorEstimate
from sysid.posterior.flight_part import FlightPart
from sysid.posterior.stated_priors import as_estimated
from sysid.problem.estimation_problem import Motion, Problem, excited_motion
from sysid.problem.formulation import timing_of
from sysid.problem.free_run import Fixed
from sysid.problem.vehicle_errors import is_stated
from sysid.quality.flight_rules import flights_quality
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import Prepared, require_thrust
from sysid.uncertainty.total import with_total_errors
from sysid.validation.servo_replay import with_estimated_deflections

_TRIMS = ("Cl_0", "Cn_0")


def compare(asked: Asked, read: FlightsRead) -> Outcome | None:
    """What the flights say of the model; None where they are of the textbooks.

    read: the flights as their sensors meant them. Raises SysidError subclasses in one line.
    """
    asked = replace(asked, vehicle=_with_the_model_s_thrust_line(asked.vehicle))
    seen = flown(read.fitted, asked.vehicle)
    require_thrust(seen.prepared)
    model = _with_trims(asked.model)
    try:
        base = _fitted(seen.parts, asked, model)
    except EstimationError:
        return None
    if not has_actuator_lag_and_coloured_noise(base):
        return None
    return _outcome(asked, read, seen, model, base, _selected(asked, seen, model, base, False))


@dataclass(frozen=True)
class TextbookSearch:
    """What may be missing in flights of the textbooks, before any verdict. base: the model fitted again."""

    asked: Asked
    read: FlightsRead
    seen: Flown
    base: PosteriorEstimate
    found: SelectionState

    @property
    def named(self) -> Sequence[Named]:
        """The effects."""
        return tuple(self.found.named)

    def outcome(self) -> Outcome:
        """The comparison that they come to. Raises SysidError subclasses in one line."""
        return _outcome(self.asked, self.read, self.seen, self.asked.model, self.base, self.found)


def search_textbooks(asked: Asked, read: FlightsRead) -> TextbookSearch:
    """The search in flights of the textbooks: what servos, vanes and the pitot do is an effect like others.

    Raises SysidError subclasses in one line.
    """
    asked = replace(asked, vehicle=with_ideal_sensors(_with_the_model_s_thrust_line(asked.vehicle)))
    seen = flown(read.fitted, asked.vehicle)
    require_thrust(seen.prepared)
    asked = replace(asked, vehicle=with_airspeed_at_once(asked.vehicle))
    base = _fitted(seen.parts, asked, asked.model)
    return TextbookSearch(asked, read, seen, base, _selected(asked, seen, asked.model, base, True))


def _selected(asked: Asked, seen: Flown, model: Model, base: PosteriorEstimate, textbook: bool) -> SelectionState:
    """Effects named beside the model fitted again."""
    effects = _free_effects(asked.model)
    records = [stretch.record for flight in seen.prepared for stretch in flight.stretches]
    motion = replace(
        excited_motion(records), longitudinal="longitudinal" in base.groups, lateral="lateral" in base.groups
    )
    problem = Problem(asked.vehicle, tuple(records), (), motion, {})
    fits = {group: fit_of(one, model, effects) for group, one in base.groups.items()}
    own = {f"{effect}.{key}": (asked.model.effect(effect) or {})[key] for effect, key in effects}
    found = SelectionState(problem, model, fits, frozenset(asked.ruled_out), {**model.values(), **own}, textbook)
    search(found, MAX_EFFECTS, lambda share, text: asked.progress(0.28 + 0.42 * share, text))
    return found


def _outcome(
    asked: Asked, read: FlightsRead, seen: Flown, model: Model, base: PosteriorEstimate, found: SelectionState
) -> Outcome:
    """The gap with what was named."""
    progress, vehicle = asked.progress, asked.vehicle
    motion = found.problem.motion
    best = base
    if found.named:
        progress(0.72, "standard errors")
        best = base.of({group: fit.ended() for group, fit in found.groups.items()})
    before, after = _updated(model, base), _updated(found.model, best)
    signals = [one.signals for one in read.fitted]
    used = _beside(seen.prepared, signals, asked, motion, (base, before), (best, after), seen.compatible)
    verdict = verdict_of(asked, base, found, used)
    if verdict.name == "unexplained":
        # A wrong name is worse than none: what was likeliest stands in the reasons.
        found.named, after = [], before
        used = replace(used, stages={**used.stages, "after": used.stages["before"]})
    judged = None
    if read.judges:
        kinematics = flown(read.judges, vehicle).compatible
        judged = _beside(
            [one.prepared for one in read.judges], [one.signals for one in read.judges], asked, motion, (base, before),
            (best, after), kinematics,
        )  # fmt: skip
    warnings = [*seen.warnings, *(one.sentence for one in read.mistakes()), *read.warnings(), *base.warnings]
    return Outcome(
        "map", verdict, tuple(found.named), after, found.ruled_out, used, judged,
        seen.compatible.gust_sigma,
        flights_quality(signals, seen.prepared, vehicle, seen.compatible.gust_sigma, True), tuple(warnings),
    )  # fmt: skip


def _free_effects(model: Model) -> list[tuple[str, str]]:
    """Parameters of the model's own effects that are fitted again."""
    return [
        (e.name, key)
        for e in model.effects
        for key in e.parameters
        if EFFECTS[e.name].parameter(key).fitted and not EFFECTS[e.name].alias
    ]


def _fitted(parts: Sequence[FlightPart], asked: Asked, model: Model) -> PosteriorEstimate:
    def report(share: float, text: str) -> None:
        asked.progress(0.08 + 0.2 * share, text)

    report(0.0, "its coefficients fitted again")
    return estimate(parts, asked.vehicle, model, _free_effects(model), progress=report)


def _with_the_model_s_thrust_line(vehicle: Vehicle) -> Vehicle:
    """The vehicle with a thrust line that is as given, or through the centre of gravity: another one is an effect."""
    if vehicle.propulsion is None:
        return vehicle
    return replace(vehicle, propulsion=replace(vehicle.propulsion, line_known=True))


def _with_trims(model: Model) -> Model:
    """The model with moments about roll and yaw at rest: linkages with play stand at one side of it, surfaces are not
    neutral to a tenth of a degree, and nobody calls that an effect.
    """
    missing = {name: Coefficient(0.0) for name in _TRIMS if name not in model.coefficients}
    return replace(model, coefficients={**model.coefficients, **missing}, correlation=None)


def _updated(model: Model, found: PosteriorEstimate) -> Model:
    """The model with its estimates from the flights, their whole errors beside them; what they do not identify stays
    as given.
    """
    entries = found.joint.entries()
    coefficients = {
        name: Coefficient(*entries[name]) if name in entries else e for name, e in model.coefficients.items()
    }
    model = replace(
        model, coefficients=coefficients, effects=effects_with(model.effects, entries),
        correlation=found.joint.correlation(),
    )  # fmt: skip
    return with_total_errors(with_extra(model, "systematic", found.systematic()), is_stated)


def _beside(
    prepared: Sequence[Prepared],
    signals: Sequence[FlightSignals],
    asked: Asked,
    motion: Motion,
    before: tuple[PosteriorEstimate, Model],
    after: tuple[PosteriorEstimate, Model],
    compatible: CompatibilityResult,
) -> Compared:
    """Flights beside the stages, surfaces moved as the servos were found to move them."""
    flights = with_estimated_deflections(prepared, signals, asked.vehicle, after[0])
    first = timing_of(flights, False)

    def fixed(found: PosteriorEstimate, model: Model) -> Fixed:
        errors = {name: value for name, (value, _, _) in found.sensor_errors().items()}
        less = next((one.value for one in found.nuisances if one.name == "thrust_error"), 0.0)
        if less and model.effect(THRUST_SCALE.name) is None:
            # Drag was estimated beside the thrust as it is, not as it was measured.
            model = model.with_effect(THRUST_SCALE, {"scale": -less})
        vehicle = as_estimated(asked.vehicle, found.of_aircraft())
        return Fixed(flatten(vehicle, with_thrust_line(model, found)), errors, first)

    stages = {"given": fixed(before[0], asked.model), "before": fixed(*before)}
    stages["after"] = stages["before"] if after[0] is before[0] else fixed(*after)
    air = Turbulence(compatible.gust_sigma, compatible.gust_sigma)
    return Compared(tuple(flights), motion, stages, compatible, air)
