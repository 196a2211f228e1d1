"""Parts of flights in, coefficients with error bars and what stands between aircraft and log out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np

from sim_vehicle.model.model_file import Model
from sim_vehicle.model.terms import parse_term
from sim_vehicle.vehicle.controls import DEFLECTION_SIGNALS
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import DivergedError, EstimationError
from sysid.numerics.gaussian import Gaussian
from sysid.posterior.declared import Stated, declared, zero_stds
from sysid.posterior.doubts import Doubt, doubts_of, flow_doubt
from sysid.posterior.estimator import MAX_PASSES, Posterior, PosteriorResult, Prior
from sysid.posterior.group import SERVO, GroupModel
from sysid.posterior.noise_spectrum import NoiseSpectrum, noise_spectra
from sysid.posterior.part import FlightPart, outputs_of, with_vane
from sysid.posterior.start import equation_error_starts, usual_starts
from sysid.posterior.unknowns import FLOW_OF, GROUPS, SURFACES_OF, THRUST_BY_SPEED_STD, Nuisance, unknowns_of
from sysid.problem.model_structure import is_longitudinal, usual_size
from sysid.signals.sensor_errors import SENSOR_ERRORS

_SURFACE_WORDS = {signal: name for name, signal in DEFLECTION_SIGNALS.items()}
# The rate that a surface commands.
_COMMANDED = {"de": "q", "da": "p", "dr": "r"}
_UNIT_OF = {output: unit for output, form, unit, _ in SENSOR_ERRORS.values() if form == "bias"}
# What stands for an output's scale factor, and its null.
_GAINS = {"alpha": ("alpha_scale", 1.0), "beta": ("beta_scale", 1.0), "airspeed": ("airspeed_error", 0.0)}
# Standard deviation of a command, rad, below which it has excited nothing.
LEAST_TRAVEL = 0.003
# Prior of a coefficient about its equation-error value: so many usual sizes. Of those that hardly matter, one.
_MAIN, _MINOR = 6.0, 1.0
_MINOR_NAMES = frozenset(("CY_p", "CY_r", "CY_da", "Cl_dr", "Cn_p", "Cn_da"))
# Above this share of its prior a flight has told nothing of a number.
PRIOR_SHARE = 0.7

# A nuisance beyond so many of its prior standard deviations is none.
_BELIEVED = 4.0
# Of what is told by the flight itself, for its prior is narrower than what a pitot's hoses may do, s.
_REALISTIC = {"airspeed_lag": 0.03}
# Beginnings of the names of what such a one spoils, where it is not the whole group.
_SPOILED = {"thrust_error": ("CD",)}
# By so much may the answered share of the commands seem larger, and gusts that are seen are still better than not.
_NO_WORSE = 0.1
# What a law moves can be told from damping by how late it comes alone: at the 1 Hz of a Dutch roll 20 deg of phase, s.
_TOLD_APART_S = 0.05
# Steps from each of two starts before one is chosen.
_FIRST_PASSES = 3
# By how much servos of one aircraft differ, s, one standard deviation.
_ALIKE = {"servo_delay": 0.006, "servo_lag": 0.008}

Report = Callable[[float, str], None]


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
    doubts: Sequence[Doubt]

    def nuisances(self, flight: str) -> dict[str, float]:
        """All nuisances of a flight by name, those that are held included."""
        model, theta = self.posterior.model, self.result.theta
        return model.unknowns.values(theta[len(model.parameters) :], flight)


@dataclass(frozen=True)
class PosteriorEstimate:
    """What the flights tell. joint: coefficients and effect parameters, misfit included in the covariance.

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
        joint, prior_std = _joint(groups)
        return replace(
            self, joint=joint, prior_std=prior_std, groups=groups, nuisances=_nuisances(groups),
            not_believed=_not_believed(groups),
        )  # fmt: skip

    @property
    def results(self) -> dict[str, PosteriorResult]:
        """By group of axes."""
        return {group: one.result for group, one in self.groups.items()}

    def servos(self, group: str, flight: str) -> tuple[float, ...] | None:
        """Delay [s], lag [s] and backlash [rad] of a group's servos, those of a flight that was not among the estimated
        the mean of all; None where the group was not estimated.
        """
        if group not in self.groups:
            return None
        model, theta = self.groups[group].posterior.model, self.groups[group].result.theta
        flown = list(dict.fromkeys(part.flight for part in model.parts))
        every = [
            model.unknowns.values(theta[len(model.parameters) :], one)
            for one in ([flight] if flight in flown else flown)
        ]
        return tuple(float(np.mean([one[key] for one in every])) for key in SERVO)

    def sensor_errors(self, share: float = np.inf) -> dict[str, tuple[float, float, str]]:
        """Value, standard error and unit of the zeros and gains of sensors that the estimate stands on; of those that
        it told better than `share` of what was known before.
        """
        # Of two groups that tell the same one, the surer counts.
        every = sorted(self.nuisances, key=lambda one: -one.std)
        told = {one.name: one for one in every if one.std < share * one.prior_std}
        found = {}
        for error, (output, form, unit, _) in SENSOR_ERRORS.items():
            name, null = (f"{output}_zero", 0.0) if form == "bias" else _GAINS.get(output, ("", 0.0))
            if name in told:
                found[error] = (told[name].value - null, told[name].std, unit)
        return found

    def systematic(self) -> dict[str, dict[str, float]]:
        """Change of each coefficient and effect parameter under each error of what was taken as known."""
        return {
            name: {doubt: float(shift[i]) for doubt, shift in one.result.systematic.items()}
            for one in self.groups.values()
            for i, name in enumerate(one.result.names[: len(one.posterior.model.parameters)])
        }


