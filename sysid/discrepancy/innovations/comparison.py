"""The comparison by filter error: flights of the textbooks, calm or in gusts of a known shape.

The model's own parameters are fitted again first. Then every effect of the catalogue that the flights could show is
looked at (score test), the promising ones are added in turn and everything is fitted once more (generalised likelihood
ratio); a regression on what is left over would see only the few per cent that the nominal parameters have not already
absorbed. In calm air too: a model that lacks something still follows the flight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sim_vehicle.effects import EFFECTS
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.compatibility.reconstruction import CompatibilityResult, check_compatibility
from sysid.discrepancy.comparison import Asked, Compared
from sysid.discrepancy.gap import fixed_model
from sysid.discrepancy.identified_effect import Named
from sysid.discrepancy.innovations.candidate_fits import FittedModel, fitted
from sysid.discrepancy.innovations.innovations_fit import InnovationsFit
from sysid.discrepancy.innovations.lack_of_fit import COLOURED, beyond_sensors
from sysid.discrepancy.innovations.posed_flights import (
    BENCH,
    is_beyond_bench,
    posed,
    sensors_alone,
    timed,
    without_bench,
)
from sysid.errors import EstimationError, SysidError
from sysid.filter_error.estimator import FilterErrorResult
from sysid.identification.moving_surfaces import with_surfaces_as_they_moved
from sysid.identification.output_or_filter_error import MaximumLikelihood, with_error_sources
from sysid.identification.repaired_flight import FlightsRead
from sysid.numerics.dryden import Turbulence
from sysid.output_error.from_problem import fit as output_error_fit
from sysid.problem.estimation_problem import Estimates, Problem, free_coefficients, model_of
from sysid.problem.formulation import start_model
from sysid.quality.flight_quality import Quality
from sysid.quality.flight_rules import flights_quality
from sysid.signals.preparation import Prepared, require_thrust
from sysid.uncertainty.bench_errors import bench_errors, carry_filtered, is_of_surfaces
from sysid.uncertainty.total import with_total_errors

# Noise of an output over what its highest frequencies show, from which on a filter has lost the flight: with a right
# name it has been up to 1.3 times, with wrong ones 90 and 370.
_LOST = 10.0
# What standard errors are multiplied with in turbulence before coefficients are called wrong: gains are held fixed.
_FIXED_GAINS = 2.0


@dataclass(frozen=True)
class InnovationsComparison:
    """Flights and a model, by filter error. given: fit of the sensor errors alone, the model as it was handed in."""

    asked: Asked
    vehicle: Vehicle
    prepared: Sequence[Prepared]
    held_out: Sequence[Prepared]
    compatible: CompatibilityResult
    base: InnovationsFit
    given: FilterErrorResult
    quality: Quality
    warnings: Sequence[str]
    method: str = "fe"
    outputs: None = None

    def lost(self, fit: InnovationsFit) -> str:
        """In words, that the filter does not follow the flights with a fit: noise stands for the motion, and what gains
        explains that noise. Empty where it does.
        """
        read = beyond_sensors(fit.problem, fit.at)
        beyond = {name: ratio for name, (ratio, colour) in read.items() if ratio > _LOST and colour > COLOURED}
        if not beyond:
            return ""
        worst = max(beyond, key=lambda name: beyond[name])
        return f"the filter does not follow the flight: noise of {worst} is {beyond[worst]:.0f} times the sensor's"

    def used(self, fit: InnovationsFit) -> Compared:
        """The flights that were fitted, with a fit for the last stage."""
        base, compatible = self.base, self.compatible
        before = fixed_model(base.problem, base.model, base.result, compatible)
        stages = {"given": fixed_model(base.problem, self.asked.model, self.given, compatible), "before": before}
        stages["after"] = before if fit is base else fixed_model(fit.problem, fit.model, fit.result, compatible)
        return Compared(tuple(self.prepared), base.problem.motion, stages, compatible, fit.result.turbulence)

    def judged(self, fit: InnovationsFit) -> Compared | None:
        """The flights held out: sensor errors alone are fitted for each stage, they change with every power-up."""
        if not self.held_out:
            return None
        self.asked.progress(0.75, "sensor errors of the other flights")
        models = {"given": self.asked.model, "before": self.base.model, "after": fit.model}
        checked = check_compatibility(self.held_out)
        other = replace(posed(self.held_out, fit.problem.vehicle, checked), command_first=fit.problem.command_first)
        other = other if set(BENCH) & set(fit.problem.sensors) else without_bench(other)
        best = _own_errors(other, models["after"], checked)
        stages = {}
        for name, model in models.items():
            own = best
            if name != "after" and isinstance(best, FilterErrorResult):
                own = sensors_alone(other, model, best)
            stages[name] = fixed_model(other, model, own, checked)
        # Kinematics alone mistake what an effect does to a vane for gusts; the model that has it knows better.
        air = Turbulence(checked.gust_sigma, checked.gust_sigma)
        if isinstance(best, FilterErrorResult):
            air = best.turbulence
        return Compared(tuple(self.held_out), other.motion, stages, checked, air)

    def whole_model(self, fit: InnovationsFit) -> tuple[Model, Sequence[str]]:
        """A fit's model with its whole errors, of the flights and of what was taken as known."""
        free = (fit.at.coefficients, fit.at.effects)
        try:
            bench = bench_errors(self.prepared, self.vehicle)
            result, shares = carry_filtered(bench, fit.problem, fit.model, *free, fit.result)
            likeliest = MaximumLikelihood(fit.problem, result, "fe", (), (), shares)
            model = model_of(fit.model, fit.model.name, result, *free, (), fit.model.validity)
            return with_total_errors(with_error_sources(likeliest, model, fit.model, *free), is_of_surfaces), ()
        except SysidError as error:
            return fit.model, [f"errors of what was taken as known could not be estimated: {error}"]

    def turbulence(self, fit: InnovationsFit) -> float:
        """Of schema discrepancy/1, m/s."""
        return max(fit.result.turbulence.horizontal, fit.result.turbulence.vertical)

    def remarks(self, fit: InnovationsFit) -> list[str]:
        """What gusts were found, in words."""
        air = fit.result.turbulence
        return [
            f"turbulence of {air.horizontal:.2f} m/s, {air.vertical:.2f} up and down, is counted as process noise"
        ] * fit.is_rough

    def moved(self) -> tuple[Array, Array]:
        """(P,) how far the model's own parameters are from those given, and (P, P) their covariance."""
        base, values = self.base.result, self.base.at.given
        every = [parameter.name for parameter in base.parameters]
        names = [*self.base.at.coefficients, *(f"{effect}.{name}" for effect, name in self.base.at.effects)]
        places = [every.index(name) for name in names]
        wider = _FIXED_GAINS**2 if self.base.is_rough else 1.0
        covariance = np.asarray(wider * base.covariance[np.ix_(places, places)])
        return base.theta[places] - np.array([values[name] for name in names]), covariance


