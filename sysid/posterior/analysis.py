"""Parts of flights in, coefficients with error bars and what stands between aircraft and log out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np

from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import DivergedError, EstimationError
from sysid.numerics.gaussian import Gaussian
from sysid.posterior.closed_loop import LEAST_SHARE, follow_laws
from sysid.posterior.considered_errors import ConsiderParameter, doubts_of, flow_doubts
from sysid.posterior.estimates import (
    SURFACE_WORDS,
    GroupEstimate,
    PosteriorEstimate,
    joint_of,
    not_believed_of,
    nuisances_of,
    warnings_of,
)
from sysid.posterior.estimator import MAX_PASSES, Posterior
from sysid.posterior.flight_part import FlightPart, held_between, outputs_of, with_flow, with_vane
from sysid.posterior.group_model import SERVO, GroupModel
from sysid.posterior.inputs import SHORTEST_LAG_S
from sysid.posterior.likelihood import Prior
from sysid.posterior.nuisance_priors import (
    FLOW_OF,
    GROUPS,
    SURFACES_OF,
    THRUST_BY_SPEED_STD,
    Nuisance,
    unknowns_of,
)
from sysid.posterior.reported_spectrum import noise_spectra
from sysid.posterior.residual_spectrum import noise_share
from sysid.posterior.start_values import equation_error_starts, usual_starts
from sysid.posterior.stated_priors import Stated, declared, of_aircraft, zero_stds
from sysid.problem.model_structure import is_longitudinal, usual_size
from sysid.signals.record import SURFACES
from sysid.signals.thrust.electric import gain_doubt
from sysid.signals.thrust.source import BATTERY, MOTORS

# Standard deviation of a command, rad, below which it has excited nothing; and below which its surface stood still,
# or so many times what a measured position resolves: of a motion as small as its noise the noise makes too much. What
# moves a surface between the two says little of it, but without it others come out wrong.
LEAST_TRAVEL, _STILL, _RESOLUTIONS = 0.003, 1e-4, 4.0
# Prior of a coefficient about its equation-error value: so many usual sizes. Of those that hardly matter, one.
_MAIN, _MINOR = 6.0, 1.0
_MINOR_NAMES = frozenset(("CY_p", "CY_r", "CY_da", "Cl_dr", "Cn_p", "Cn_da"))
# By so much may the answered share of the commands seem larger, and gusts that are seen are still better than not.
_NO_WORSE = 0.1
# Largest share of noise in a flow angle by its vane that may drive the simulation. Lift shows gusts to an accelerometer
# as a vane does; the side force does not, and a loop makes more of gusts that are not seen than noise does.
_MOST_NOISE = {"alpha": 0.1, "beta": 1.0}
# Steps from each of two starts before one is chosen.
_FIRST_PASSES = 3
# By so much in logarithms of probability another end of a search is likelier, and not the same.
_LIKELIER = 2.0
_DELAY, _LAG, _ = SERVO
# By how much servos of one aircraft differ, s, one standard deviation.
_ALIKE = {_DELAY: 0.006, _LAG: 0.008}

Report = Callable[[float, str], None]


@dataclass(frozen=True)
class _GroupSearch:
    """A search of one group of axes on half of its grid. model: on all of it; theta: all unknowns; usual: values that
    an aircraft of the class has of stability and damping.
    """

    posterior: Posterior
    model: GroupModel
    theta: Array
    usual: Mapping[str, float]
    doubts: Sequence[ConsiderParameter]

    def optimise(self) -> _GroupSearch:
        """The same, near the search's end.

        Where that is beside the optimum (rolling at once by sideslip, that no surface disturbs, is nearly as likely as
        rolling as it does), coefficients that are usual lead to a likelier one, beside servos and sensors as found. A
        flow that is imposed leaves no such choice.
        """
        found = replace(self, theta=self.posterior.search(self.theta, MAX_PASSES))
        return found if self.model.flow_imposed else found.keep_if_better(self.usual)

    def keep_if_better(
        self, other: Mapping[str, float], passes: int = _FIRST_PASSES, by: float = _LIKELIER
    ) -> _GroupSearch:
        """The end of a search, or where one from other values of some unknowns leads, if that is likelier.

        passes: after which it must be so. by: logarithm of how much.
        """
        start = self.theta.copy()
        names = self.model.names
        start[: len(names)] = [other.get(*one) for one in zip(names, start.tolist(), strict=False)]
        return self._or_likelier(self, [start], passes, by)

    def _or_likelier(self, other: _GroupSearch, starts: Sequence[Array], passes: int, by: float) -> _GroupSearch:
        """The same, or where the search of another leads from the best of some starts, if that is likelier."""
        with suppress(EstimationError):
            theta = other.posterior.search(min(starts, key=other.posterior.profile_cost), passes)
            if other.posterior.profile_cost(theta) < self.posterior.profile_cost(self.theta) - by:
                return replace(other, theta=other.posterior.search(theta, MAX_PASSES))
        return self

    def likelier_inputs(self) -> _GroupSearch:
        """The same, or with commands that stay from stamp to stamp in place of a curve through them, if that is
        likelier: a smooth command of a loop that sends each until the next is logged as one that is computed anew.
        """
        interval_s = max(part.command_interval_s for part in self.model.parts)
        parts = [held_between(part) for part in self.model.parts]
        same = all(one is other for one, other in zip(parts, self.model.parts, strict=True))
        # Behind a servo whose lag is longer than an interval nothing of the steps is left.
        if same or self.values().get(_LAG, 0.0) > interval_s:
            return self
        model = self.model.of(parts)
        held = replace(self, posterior=self.posterior.of(model.rough()), model=model)
        # From where the curve led, half a sample earlier; and from a servo that follows at once.
        starts = [self._with_servo(lambda s: s - 0.5 * interval_s, 1.0), self._with_servo(lambda _: 0.0, 0.0)]
        return self._or_likelier(held, starts, _FIRST_PASSES, 0.0)

    def _with_servo(self, delay: Callable[[float], float], lag: float) -> Array:
        """Where the search stands, its servos with other delays, s, and so many times their lag."""
        theta = self.theta.copy()
        for place, name in enumerate(self.model.names):
            if name.partition(" of ")[0] == _DELAY:
                theta[place] = delay(theta[place])
            elif name == _LAG:
                theta[place] *= lag
        return theta

    def feedback(self) -> float:
        """Largest share of a command that follows what is left, as in PosteriorResult."""
        return self.posterior.of(self.model).feedback(self.theta)

    def values(self) -> dict[str, float]:
        """What every unknown but the initial states stands at."""
        names = self.model.names
        return dict(zip(names, self.theta[: len(names)].tolist(), strict=True))

    def noise_of(self, output: str) -> float:
        """Share of noise in what the flights measured of an output."""
        parts, place = self.model.parts, self.model.outputs.index(output)
        series = [self.model.measured(i)[place] for i in range(len(parts))]
        return noise_share(series, [part.common for part in parts], min(part.highest_hz(output) for part in parts))

    def ended(self, fine: bool) -> GroupEstimate:
        """The group, estimated, on the full grid or on half of it."""
        posterior = self.posterior.of(self.model if fine else self.model.rough())
        # A lag too short for any log is none: it would not be distinguished from the delay.
        lag = self.values().get(_LAG, 0.0)
        start = self._with_servo(lambda delay: delay, 0.0) if lag < SHORTEST_LAG_S else self.theta
        return GroupEstimate(posterior, posterior.solve(start, self.doubts), self.doubts)


def _seen(parts: Sequence[FlightPart], found: Mapping[str, GroupEstimate], vehicle: Vehicle) -> list[FlightPart]:
    """The parts with the flow angles of the groups found as they were before their vanes, or as simulated without."""
    seen = list(parts)
    for group, one in found.items():
        flow, theta = FLOW_OF[group], np.concatenate((one.result.theta, one.result.states))
        for i, part in enumerate(seen):
            if flow in part.channels:
                seen[i] = with_vane(part, flow, vehicle.sensors, one.nuisances(part.flight))
            elif not one.posterior.model.flow_imposed:
                seen[i] = with_flow(part, flow, vehicle.sensors, one.posterior.model.flow(i, theta))
    return seen


def _again(before: GroupEstimate, parts: Sequence[FlightPart]) -> GroupEstimate:
    """The estimate of a group from where it stood, with other motion imposed; commands as it had them."""
    model = before.posterior.model
    pairs = zip(parts, model.parts, strict=True)
    posterior = before.posterior.of(model.of([replace(one, inputs=own.inputs) for one, own in pairs]))
    start = np.concatenate((before.result.theta, before.result.states))
    return GroupEstimate(posterior, posterior.solve(start, before.doubts), before.doubts)


def excited(parts: Sequence[FlightPart], least: float = LEAST_TRAVEL) -> frozenset[str]:
    """Surfaces (of de, da, dr and controls of other names) whose command has a standard deviation of more than `least`
    [rad] in some part.
    """
    names = {*SURFACES, *(name for part in parts for name in part.named)}
    return frozenset(name for name in names if _travel(parts, name) > least)


def _travel(parts: Sequence[FlightPart], name: str) -> float:
    """Standard deviation of a command in the part where it is largest; of a control of another name through all parts,
    for one that stands elsewhere in each flight has moved, and no level of a part stands for it.
    """
    largest = max(part.travel(name) for part in parts)
    if not any(name in part.named for part in parts):
        return largest
    every = [part.inputs[name].at(part.common.points) for part in parts if name in part.inputs]
    return max(largest, float(np.std(np.concatenate(every))))


def stirred_in(parts: Sequence[FlightPart]) -> frozenset[str]:
    """Surfaces that move by more than their log resolves in some part: their terms are in the model."""
    return frozenset(
        name
        for part in parts
        for name in (*SURFACES, *part.named)
        if name in part.inputs
        and _travel(parts if name in part.named else [part], name)
        > min(LEAST_TRAVEL, max(_STILL, _RESOLUTIONS * part.inputs[name].resolution))
    )


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
    free. known: what a prior model says. Priors of the nuisances that the vehicle file states replace the table's.
    systematic: whether to say what usual errors of that file would do. lost: group -> why it cannot be estimated.
    near: group -> unknown -> where the estimate of much the same flight ended: another start. fine: whether the search
    ends with the full grid, and the longitudinal axes are fitted again once the sideslip is known.
    Raises EstimationError where no group can be estimated.
    """
    moved, stirred = excited(parts), stirred_in(parts)
    doubts = [
        one
        for one in doubts_of(vehicle, {part.thrust_from for part in parts})
        # The product of inertia is estimated from the lateral motion, and the rest hardly goes with it.
        if (one.stated or systematic) and one.name != "Ixz_std"
    ]
    found: dict[str, GroupEstimate] = {}
    left_out: dict[str, str] = {}
    unexcited: list[str] = []
    problem = EstimationError
    for place, group in enumerate(GROUPS):
        own = [name for name in structure.coefficients if is_longitudinal(name) == (group == "longitudinal")]
        if not own:
            continue
        if group in lost:
            left_out[group] = lost[group]
            continue
        named = {control for name in own if (control := parse_term(name).control)}
        still = {*SURFACES_OF[group], *named} - stirred
        # What a control of another name does is distinguished from the motion where the group's surfaces are known.
        described = any(name in part.inputs for part in parts for name in SURFACES_OF[group])
        whole = bool(set(SURFACES_OF[group]) & moved) or (described and bool(named & moved))
        names = [name for name in own if whole and not still & set(parse_term(name).factors)]
        unexcited += [name for name in own if name not in names]
        outputs = outputs_of(group, parts)
        if why := _lacking(group, outputs, names):
            left_out[group] = why
            continue
        progress(0.45 * place, f"{group} axes")
        free = effects if not found else ()
        stated = {
            **_alike(found),
            **declared(vehicle, group, parts[0].messages),
            **_thrust_prior(parts, vehicle),
            **_rounding_prior(parts),
        }
        try:
            seen = _seen(parts, found, vehicle)
            begin = partial(
                _start_search, seen, vehicle, structure, names, free, group, outputs, known, stated, doubts,
            )  # fmt: skip
            search = _likelier_flow(begin, near.get(group, {}), FLOW_OF[group]).likelier_inputs()
            ended = search.ended(fine)
            if why := _answered_alone(group, ended, moved):
                left_out[group] = why
            else:
                found[group] = ended
        except EstimationError as error:
            left_out[group] = str(error)
            problem = DivergedError if isinstance(error, DivergedError) else problem
    if fine and len(found) > 1:
        progress(0.9, "longitudinal axes, sideslip corrected for its vane's dynamics")
        others = {group: one for group, one in found.items() if group == "lateral"}
        with suppress(EstimationError):
            found["longitudinal"] = _again(found["longitudinal"], _seen(parts, others, vehicle))
    if not found:
        raise problem("; ".join(f"{group}: {why}" for group, why in left_out.items()))
    joint, prior_std = joint_of(found)
    noise = [
        noise_spectra(one.result.outputs, one.result.spectra, parts, vehicle, one.posterior.whole)
        for one in found.values()
    ]
    return PosteriorEstimate(
        joint, prior_std, found, nuisances_of(found), tuple(one for group in noise for one in group), tuple(unexcited),
        left_out, not_believed_of(found), tuple(warnings_of(found, left_out)),
    )  # fmt: skip