@dataclass(frozen=True)
class _Begun:
    """A search of one group of axes near its end. theta: all unknowns; feedback: as in PosteriorResult."""

    posterior: Posterior
    theta: Array
    feedback: float
    doubts: Sequence[Doubt]

    def ended(self, fine: bool) -> GroupEstimate:
        """The group, estimated, on the full grid or on half of it."""
        posterior = self.posterior if fine else self.posterior.of(self.posterior.model.rough())
        return GroupEstimate(posterior, posterior.solve(self.theta, self.doubts), self.doubts)


def _seen(parts: Sequence[FlightPart], found: Mapping[str, GroupEstimate], vehicle: Vehicle) -> list[FlightPart]:
    """The parts with the flow angles of the groups found as they were before their vanes."""
    seen = list(parts)
    for group, one in found.items():
        seen = [with_vane(part, FLOW_OF[group], vehicle.sensors, one.nuisances(part.flight)) for part in seen]
    return seen


def _again(before: GroupEstimate, parts: Sequence[FlightPart]) -> GroupEstimate:
    """The estimate of a group from where it stood, with other motion imposed."""
    posterior = before.posterior.of(before.posterior.model.of(parts))
    start = np.concatenate((before.result.theta, before.result.states))
    return GroupEstimate(posterior, posterior.solve(start, before.doubts), before.doubts)


def excited(parts: Sequence[FlightPart]) -> frozenset[str]:
    """Surfaces (of de, da, dr) that moved in some part."""
    return frozenset(name for name in ("de", "da", "dr") if any(part.travel(name) > LEAST_TRAVEL for part in parts))


