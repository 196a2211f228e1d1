"""What the posterior gives for flights: coefficients with their covariance, and what stands beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.vehicle.controls import DEFLECTION_SIGNALS
from sysid.numerics.gaussian import Gaussian
from sysid.posterior.closed_loop import LEAST_SHARE, SHORTEST_LOOP_S, damped_by_law
from sysid.posterior.considered_errors import ConsiderParameter
from sysid.posterior.estimator import Posterior, PosteriorResult
from sysid.posterior.group_model import OF_SURFACES
from sysid.posterior.inputs import LOOP_INTERVAL_S, InputSignal
from sysid.posterior.nuisance_priors import FLOW_OF, MOVING_MASS, PRODUCT_INERTIA, SURFACES_OF
from sysid.posterior.reported_spectrum import NoiseSpectrum
from sysid.problem.vehicle_errors import is_stated
from sysid.signals.sensor_errors import SENSOR_ERRORS

SURFACE_WORDS = {signal: name for name, signal in DEFLECTION_SIGNALS.items()}
# The rate that a surface commands.
_COMMANDED = {"de": "q", "da": "p", "dr": "r"}
_UNIT_OF = {output: unit for output, form, unit, _ in SENSOR_ERRORS.values() if form == "bias"}
# What stands for an output's scale factor, and its null.
_GAINS = {"alpha": ("alpha_scale", 1.0), "beta": ("beta_scale", 1.0), "airspeed": ("airspeed_error", 0.0)}
# Above this share of its prior a flight holds no information on a number.
UNINFORMED_RATIO = 0.7

# A nuisance beyond so many of its prior standard deviations is none.
_BELIEVED = 4.0
# Of what is estimated from the flight itself, for its prior is narrower than what a pitot's hoses may do, s.
_REALISTIC = {"airspeed_lag": 0.03}
# Beginnings of the names of what such a one spoils, where it is not the whole group.
_SPOILED = {"thrust_error": ("CD",), MOVING_MASS: ("CD",)}
# What a law moves can be distinguished from damping by its delay alone: at the 1 Hz of a Dutch roll 20 deg of phase, s.
_DISTINGUISHED_S = 0.05
# Of the commands so much could answer what is left, where gusts are in it: in calm air it is 0.02 to 0.35, by what a
# slow log leaves, and gusts of 0.1 m/s about a sub-metre aircraft make it 1.
_GUSTS = 0.5


@dataclass(frozen=True)
class NuisanceEstimate:
    """An unknown beside the coefficients, as estimated."""

    name: str
    group: str
    value: float
    std: float
    prior_std: float
    unit: str
    flight: str

    def to_json(self) -> dict[str, float | str]:
        """The entry of a result file; `flight` stands in it where each flight has its own."""
        return {
            "name": self.name, "group": self.group, "value": self.value, "std": self.std,
            "prior_std": self.prior_std, "unit": self.unit, **({"flight": self.flight} if self.flight else {}),
        }  # fmt: skip


@dataclass(frozen=True)
class GroupEstimate:
    """One group of axes, estimated."""

    posterior: Posterior
    result: PosteriorResult
    doubts: Sequence[ConsiderParameter]

    def nuisances(self, flight: str) -> dict[str, float]:
        """All nuisances of a flight by name, those that are held included."""
        model, theta = self.posterior.model, self.result.theta
        return model.unknowns.values(theta[len(model.parameters) :], flight)


@dataclass(frozen=True)
class PosteriorEstimate:
    """What is estimated from the flights. joint: coefficients and effect parameters, misfit included in the covariance.

    prior_std: of those. groups: of axes that were estimated. nuisances: of both groups. noise: what is left of every
    output. unexcited: coefficients whose surface did not move. left_out: group -> why it could not be estimated.
    not_believed: coefficient -> why its estimate is not. warnings: one line each.
    """

    joint: Gaussian
    prior_std: Mapping[str, float]
    groups: Mapping[str, GroupEstimate]
    nuisances: tuple[NuisanceEstimate, ...]
    noise: tuple[NoiseSpectrum, ...]
    unexcited: tuple[str, ...]
    left_out: Mapping[str, str]
    not_believed: Mapping[str, str]
    warnings: tuple[str, ...]

    def of(self, groups: Mapping[str, GroupEstimate]) -> PosteriorEstimate:
        """The same flights with other estimates of their groups of axes."""
        joint, prior_std = joint_of(groups)
        return replace(
            self, joint=joint, prior_std=prior_std, groups=groups, nuisances=nuisances_of(groups),
            not_believed=not_believed_of(groups),
        )  # fmt: skip

    @property
    def results(self) -> dict[str, PosteriorResult]:
        """By group of axes."""
        return {group: one.result for group, one in self.groups.items()}

    def servos(self, group: str, flight: str) -> tuple[float, ...] | None:
        """Delay [s], lag [s] and backlash [rad] of a group's servos and the share of their commands' rounding that was
        flown, those of a flight that was not among the estimated the mean of all; None where the group was not
        estimated.
        """
        if group not in self.groups:
            return None
        model, theta = self.groups[group].posterior.model, self.groups[group].result.theta
        flown = list(dict.fromkeys(part.flight for part in model.parts))
        every = [
            model.unknowns.values(theta[len(model.parameters) :], one)
            for one in ([flight] if flight in flown else flown)
        ]
        return tuple(float(np.mean([one[key] for one in every])) for key in OF_SURFACES)

    def lateness(self) -> dict[str, tuple[float, float]]:
        """By how much the surfaces of a group follow their commands late, s, and its standard error: delay and lag of
        the servo together, which a short flight does not distinguish. Of several flights that of the first.
        """
        found = {}
        for group, one in self.groups.items():
            flight = one.posterior.model.parts[0].flight
            unknowns = enumerate(one.posterior.model.unknowns, len(one.posterior.model.parameters))
            own = [i for i, each in unknowns if each.name in ("servo_delay", "servo_lag") and each.acts_on(flight)]
            values = one.nuisances(flight)
            std = float(np.sqrt(max(one.result.covariance[np.ix_(own, own)].sum(), 0.0)))
            found[group] = (values["servo_delay"] + values["servo_lag"], std)
        return found

    def as_sent(self, inputs: Mapping[str, InputSignal]) -> dict[str, InputSignal]:
        """Commands of a flight as the estimate took those of its own: staying from stamp to stamp, or a curve."""
        found = dict(inputs)
        for group, one in reversed(list(self.groups.items())):
            taken = one.posterior.model.parts[0]
            for name in (*SURFACES_OF[group], *taken.named):
                if name in found and name in taken.inputs:
                    found[name] = replace(found[name], kind=taken.inputs[name].kind)
        return found

    def sensor_errors(self, share: float = np.inf) -> dict[str, tuple[float, float, str]]:
        """Value, standard error and unit of the zeros and gains of sensors that the estimate stands on; of those that
        it estimated better than `share` of what was known before.
        """
        informed = self._informed(share)
        found = {}
        for error, (output, form, unit, _) in SENSOR_ERRORS.items():
            name, null = (f"{output}_zero", 0.0) if form == "bias" else _GAINS.get(output, ("", 0.0))
            if name in informed:
                found[error] = (informed[name].value - null, informed[name].std, unit)
        return found

    def attitude_errors(self, share: float) -> dict[str, tuple[float, float, str]]:
        """The same of the attitude's offsets, which the motion of each group has and no comparison takes off."""
        informed = self._informed(share)
        names = {"phi_bias": "phi_offset", "theta_bias": "theta_offset"}
        return {
            error: (informed[name].value, informed[name].std, "rad")
            for error, name in names.items()
            if name in informed
        }

    def _informed(self, share: float) -> dict[str, NuisanceEstimate]:
        """Of two groups that estimate the same one, the surer counts."""
        every = sorted(self.nuisances, key=lambda one: -one.std)
        return {one.name: one for one in every if one.std < share * one.prior_std}

    def airspeed_scale(self) -> tuple[float, float] | None:
        """Scale error of the airspeed's reading and its standard error, of the group that knows it best; None where it
        is not estimated.
        """
        every = [(one.value, one.std) for one in self.nuisances if one.name == _GAINS["airspeed"][0]]
        return min(every, key=lambda one: one[1], default=None)

    def of_aircraft(self) -> dict[str, float]:
        """What was estimated of the aircraft itself, by name (`sysid.posterior.stated_priors.as_estimated`)."""
        return {one.name: one.value for one in self.nuisances if one.name == PRODUCT_INERTIA}

    def systematic(self) -> dict[str, dict[str, float]]:
        """Change of each coefficient and effect parameter under each error of what was taken as known."""
        return {
            name: {doubt: float(shift[i]) for doubt, shift in one.result.systematic.items()}
            for one in self.groups.values()
            for i, name in enumerate(one.result.names[: len(one.posterior.model.parameters)])
        }