def _lacking(group: str, outputs: Sequence[str], names: Sequence[str]) -> str:
    """Why a group of axes cannot be estimated: what is missing that it does not do without; empty where nothing is.

    names: its coefficients that the flights excite.
    """
    if not names:
        return f"{' and '.join(SURFACES_OF[group])} did not move"
    gyros = {"longitudinal": ("q",), "lateral": ("p", "r")}[group]
    lacking = " and ".join(name for name in gyros if name not in outputs)
    if not lacking and group == "longitudinal" and not {"az", "alpha"} & set(outputs):
        lacking = "az"
    return f"{lacking} is missing, or its sensor is dead" if lacking else ""


def _answered_alone(group: str, found: GroupEstimate, moved: frozenset[str]) -> str:
    """Why a group of axes is not known though its surfaces moved: a hold or a damper alone moved them, and it answers
    what gusts alone have done. Empty where one moved by itself, or where little is left that could be answered.
    """
    posterior = found.posterior
    surfaces = [name for name in SURFACES_OF[group] if name in moved]
    if not surfaces or set(surfaces) - set(follow_laws(posterior.parts, surfaces)):
        return ""
    left = posterior.most_answered(found.result.residuals, range(len(posterior.parts)))
    if max(left) <= LEAST_SHARE:
        return ""
    words = " and ".join(SURFACE_WORDS[name] for name in surfaces)
    return f"{words} did nothing but follow a law of the motion (a hold, a damper), and answered gusts; fly test inputs"