def begin(asked: Asked, read: FlightsRead, proposed: Sequence[Named] = ()) -> InnovationsComparison:
    """The flights under filter error, the model fitted again.

    read: the flights as their sensors meant them. proposed: effects that were found elsewhere, which the search tries
    beside what it finds promising itself. Raises SysidError subclasses in one line.
    """
    vehicle = asked.vehicle
    read.require_airspeed()
    read, prepared = read.as_measured(vehicle, asked.start_s, asked.stop_s)
    asked.progress(0.08, "data compatibility")
    compatible, span = check_compatibility(prepared), (asked.start_s, asked.stop_s)
    worth = flights_quality([one.signals for one in read.fitted], prepared, vehicle, compatible.gust_sigma, False)
    for one in worth.not_flown:
        if one.no_numbers:
            raise EstimationError(f"{one.sentence}; use --method map, which leaves these axes out")
    moving = with_surfaces_as_they_moved(read, vehicle, span, prepared, compatible)
    if moving is not None:
        prepared, compatible, vehicle = moving.prepared, moving.compatible, moving.vehicle
    held_out = [one.as_measured(vehicle, anew=moving is not None) for one in read.judges]
    require_thrust([*prepared, *held_out])
    base, given = _fitted_again(asked, vehicle, prepared, compatible, proposed)
    warnings = [*(w for one in prepared for w in one.warnings), *(one.sentence for one in read.mistakes())]
    return InnovationsComparison(
        asked, vehicle, prepared, held_out, compatible, base, given, worth, [*warnings, *read.warnings()]
    )


def _fitted_again(
    asked: Asked, vehicle: Vehicle, prepared: Sequence[Prepared], compatible: CompatibilityResult,
    proposed: Sequence[Named],
) -> tuple[InnovationsFit, FilterErrorResult]:  # fmt: skip
    """The model with its own parameters fitted again, and the fit of the sensor errors with it as it was given."""
    model, benched = asked.model, posed(prepared, vehicle, compatible)
    problem = benched
    names = free_coefficients(list(model.coefficients), problem.motion)
    if not names:
        raise EstimationError("the baseline model has no coefficient in the axes that these flights excite")
    effects = [(e.name, key) for e in model.effects for key in e.parameters if _is_fitted(e.name, key)]
    asked.progress(0.15, "its coefficients fitted again")
    start = start_model(prepared, vehicle, compatible, model, problem.motion, model)
    before = _followed(problem, model, start, names, effects, compatible.gust_sigma)
    asked.progress(0.24, "timing of the commands")
    problem, before = timed(problem, model, names, effects, before)
    if is_beyond_bench(before, problem):
        problem = without_bench(problem)
        values = {name: value for name, value in before.values().items() if name not in BENCH}
        before = fitted(problem, model, names, effects, values, compatible.gust_sigma)
    asked.progress(0.28, "the model as given")
    refitted = model_of(model, model.name, before, names, effects, (), model.validity)
    own: Mapping[str, float] = {f"{effect}.{name}": (model.effect(effect) or {})[name] for effect, name in effects}
    at = FittedModel(refitted, names, effects, before, {**model.values(), **own})
    return InnovationsFit(problem, at, benched, proposed), sensors_alone(problem, model, before)


def _followed(
    problem: Problem, model: Model, start: Model, names: Sequence[str], effects: Sequence[tuple[str, str]],
    gusts: float,
) -> FilterErrorResult:  # fmt: skip
    """The model's parameters fitted from where they are, or from equation error's, `start`.

    From where they are the fit may lose the flight, or end where it takes the whole motion for noise, which makes it
    less likely than equation error's values as they are.
    """
    anew = partial(fitted, problem, start, names, effects, {}, gusts)
    try:
        found = fitted(problem, model, names, effects, {}, gusts)
    except EstimationError:
        return anew()
    with suppress(EstimationError):
        if anew(max_iterations=0).cost < found.cost:
            return min(found, anew(), key=lambda one: one.cost)
    return found


def _is_fitted(effect: str, parameter: str) -> bool:
    return any(p.name == parameter and p.fitted and not EFFECTS[effect].alias for p in EFFECTS[effect].parameters)


def _own_errors(problem: Problem, model: Model, checked: CompatibilityResult) -> Estimates:
    """Sensor errors of a flight under a model: by filter error, or in free runs of output error where that is lost."""
    try:
        return fitted(problem, model, (), (), {}, checked.gust_sigma)
    except EstimationError:
        return output_error_fit(problem, model, ())