def joint_of(found: Mapping[str, GroupEstimate]) -> tuple[Gaussian, dict[str, float]]:
    """Coefficients of all groups, and their prior standard deviations. What the structure never holds is in it."""
    names: list[str] = []
    values, blocks = [], []
    prior: dict[str, float] = {}
    for model, result in ((one.posterior.model, one.result) for one in found.values()):
        count = len(model.parameters)
        theta = result.theta[:count]
        names += list(result.names[:count])
        values.append(theta)
        blocks.append(result.covariance[:count, :count])
        prior |= dict(zip(result.names[:count], result.prior_std[:count].tolist(), strict=True))
    # What the groups of axes share is what was taken as known: their bars hold what the vehicle file states of it.
    covariance = np.zeros((len(names), len(names)))
    results = [one.result for one in found.values()]
    for doubt in dict.fromkeys(doubt for one in results for doubt in one.systematic if is_stated(doubt)):
        shift = [
            one.systematic.get(doubt, np.zeros(len(one.names)))[: block.shape[0]]
            for one, block in zip(results, blocks, strict=True)
        ]
        covariance += np.outer(np.concatenate(shift), np.concatenate(shift))
    begin = 0
    for block in blocks:
        here = slice(begin, begin + block.shape[0])
        covariance[here, here] = block
        begin += block.shape[0]
    return Gaussian(tuple(names), np.concatenate(values), covariance), prior