def _likelier_flow(begin: Callable[..., _GroupSearch], near: Mapping[str, float], flow: str) -> _GroupSearch:
    """A group begun; in a closed loop by the whole band, and with the flow as its vane read it, where that leaves no
    more to the loop.

    What looks like a loop may be a search that ended beside the optimum, whose residuals go with the commands: it is
    begun again from where the vane's flow leads. A vane's noise that drives the simulation weakens whatever goes with
    the flow, by its share of the flow's power: where that is much of an angle of attack, whose gusts lift shows too,
    the loop is the lesser evil, and the flow leads to a start alone.
    """
    begun = begin(near).optimise()
    if begun.feedback() > 0.0:
        begun = begin(begun.values(), whole=True).optimise()
    feedback = begun.feedback()
    if feedback > 0.0 and flow in begun.model.outputs:
        noise = begun.noise_of(flow)
        with suppress(EstimationError):
            other = begin(begun.values(), vane_noise=noise, whole=True).optimise()
            again = begun.keep_if_better(other.values(), MAX_PASSES, 0.0)
            if again.feedback() == 0.0:
                return again
            if noise < _MOST_NOISE[flow] and other.feedback() < feedback + _NO_WORSE:
                return other
    return begun


def _thrust_prior(parts: Sequence[FlightPart], vehicle: Vehicle) -> dict[str, Stated]:
    """How well thrust is known where no sensor measures it; the throttle's stands among what was taken as known."""
    sources = {part.thrust_from for part in parts}
    if sources <= {"throttle", ""}:
        return {"thrust_error": (0.0, 0.0)}
    if BATTERY in sources and vehicle.propulsion is not None:
        return {"thrust_error": (None, gain_doubt(vehicle.propulsion))}
    return {"thrust_error": (None, THRUST_BY_SPEED_STD)} if {"rpm", MOTORS} & sources else {}