def estimate(
    parts: Sequence[FlightPart],
    vehicle: Vehicle,
    structure: Model,
    effects: Sequence[tuple[str, str]] = (),
    known: Gaussian | None = None,
    systematic: bool = True,
    lost: Mapping[str, str] = MappingProxyType({}),
    progress: Report = lambda share, text: None,
    near: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
    fine: bool = True,
) -> PosteriorEstimate:
    """Estimate every group of axes that the parts excite.

    structure: a model whose coefficients (values ignored) and effects are flown. effects: (effect, parameter) that are
    free. known: what a prior model tells. Priors of the nuisances that the vehicle file states replace the table's.
    systematic: whether to say what usual errors of that file would do. lost: group -> why it cannot be estimated.
    near: group -> unknown -> where the estimate of much the same flight ended: another start. fine: whether the search
    ends with the full grid, and the longitudinal axes are fitted again once the sideslip is known.
    Raises EstimationError where no group can be estimated.
    """
    moved = excited(parts)
    doubts = [
        one
        for one in doubts_of(vehicle, not any(part.thrust_from == "throttle" for part in parts))
        if one.stated or systematic
    ]
    found: dict[str, GroupEstimate] = {}
    left_out, unexcited, warnings = {}, [], []
    problem = EstimationError
    for place, group in enumerate(GROUPS):
        own = [name for name in structure.coefficients if is_longitudinal(name) == (group == "longitudinal")]
        if not own:
            continue
        if group in lost:
            left_out[group] = lost[group]
            continue
        if not moved & set(SURFACES_OF[group]):
            unexcited += own
            left_out[group] = f"{' and '.join(SURFACES_OF[group])} did not move"
            continue
        still = set(SURFACES_OF[group]) - moved
        names = [name for name in own if not still & set(parse_term(name).factors)]
        unexcited += [name for name in own if name not in names]
        outputs = outputs_of(group, parts)
        if lacking := _lacking(group, outputs):
            left_out[group] = f"{lacking} is missing, or its sensor is dead"
            continue
        progress(0.45 * place, f"{group} axes")
        free = effects if not found else ()
        stated = {**_alike(found), **declared(vehicle, group, parts[0].messages), **_thrust_prior(parts)}
        try:
            seen = _seen(parts, found, vehicle)
            begin = partial(
                _begun, seen, vehicle, structure, names, free, group, outputs, known, stated, doubts,
                near.get(group, {}),
            )  # fmt: skip
            begun = begin()
            if begun.feedback > 0.0 and FLOW_OF[group] in outputs:
                with suppress(EstimationError):
                    other = begin(flow_imposed=True)
                    if other.feedback < begun.feedback + _NO_WORSE:
                        begun = other
            found[group] = begun.ended(fine)
        except EstimationError as error:
            left_out[group] = str(error)
            problem = DivergedError if isinstance(error, DivergedError) else problem
    if fine and len(found) > 1:
        progress(0.9, "longitudinal axes, with the sideslip as its vane's dynamics leave it")
        others = {group: one for group, one in found.items() if group == "lateral"}
        with suppress(EstimationError):
            found["longitudinal"] = _again(found["longitudinal"], _seen(parts, others, vehicle))
    if not found:
        raise problem("; ".join(f"{group}: {why}" for group, why in left_out.items()))
    warnings += [f"{group} axes are not estimated: {why}" for group, why in left_out.items()]
    for group, result in ((group, one.result) for group, one in found.items()):
        warnings += [
            f"{_SURFACE_WORDS[name]}: moved by nothing but a law of the motion (a damper, a hold without set points):"
            " what it does is told from damping by its lateness alone; fly test inputs on it"
            for name in result.laws
        ]
        if result.feedback > 0.0:
            warnings.append(
                f"{group} axes: {result.feedback:.0%} of the commands answers what the model leaves (gusts): an"
                " autopilot or pilot in the loop; bars are wider by that, and narrow where test inputs are flown that"
                " answer nothing"
            )
    joint, prior_std = _joint(found)
    noise = [noise_spectra(one.result.outputs, one.result.spectra, parts, vehicle) for one in found.values()]
    return PosteriorEstimate(
        joint, prior_std, found, _nuisances(found),
        tuple(one for group in noise for one in group), tuple(unexcited), left_out, _not_believed(found),
        tuple(warnings),
    )  # fmt: skip


def _lacking(group: str, outputs: Sequence[str]) -> str:
    """What a group of axes cannot be estimated without and does not have, in words."""
    gyros = {"longitudinal": ("q",), "lateral": ("p", "r")}[group]
    lacking = " and ".join(name for name in gyros if name not in outputs)
    if not lacking and group == "longitudinal" and not {"az", "alpha"} & set(outputs):
        return "az"
    return lacking