def not_believed_of(found: Mapping[str, GroupEstimate]) -> dict[str, str]:
    """Coefficients of groups whose fit asks for what no sensor or servo does: it stands for something else then."""
    reasons: dict[str, str] = {}
    for one in found.values():
        model, theta = one.posterior.model, one.result.theta
        count = len(model.parameters)
        for nuisance, value in zip(model.unknowns, theta[count:], strict=True):
            sizes = abs(float(value) - nuisance.mean) / max(nuisance.std, _REALISTIC.get(nuisance.name, 0.0))
            if sizes > _BELIEVED:
                reason = (
                    f"the fit asks for {nuisance.name} = {value:.2g} {nuisance.unit}, {sizes:.0f} times its"
                    " realistic size: something that is not in the model stands behind it"
                )
                # Who flies by what is wrong answers with every surface: in a loop nothing stays on its own axis.
                spoiled = ("",) if one.result.feedback > 0.0 else _SPOILED.get(nuisance.name, ("",))
                reasons |= {name: reason for name in one.result.names[:count] if name.startswith(spoiled)}
        reasons |= _answered_unseen(one)
        servo = {n.name: float(value) for n, value in zip(model.unknowns, theta[count:], strict=True)}
        if _in_gusts(one) and servo.get("servo_delay", 0.0) + servo.get("servo_lag", 0.0) < _DISTINGUISHED_S:
            for surface in one.result.laws:
                hidden = {surface, _COMMANDED[surface]}
                reasons |= {
                    name: f"the {SURFACE_WORDS[surface]} did nothing but follow a law of the motion, at once"
                    for name in one.result.names[:count]
                    if "." not in name and hidden & set(parse_term(name).factors)
                }
    return reasons