def _rounding_prior(parts: Sequence[FlightPart]) -> dict[str, Stated]:
    """Nothing to know of rounding where none is."""
    rounded = any(part.inputs[name].rounding.size for part in parts for name in SURFACES if name in part.inputs)
    return {} if rounded else {"command_rounding": (0.0, 0.0)}


def _alike(found: Mapping[str, GroupEstimate]) -> dict[str, Stated]:
    """What the servos of one group say of the other's: the same message, mostly the same make of servo."""
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


def _start_search(
    parts: Sequence[FlightPart],
    vehicle: Vehicle,
    structure: Model,
    names: Sequence[str],
    effects: Sequence[tuple[str, str]],
    group: str,
    outputs: Sequence[str],
    known: Gaussian | None,
    stated: Mapping[str, Stated],
    doubts: Sequence[ConsiderParameter],
    near: Mapping[str, float],
    vane_noise: float | None = None,
    whole: bool = False,
) -> _GroupSearch:
    """vane_noise: share of noise in the flow as its vane read it, where that is imposed. whole: all the band counts."""
    flow, flow_imposed = FLOW_OF[group], vane_noise is not None
    position = all(part.position for part in parts)
    lag, flights = _airspeed_lag(parts), tuple(dict.fromkeys(part.flight for part in parts))
    more = (lag, *of_aircraft(vehicle, {part.thrust_from for part in parts}, structure, "az" in outputs))
    unknowns = unknowns_of(group, flow in outputs, position, stated, more, flights)
    if vane_noise is not None:
        outputs = [name for name in outputs if name != flow]
        scale = f"{flow}_scale"
        # Every force and moment goes with the flow as the vane read it: its scale is not identifiable then.
        known_to = sum(one.std for one in unknowns if one.name == scale)
        doubts = [*doubts, *flow_doubts(flow, float(np.hypot(known_to, vane_noise)), zero_stds(vehicle)[flow])]
        unknowns = unknowns.without(scale)
    own = {name: entry for name, entry in structure.coefficients.items() if name in names}
    structure = replace(structure, coefficients=own, correlation=None)
    model = GroupModel(parts, vehicle, structure, names, effects, group, outputs, unknowns, flow_imposed)
    rough = model.rough()
    lag_s = next((one.mean for one in unknowns if one.name == _LAG), 0.0)
    # What equation error calls the delay is the servo's whole delay, lag included.
    starts = [
        (values, {_DELAY: max(delay - lag_s, 0.0)}) for values, delay in equation_error_starts(parts, vehicle, names)
    ] + [
        (values, {_DELAY: max(delay - lag_s, 0.0), _LAG: min(delay, lag_s)})
        for values, delay in usual_starts(parts, vehicle, names)
    ]
    usual = starts[-1][0]
    again = set(names) <= near.keys()
    if again:
        starts = [(dict(near), {}), *([] if flow_imposed else starts)]
    states, states_std = model.start_states()
    low, high = _bounds(model, len(names))
    tried: list[tuple[float, Array, Posterior]] = []
    for first, servo in starts:
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
        posterior = Posterior(rough, Prior(middle, information), low, high, zero_stds(vehicle), whole)
        values = near if again and not tried else {} if position else servo
        begin = middle.copy()
        begin[: len(model.names)] = [values.get(*one) for one in zip(model.names, middle.tolist(), strict=False)]
        tried.append((posterior.profile_cost(begin), begin, posterior))
    posterior, theta = _best(tried, again)
    # Which way a surface counts is the vehicle file's choice.
    surfaces = {*SURFACES_OF[group], *vehicle.named_controls}
    motion = {name: usual[name] for name in names if not surfaces & set(parse_term(name).factors)}
    return _GroupSearch(posterior, model, theta, motion, doubts)