def _thrust_prior(parts: Sequence[FlightPart]) -> dict[str, Stated]:
    """How well thrust is known where no sensor measures it; the throttle's stands among what was taken as known."""
    sources = {part.thrust_from for part in parts}
    if sources <= {"throttle", ""}:
        return {"thrust_error": (0.0, 0.0)}
    return {"thrust_error": (None, THRUST_BY_SPEED_STD)} if "rpm" in sources else {}


def _alike(found: Mapping[str, GroupEstimate]) -> dict[str, Stated]:
    """What the servos of one group tell of the other's: the same message, mostly the same make of servo."""
    stated: dict[str, Stated] = {}
    for model, result in ((one.posterior.model, one.result) for one in found.values()):
        for i, one in enumerate(model.unknowns, len(model.parameters)):
            if (
                one.name in _ALIKE
                and not one.flight
                and result.feedback == 0.0
                and not all(part.position for part in model.parts)
            ):
                std = float(np.hypot(np.sqrt(result.covariance[i, i]), _ALIKE[one.name]))
                stated[one.name] = (float(result.theta[i]), std)
    return stated


def _begun(
    parts: Sequence[FlightPart],
    vehicle: Vehicle,
    structure: Model,
    names: Sequence[str],
    effects: Sequence[tuple[str, str]],
    group: str,
    outputs: Sequence[str],
    known: Gaussian | None,
    stated: Mapping[str, Stated],
    doubts: Sequence[Doubt],
    near: Mapping[str, float],
    flow_imposed: bool = False,
) -> _Begun:
    position = all(part.position for part in parts)
    lag, flights = _airspeed_lag(parts), tuple(dict.fromkeys(part.flight for part in parts))
    unknowns = unknowns_of(group, FLOW_OF[group] in outputs, position, stated, (lag,), flow_imposed, flights)
    if flow_imposed:
        outputs = [name for name in outputs if name != FLOW_OF[group]]
        scale = f"{FLOW_OF[group]}_scale"
        # Every force and moment goes with the flow as the vane read it: no flight tells its scale then.
        doubts = [*doubts, *(flow_doubt(scale, one.std) for one in unknowns if one.name == scale)]
        unknowns = unknowns.without(scale)
    own = {name: entry for name, entry in structure.coefficients.items() if name in names}
    structure = replace(structure, coefficients=own, correlation=None)
    model = GroupModel(parts, vehicle, structure, names, effects, group, outputs, unknowns, flow_imposed)
    rough = model.rough()
    starts = equation_error_starts(parts, vehicle, names) + usual_starts(parts, vehicle, names)
    again = set(names) <= near.keys()
    if again:
        starts = [(dict(near), 0.0), *starts]
    states, states_std = model.start_states()
    low, high = _bounds(model, len(names))
    tried: list[tuple[float, Array, Posterior]] = []
    for first, delay in starts:
        mean, std = [], []
        for name in names:
            share = _MINOR if name in _MINOR_NAMES else _MAIN
            mean.append(first[name])
            std.append(max(share * usual_size(name), abs(first[name])))
        for effect, parameter in effects:
            entry = structure.effect(effect) or {}
            mean.append(entry[parameter])
            std.append(max(abs(entry[parameter]), 1e-3))
        middle = np.concatenate((mean, unknowns.mean, states))
        information = np.diag(1.0 / np.concatenate((std, unknowns.std, states_std)) ** 2)
        if known is not None:
            middle, information = _with_known(middle, information, model.names, known)
        begin = middle.copy()
        # What equation error calls the delay is the servo's whole lateness.
        lag_s = next((one.mean for one in unknowns if one.name == "servo_lag"), 0.0)
        for i, one in enumerate(unknowns, len(mean)):
            if one.name == "servo_delay" and not position:
                begin[i] = max(delay - lag_s, 0.0)
        if again and not tried:
            begin[: len(model.names)] = [near.get(name, value) for name, value in zip(model.names, begin, strict=False)]
        posterior = Posterior(rough, Prior(middle, information), low, high, zero_stds(vehicle))
        tried.append((posterior.profile(begin), begin, posterior))
    posterior, theta = _best(tried, again)
    return _Begun(posterior.of(model), theta, posterior.feedback(theta), doubts)