def _in_gusts(one: GroupEstimate) -> bool:
    """Whether much of what is left is the air's, and not only what the structure or a slow log leaves of the motion."""
    return max(one.posterior.most_answered(one.result.residuals, range(len(one.posterior.model.parts)))) > _GUSTS


def _answered_unseen(one: GroupEstimate) -> dict[str, str]:
    """What is not believed where something answers gusts, and why: all of the lateral axes where no vane shows the
    gusts; of a log that is slower than the loop all of them as well, and of the longitudinal axes the damping.

    Lift shows gusts to the accelerometers as a vane does, and what a loop does between two samples acts as damping.
    """
    model, result, parts = one.posterior.model, one.result, one.posterior.model.parts
    lateral = model.group == "lateral"
    by_law = one.posterior.most_answered(result.residuals, damped_by_law(parts) if lateral else ())
    if not _in_gusts(one) or (result.feedback == 0.0 and max(by_law, default=0.0) < LEAST_SHARE):
        return {}
    do = "let go of the controls but for test inputs, or fly in calm air"
    names = [name for name in result.names[: len(model.parameters)] if "." not in name]
    if lateral and FLOW_OF[model.group] not in model.outputs and not model.flow_imposed:
        why = f"an autopilot or pilot answers gusts, and without a vane of the sideslip nothing shows these: {do}"
        return dict.fromkeys(names, why)
    interval_s = max(part.command_interval_s for part in parts)
    if interval_s > LOOP_INTERVAL_S:
        why = f"an autopilot answers gusts faster than {1.0 / interval_s:.0f} Hz show: log at 50 Hz, or {do}"
        return {name: why for name in names if lateral or "q" in parse_term(name).factors}
    return {}


def nuisances_of(found: Mapping[str, GroupEstimate]) -> tuple[NuisanceEstimate, ...]:
    estimates = []
    for group, (model, result) in ((group, (one.posterior.model, one.result)) for group, one in found.items()):
        for i, one in enumerate(model.unknowns, len(model.parameters)):
            value, std = float(result.theta[i]), float(np.sqrt(result.covariance[i, i]))
            name = one.name
            if name == "servo_delay" and value < 0.0:
                # Nothing follows before its cause: it is the stamp that is late.
                name, value = "command_clock", -value
            estimates.append(NuisanceEstimate(name, group, value, std, one.std, one.unit, one.flight))
        for output, (value, std) in result.zeros.items():
            prior, unit = found[group].posterior.zeros[output], _UNIT_OF[output]
            estimates.append(NuisanceEstimate(f"{output}_zero", group, value, std, prior, unit, ""))
    return tuple(estimates)


def warnings_of(groups: Mapping[str, GroupEstimate], left_out: Mapping[str, str]) -> list[str]:
    """What makes the estimates doubtful, one line each."""
    warnings = [f"{group} axes are not estimated: {why}" for group, why in left_out.items()]
    for group, result in ((group, one.result) for group, one in groups.items()):
        warnings += [
            f"{SURFACE_WORDS[name]}: moved by nothing but a law of the motion (a damper, a hold without set points):"
            " what it does is distinguished from damping by its delay alone; fly test inputs on it"
            for name in result.laws
        ]
        if result.unclear:
            warnings.append(
                f"{group} axes: too short to see whether an autopilot or pilot answers gusts; bars are wider by what"
                f" one would do: fly {SHORTEST_LOOP_S:.0f} s or more without a break"
            )
        if result.feedback > 0.0:
            warnings.append(
                f"{group} axes: {result.feedback:.0%} of the commands answers what the model leaves (gusts): an"
                " autopilot or pilot in the loop; bars are wider by that, and narrow where test inputs are flown that"
                " answer nothing"
            )
    return warnings