def _best(tried: list[tuple[float, Array, Posterior]], near: bool) -> tuple[Posterior, Array]:
    """The likelier of where some steps from the two likeliest starts lead, of those whose simulation does not diverge.

    near: whether the first is where an estimate of much the same ended; where it is the likeliest, it alone counts.
    """
    usable = sorted((one for one in tried if np.isfinite(one[0])), key=lambda one: one[0])[:2]
    if not usable:
        raise DivergedError("the simulated motion diverges from every start: the aircraft may be unstable")
    if near and usable[0] is tried[0]:
        _, theta, posterior = tried[0]
        return posterior, posterior.search(theta, _FIRST_PASSES)
    optimise = []
    for _, begin, posterior in usable:
        theta = posterior.search(begin, _FIRST_PASSES)
        optimise.append((posterior.profile_cost(theta), theta, posterior))
    _, theta, posterior = min(optimise, key=lambda one: one[0])
    return posterior, theta


def _airspeed_lag(parts: Sequence[FlightPart]) -> Nuisance:
    """The pitot's lag as estimated by the kinematics of all parts."""
    weight = np.array([1.0 / max(part.airspeed.lag_std, 1e-6) ** 2 for part in parts])
    mean = float(weight @ [part.airspeed.lag for part in parts] / weight.sum())
    least = min(part.airspeed.lag_std for part in parts)
    std = max(float(weight.sum() ** -0.5), min(least, 0.004)) if least > 0.0 else 0.0
    return Nuisance("airspeed_lag", mean, std, 0.0, 0.0, 0.5, 5e-3, "s", "both", "the accelerometers of this flight")


def _with_known(mean: Array, information: Array, names: Sequence[str], known: Gaussian) -> tuple[Array, Array]:
    """The prior with what another model says of some unknowns."""
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