def _best(tried: list[tuple[float, Array, Posterior]], near: bool) -> tuple[Posterior, Array]:
    """The likelier of where the two likeliest starts lead, of those from which the simulation does not diverge.

    near: whether the first is where an estimate of much the same ended; where it is the likeliest, it alone counts.
    """
    usable = sorted((one for one in tried if np.isfinite(one[0])), key=lambda one: one[0])[:2]
    if not usable:
        raise DivergedError("the simulated motion diverges from every start: the aircraft may be unstable")
    if near and usable[0] is tried[0]:
        _, theta, posterior = tried[0]
        return posterior, posterior.search(theta, MAX_PASSES)
    searched = []
    for _, begin, posterior in usable:
        theta = posterior.search(begin, _FIRST_PASSES)
        searched.append((posterior.profile(theta), theta, posterior))
    _, theta, posterior = min(searched, key=lambda one: one[0])
    return posterior, posterior.search(theta, MAX_PASSES)


def _airspeed_lag(parts: Sequence[FlightPart]) -> Nuisance:
    """The pitot's lag as all parts' kinematics tell it."""
    weight = np.array([1.0 / max(part.airspeed.lag_std, 1e-6) ** 2 for part in parts])
    mean = float(weight @ [part.airspeed.lag for part in parts] / weight.sum())
    least = min(part.airspeed.lag_std for part in parts)
    std = max(float(weight.sum() ** -0.5), min(least, 0.004)) if least > 0.0 else 0.0
    return Nuisance("airspeed_lag", mean, std, 0.0, 0.0, 0.5, 5e-3, "s", "both", "the accelerometers of this flight")


def _with_known(mean: Array, information: Array, names: Sequence[str], known: Gaussian) -> tuple[Array, Array]:
    """The prior with what another model tells of some unknowns."""
    stated = known.of([name for name in names if name in known.names])
    if stated is None:
        return mean, information
    places = [list(names).index(name) for name in stated.names]
    own = np.linalg.inv(stated.covariance)
    mean, information = mean.copy(), information.copy()
    mean[places] = stated.mean
    information[np.ix_(places, places)] = own
    return mean, information


def _bounds(model: GroupModel, coefficients: int) -> tuple[Array, Array]:
    low, high = np.full(model.size, -np.inf), np.full(model.size, np.inf)
    for i, parameter in enumerate(model.parameters):
        if i >= coefficients:
            low[i], high[i] = parameter.low, parameter.high
    count = len(model.parameters)
    here = slice(count, count + len(model.unknowns.names))
    low[here], high[here] = model.unknowns.bounds
    return low, high


def _joint(found: Mapping[str, GroupEstimate]) -> tuple[Gaussian, dict[str, float]]:
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
    covariance = np.zeros((len(names), len(names)))
    begin = 0
    for block in blocks:
        here = slice(begin, begin + block.shape[0])
        covariance[here, here] = block
        begin += block.shape[0]
    return Gaussian(tuple(names), np.concatenate(values), covariance), prior


def _not_believed(found: Mapping[str, GroupEstimate]) -> dict[str, str]:
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
        servo = {n.name: float(value) for n, value in zip(model.unknowns, theta[count:], strict=True)}
        if servo.get("servo_delay", 0.0) + servo.get("servo_lag", 0.0) < _TOLD_APART_S:
            for surface in one.result.laws:
                hidden = {surface, _COMMANDED[surface]}
                reasons |= {
                    name: f"the {_SURFACE_WORDS[surface]} did nothing but follow a law of the motion, at once"
                    for name in one.result.names[:count]
                    if "." not in name and hidden & set(parse_term(name).factors)
                }
    return reasons


def _nuisances(found: Mapping[str, GroupEstimate]) -> tuple[NuisanceEstimate, ...]:
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
