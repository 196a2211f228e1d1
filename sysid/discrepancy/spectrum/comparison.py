"""The comparison by the posterior: the model fitted again, effects named, the gap with and without them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from sim_vehicle.effects import EFFECTS
from sim_vehicle.effects.thrust_scale import THRUST_SCALE
from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.compatibility.reconstruction import CompatibilityResult
from sysid.discrepancy.comparison import Asked, Compared
from sysid.discrepancy.spectrum.group_fits import fit_of
from sysid.discrepancy.spectrum.ideal_sensors import (
    beyond_usual,
    has_actuator_lag_and_coloured_noise,
    with_airspeed_at_once,
    with_ideal_sensors,
    without_nuisances,
)
from sysid.discrepancy.spectrum.spectrum_fit import SpectrumFit
from sysid.errors import EstimationError
from sysid.identification.posterior_method import Flown, effects_with, flown, with_thrust_line
from sysid.identification.repaired_flight import FlightsRead, RepairedFlight
from sysid.identification.result_model import with_extra
from sysid.numerics.dryden import Turbulence
from sysid.posterior.analysis import estimate
from sysid.posterior.estimates import PosteriorEstimate
from sysid.posterior.flight_part import FlightPart
from sysid.posterior.stated_priors import as_estimated
from sysid.problem.estimation_problem import Problem, excited_motion
from sysid.problem.formulation import timing_of
from sysid.problem.free_run import Fixed
from sysid.problem.vehicle_errors import is_stated
from sysid.quality.flight_quality import Quality
from sysid.quality.flight_rules import flights_quality
from sysid.signals.preparation import Prepared, require_thrust
from sysid.uncertainty.total import with_total_errors
from sysid.validation.servo_replay import with_estimated_deflections

_TRIMS = ("Cl_0", "Cn_0")


# What is estimated beside the coefficients: reported where it is so many standard errors off, and
# where the flight determines it so much better than was known before.
_SEEN, _INFORMED = 3.0, 0.5
# Name -> what is reported where it is above its null and below it, "" for nothing, the null, the factor to
# its unit.
_BESIDE = {
    "servo_delay": ("the servos are delayed by {:.0f} ms", "", 0.0, 1e3),
    "servo_lag": ("the servos lag by {:.0f} ms", "", 0.0, 1e3),
    "servo_backlash": ("the linkages have {:.2f} deg of play to either side", "", 0.0, 180.0 / np.pi),
    "airspeed_error": ("the airspeed reads {:.1f} % too much", "the airspeed reads {:.1f} % too little", 0.0, 100.0),
    "alpha_scale": ("the alpha vane turns {:.0f} % too far", "the alpha vane turns {:.0f} % too little", 1.0, 100.0),
    "beta_scale": ("the beta vane turns {:.0f} % too far", "the beta vane turns {:.0f} % too little", 1.0, 100.0),
    "vane_clock": ("the vanes are stamped {:.0f} ms late", "the vanes are stamped {:.0f} ms early", 0.0, 1e3),
    "thrust_error": ("the thrust reads {:.0f} % too much", "the thrust reads {:.0f} % too little", 0.0, 100.0),
}


@dataclass
class SpectrumComparison:
    """Flights and a model, by the posterior. estimated: the model fitted again."""

    asked: Asked
    read: FlightsRead
    seen: Flown
    estimated: PosteriorEstimate
    base: SpectrumFit
    quality: Quality
    warnings: Sequence[str]
    method: str = "map"
    ended: dict[int, tuple[SpectrumFit, PosteriorEstimate]] = field(default_factory=dict)

    @property
    def outputs(self) -> set[str]:
        """Airspeed and attitude were imposed, and what they are off by was not asked for."""
        return {name for fit in self.base.groups.values() for name in fit.posterior.model.outputs}

    def lost(self, fit: SpectrumFit) -> str:
        """Empty: a simulation has no noise that could stand for the motion."""
        return ""

    def used(self, fit: SpectrumFit) -> Compared:
        """The flights that were fitted, with a fit for the last stage."""
        return self._beside(self.seen.prepared, self.read.fitted, self.seen.compatible, fit)

    def judged(self, fit: SpectrumFit) -> Compared | None:
        """The flights held out."""
        if not self.read.judges:
            return None
        prepared = [one.prepared for one in self.read.judges]
        return self._beside(prepared, self.read.judges, flown(self.read.judges, self.asked.vehicle).compatible, fit)

    def whole_model(self, fit: SpectrumFit) -> tuple[Model, Sequence[str]]:
        """A fit's model with its estimates from the flights, their whole errors beside them; what they do not identify
        stays as given.
        """
        return self._updated(fit), ()

    def turbulence(self, fit: SpectrumFit) -> float:
        """Of schema discrepancy/1, m/s: as kinematics give it, whatever the fit."""
        return self.seen.compatible.gust_sigma

    def remarks(self, fit: SpectrumFit) -> list[str]:
        """What servos and sensors do that the model does not hold, in words, the surer group of each."""
        surest = {one.name: one for one in sorted(self.estimated.nuisances, key=lambda one: -one.std)}
        sentences = []
        for name, (more, less, null, factor) in _BESIDE.items():
            one = surest.get(name)
            if one is None or abs(one.value - null) < _SEEN * one.std or one.std > _INFORMED * one.prior_std:
                continue
            if words := more if one.value > null else less:
                sentences.append(
                    f"{words.format(factor * abs(one.value - null))} (± {factor * one.std:.2g}), beside the model"
                )
        return sentences

    def moved(self) -> tuple[Array, Array]:
        """(P,) how far coefficients are from those given, and (P, P) their covariance."""
        given, joint = self.asked.model.values(), self.estimated.joint
        names = [name for name in joint.names if name in given and name not in self.estimated.not_believed]
        places = [joint.names.index(name) for name in names]
        away = joint.mean[places] - np.array([given[name] for name in names])
        return away, joint.covariance[np.ix_(places, places)]

    def _estimate(self, fit: SpectrumFit) -> PosteriorEstimate:
        """A fit with its bars."""
        if fit is self.base:
            return self.estimated
        if id(fit) not in self.ended:
            self.asked.progress(0.72, "standard errors")
            groups = {group: one.ended() for group, one in fit.groups.items()}
            self.ended[id(fit)] = fit, self.estimated.of(groups)
        return self.ended[id(fit)][1]

    def _updated(self, fit: SpectrumFit) -> Model:
        found, model = self._estimate(fit), fit.model
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
        self,
        prepared: Sequence[Prepared],
        read: Sequence[RepairedFlight],
        compatible: CompatibilityResult,
        fit: SpectrumFit,
    ) -> Compared:
        """Flights beside the stages, surfaces moved as the servos were found to move them."""
        vehicle, signals = self.asked.vehicle, [one.signals for one in read]
        flights = with_estimated_deflections(prepared, signals, vehicle, self._estimate(fit))
        first = timing_of(flights, False)

        def fixed(found: PosteriorEstimate, model: Model) -> Fixed:
            errors = {name: value for name, (value, _, _) in found.sensor_errors().items()}
            less = next((one.value for one in found.nuisances if one.name == "thrust_error"), 0.0)
            if less and model.effect(THRUST_SCALE.name) is None:
                # Drag was estimated beside the thrust as it is, not as it was measured.
                model = model.with_effect(THRUST_SCALE, {"scale": -less})
            return Fixed(
                flatten(as_estimated(vehicle, found.of_aircraft()), with_thrust_line(model, found, vehicle)),
                errors,
                first,
            )

        before = fixed(self.estimated, self._updated(self.base))
        stages = {"given": fixed(self.estimated, self.asked.model), "before": before}
        stages["after"] = before if fit is self.base else fixed(self._estimate(fit), self._updated(fit))
        air = Turbulence(compatible.gust_sigma, compatible.gust_sigma)
        return Compared(tuple(flights), self.base.problem.motion, stages, compatible, air)


def begin(asked: Asked, read: FlightsRead) -> SpectrumComparison | None:
    """The flights under an estimated noise spectrum, the model fitted again; None where they are of the textbooks.

    read: the flights as their sensors meant them. Raises SysidError subclasses in one line.
    """
    asked = replace(asked, vehicle=_with_the_model_s_thrust_line(asked.vehicle))
    seen = flown(read.fitted, asked.vehicle)
    require_thrust(seen.prepared)
    model = _with_trims(asked.model)
    try:
        estimated = _fitted(seen.parts, asked, model)
    except EstimationError:
        return None
    if not has_actuator_lag_and_coloured_noise(estimated):
        return None
    without = without_nuisances(asked.vehicle, beyond_usual(estimated))
    if without != asked.vehicle:
        with suppress(EstimationError):
            other = flown(read.fitted, without)
            estimated = _fitted(other.parts, replace(asked, vehicle=without), model)
            asked, seen = replace(asked, vehicle=without), other
    return _begun(asked, read, seen, model, estimated, False)


def begin_textbook(asked: Asked, read: FlightsRead) -> SpectrumComparison:
    """Flights taken as of the textbooks: what servos, vanes and the pitot do is an effect like others.

    Raises SysidError subclasses in one line.
    """
    asked = replace(asked, vehicle=with_ideal_sensors(_with_the_model_s_thrust_line(asked.vehicle)))
    seen = flown(read.fitted, asked.vehicle)
    require_thrust(seen.prepared)
    asked = replace(asked, vehicle=with_airspeed_at_once(asked.vehicle))
    return _begun(asked, read, seen, asked.model, _fitted(seen.parts, asked, asked.model), True)


def _begun(
    asked: Asked, read: FlightsRead, seen: Flown, model: Model, estimated: PosteriorEstimate, textbook: bool
) -> SpectrumComparison:
    """The model fitted again, and where a search begins. textbook: look at what coefficients all but imitate too."""
    effects = _free_effects(asked.model)
    records = [stretch.record for flight in seen.prepared for stretch in flight.stretches]
    motion = replace(
        excited_motion(records), longitudinal="longitudinal" in estimated.groups, lateral="lateral" in estimated.groups
    )
    problem = Problem(asked.vehicle, tuple(records), (), motion, {})
    # Where commands answer the noise an estimate ends by other rules than fits of candidates do.
    ends = {group: fit_of(one, model, effects) for group, one in estimated.groups.items()}
    fits = {group: (fit.searched() or fit) if fit.posterior.whole else fit for group, fit in ends.items()}
    own = {f"{effect}.{key}": (asked.model.effect(effect) or {})[key] for effect, key in effects}
    signals, gusts = [one.signals for one in read.fitted], seen.compatible.gust_sigma
    warnings = [*seen.warnings, *(one.sentence for one in read.mistakes()), *read.warnings(), *estimated.warnings]
    return SpectrumComparison(
        asked, read, seen, estimated, SpectrumFit(problem, model, fits, {**model.values(), **own}, textbook),
        flights_quality(signals, seen.prepared, asked.vehicle, gusts, True), warnings,
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
    return replace(vehicle, propulsion=replace(vehicle.propulsion, line_known=True, line_std=0.0))


def _with_trims(model: Model) -> Model:
    """The model with moments about roll and yaw at rest: linkages with play stand at one side of it, surfaces are not
    neutral to a tenth of a degree, and nobody calls that an effect.
    """
    missing = {name: Coefficient(0.0) for name in _TRIMS if name not in model.coefficients}
    return replace(model, coefficients={**model.coefficients, **missing}, correlation=None)
