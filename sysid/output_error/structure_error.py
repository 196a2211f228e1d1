"""Aerodynamics that a model's structure does not hold: found in the residuals, and counted in the standard errors.

A polynomial is not the aircraft. What it leaves over is small beside one reading and large beside a thousand: the
likelihood then weighs it by its own lights, and standard errors that speak of noise alone are too small. Let the
coefficient of an axis along the flight be

    C = X theta + M gamma,

X the regressors of the structure and M those of further terms. Outside X lies M_o = M - X P, with P the least-squares
coefficients of M on X. M_o gamma is the misfit, and theta + P gamma are the structure's coefficients that come nearest
to C along the flight: what a coefficient of a simplified model means, whatever noise the sensors have. The misfit has a
Gaussian prior of one size for each axis, which maximises the flight's marginal likelihood (a discrepancy orthogonal to
the model: M. Plumlee, J. Amer. Stat. Assoc. 112, 2017; empirical Bayes), and is estimated beside all else. Where no
axis shows a misfit the estimate stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from sim_vehicle.model.aerodynamic_terms import AXES, parse_term
from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.numerics.gaussian import Gaussian
from sysid.numerics.normal_equations import solve
from sysid.output_error.estimator import OutputError, OutputErrorResult
from sysid.output_error.from_problem import build, fit, warmed
from sysid.problem.estimation_problem import Motion, Problem, start_values
from sysid.signals.record import OUTPUTS, SURFACES, Record

# Twice the log likelihood that a misfit of one axis must gain: of axes without any 0.03 % do so.
_GAIN = 12.0
# Of a coefficient: an axis that changes less has no swing to be a share of.
_LEAST_SWING = 1e-6
# Parts of the misfit that the structure and the other parts leave less of than this are no parts of their own.
_SMALL_PART = 1e-3
# Share of a part's information that is rounding.
_ROUNDING = 1e-11
_EM_STEPS, _EM_TOLERANCE = 300, 2e-3
_LONGITUDINAL = ("alpha", "alpha2", "alpha3", "alpha4", "q", "alpha_q", "de", "alpha_de", "alpha2_de", "de2", "de3")
_LATERAL = ("beta", "beta3", "p", "r", "da", "dr")
# Terms of both motions, where both are flown.
_OF_SIDESLIP = ("beta2",)
_OVER_ALPHA = tuple(f"{power}_{name}" for power in ("alpha", "alpha2") for name in ("beta", "p", "r", "da", "dr"))


@dataclass(frozen=True)
class _AxisTerms:
    """One axis: its terms in the structure and the further ones, K of them.

    projection: (terms, K) P. root: (K, K) upper triangular; root @ gamma are K numbers whose square sum is the mean
    square of the misfit. swing, size: root mean square by which the coefficient of the axis changes along the flight,
    and of all of it.
    """

    name: str
    own: tuple[str, ...]
    further: tuple[str, ...]
    projection: Array
    root: Array
    swing: float
    size: float


@dataclass(frozen=True)
class WithExtraTerms:
    """An estimation problem with further terms, and how its estimate becomes one of the structure.

    problem, model, coefficients: with the further terms. result: its estimate. axes: those with a misfit. shown: names
    of those of them whose misfit the flight shows by itself.
    """

    problem: Problem
    model: Model
    coefficients: tuple[str, ...]
    result: OutputErrorResult
    axes: tuple[_AxisTerms, ...]
    shown: tuple[str, ...]

    def projected(self, result: OutputErrorResult) -> OutputErrorResult:
        """An estimate of the wider problem in terms of the structure: coefficients nearest to it along the flight."""
        names = [parameter.name for parameter in result.parameters]
        further = {name for axis in self.axes for name in axis.further}
        kept = [i for i in range(result.theta.size) if i >= len(names) or names[i] not in further]
        turn = np.eye(result.theta.size)
        for axis in self.axes:
            rows, columns = ([names.index(name) for name in part] for part in (axis.own, axis.further))
            turn[np.ix_(rows, columns)] = axis.projection
        turn = turn[kept]
        return replace(
            result,
            parameters=tuple(parameter for parameter in result.parameters if parameter.name not in further),
            theta=turn @ result.theta,
            covariance=turn @ result.covariance @ turn.T,
            covariance_white=turn @ result.covariance_white @ turn.T,
        )

    def projected_changes(self, changes: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
        """Changes of the wider estimate (parameter -> cause -> change) as changes of the structure's coefficients."""
        further = {name for axis in self.axes for name in axis.further}
        found = {name: dict(causes) for name, causes in changes.items() if name not in further}
        for axis in self.axes:
            for i, own in enumerate(axis.own):
                for j, name in enumerate(axis.further):
                    for cause, change in changes[name].items():
                        found[own][cause] += float(axis.projection[i, j]) * change
        return found

    @property
    def share(self) -> float:
        """Largest share of an axis' coefficient that the structure does not hold, of the axes that show it."""
        parts = [(axis, self._parts(axis)) for axis in self.axes if axis.name in self.shown]
        return max((float(np.linalg.norm(one)) / max(axis.size, _LEAST_SWING) for axis, one in parts), default=0.0)

    def _parts(self, axis: _AxisTerms) -> Array:
        values = {p.name: float(v) for p, v in zip(self.result.parameters, self.result.theta, strict=False)}
        return np.asarray(axis.root @ np.array([values[name] for name in axis.further]))

    def warning(self) -> str:
        """What was found, in words."""
        found = []
        for axis in self.axes:
            parts = self._parts(axis)
            like = axis.further[int(np.argmax((axis.root.T @ parts) ** 2 / np.sum(axis.root**2, axis=0)))]
            if axis.name in self.shown:
                found.append(f"{np.linalg.norm(parts):.1e} rms of {axis.name} (most like {like})")
        return (
            f"the flight shows what the structure does not hold: {', '.join(found)}; the coefficients are those "
            "nearest along this flight, and their errors count it; --structure can add terms"
        )


def widened(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    result: OutputErrorResult,
) -> WithExtraTerms | None:
    """The problem with the misfit that its flights show, estimated; None where they show none.

    problem, model, coefficients, effects: as they were given to `fit`, which gave `result`.
    Raises EstimationError where they show one that cannot be estimated beside the rest.
    """
    start = warmed(problem, result)
    values = {parameter.name: float(v) for parameter, v in zip(result.parameters, result.theta, strict=False)}
    estimation = build(start, model, coefficients, effects, result.sigma)
    axes = _axes(start.motion, _along(start, estimation, coefficients, result), coefficients, result)
    sizes, shown = _sizes(start, model, coefficients, effects, result, axes, values)
    if not shown:
        return None
    found = tuple(axis for axis in axes if sizes[axis.name] > 0.0)
    further = tuple(name for axis in found for name in axis.further)
    wider = replace(start, known=_joined(start.known, [(axis, sizes[axis.name]) for axis in found]))
    extended = _extended(model, further)
    names = (*coefficients, *further)
    estimate = fit(wider, extended, names, effects, values | dict.fromkeys(further, 0.0))
    if not estimate.converged:
        raise EstimationError("the misfit's size does not settle")
    # The motion of the wider estimate is the one flown, and nearest means along that.
    along = _along(wider, build(wider, extended, names, effects, estimate.sigma), names, estimate)
    nearest = tuple(_nearest(axis.name, axis.own, axis.further, along, axis.swing, axis.size) for axis in found)
    return WithExtraTerms(wider, extended, names, estimate, nearest, shown)


def _extended(model: Model, further: Sequence[str]) -> Model:
    return replace(model, coefficients={**model.coefficients, **{name: Coefficient(0.0) for name in further}})


def _joined(known: Gaussian | None, misfit: Sequence[tuple[_AxisTerms, float]]) -> Gaussian:
    """What was known before, and the misfit's prior: root @ gamma independent, of one variance for each axis."""
    blocks, names, means = [], [], []
    if known is not None:
        blocks, names, means = [known.covariance], [*known.names], [known.mean]
    for axis, variance in misfit:
        inverse = linalg.solve_triangular(axis.root, np.eye(len(axis.further)))
        blocks.append(variance * inverse @ inverse.T)
        names += axis.further
        means.append(np.zeros(len(axis.further)))
    return Gaussian(tuple(names), np.concatenate(means), linalg.block_diag(*blocks))


def _further_terms(axis: str, motion: Motion) -> list[str]:
    """Terms that the aerodynamics of an axis may have, by the symmetry of the airframe."""
    both = motion.longitudinal and motion.lateral
    if axis in ("CL", "CD", "Cm"):
        terms: tuple[str, ...] = (*_LONGITUDINAL, *(_OF_SIDESLIP if both else ()))
    else:
        terms = (*_LATERAL, *(_OVER_ALPHA if both else ()))
    return [name for term in terms if motion.takes(name := f"{axis}_{term}")]


def _along(
    problem: Problem,
    estimation: OutputError,
    coefficients: Sequence[str],
    result: OutputErrorResult,
) -> dict[str, Array]:
    """(N,) of every regressor along the estimated motion of all records."""
    flat, _ = estimation.predictor.apply(result.theta)
    lift = {name: result.value(name) for name in coefficients if parse_term(name).axis == "CL"}
    parts = []
    for index, record in enumerate(problem.records):
        states = estimation.predictor.initial_states(index, result.theta, estimation.guesses[index])
        motion = estimation.predictor.outputs(index, flat, {}, states)
        # A command acts from its sample on, and the reading of a sample shows it or the one before.
        late = 0 if problem.command_first else 1
        parts.append(_regressors(record, motion, problem.vehicle, lift, late))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _axes(
    motion: Motion, along: Mapping[str, Array], coefficients: Sequence[str], result: OutputErrorResult
) -> list[_AxisTerms]:
    """Every axis with those further terms that are parts of their own."""
    found = []
    for name in AXES:
        own = tuple(term for term in coefficients if parse_term(term).axis == name)
        further = [term for term in _further_terms(name, motion) if term not in own]
        if not own or not further:
            continue
        M = _products(further, along)
        sizes = np.sqrt(np.mean(M**2, axis=0))
        moving = np.nonzero(sizes > 0.0)[0]
        outside = (M[:, moving] - _products(own, along) @ _projection(own, M[:, moving], along)) / sizes[moving]
        _, triangle, order = linalg.qr(outside, mode="economic", pivoting=True)
        kept = np.sort(order[np.abs(np.diag(triangle)) > _SMALL_PART * np.sqrt(len(M))])
        if kept.size:
            path = _products(own, along) @ np.array([result.value(term) for term in own])
            swing, size = float(np.std(path)), float(np.sqrt(np.mean(path**2)))
            found.append(_nearest(name, own, tuple(further[i] for i in moving[kept]), along, swing, size))
    return found


def _nearest(
    name: str, own: tuple[str, ...], further: tuple[str, ...], along: Mapping[str, Array], swing: float, size: float
) -> _AxisTerms:
    """The axis with what its further terms are along a motion."""
    M = _products(further, along)
    projection = _projection(own, M, along)
    root = np.linalg.qr(M - _products(own, along) @ projection, mode="r") / np.sqrt(len(M))
    return _AxisTerms(name, own, further, projection, root, swing, size)


def _projection(own: Sequence[str], M: Array, along: Mapping[str, Array]) -> Array:
    """Least-squares coefficients of the columns of M on the terms `own`."""
    X = _products(own, along)
    scale = np.maximum(np.sqrt(np.mean(X**2, axis=0)), 1e-300)
    return np.asarray(np.linalg.lstsq(X / scale, M, rcond=None)[0] / scale[:, None])


def _products(names: Sequence[str], along: Mapping[str, Array]) -> Array:
    """(N, terms) regressors of terms."""
    ones = np.ones_like(along["alpha"])
    return np.stack([np.prod([ones, *(along[f] for f in parse_term(name).factors)], axis=0) for name in names], axis=1)


def _regressors(
    record: Record, motion: Array, vehicle: Vehicle, lift: Mapping[str, float], late: int
) -> dict[str, Array]:
    """(N,) of every regressor along a simulated motion (N, 15) as sensors without errors read it.

    lift: the terms of CL. late: samples by which commands act late.
    """
    read = {name: motion[:, j] for j, name in enumerate(OUTPUTS)}
    speed, p, q, r = (read[name] for name in ("airspeed", "p", "q", "r"))
    b, c = vehicle.geometry.b, vehicle.geometry.c
    vane, flank = vehicle.sensors.alpha_vane.position, vehicle.sensors.beta_vane.position
    alpha = read["alpha"] + (vane[0] * q - vane[1] * p) / speed
    acting = np.arange(record.start, record.start + record.length) - late
    commands = record.commands[np.clip(acting, 0, len(record.commands) - 1)]
    along = {
        "alpha": alpha,
        "alphadot": np.gradient(alpha, record.interval_s) * c / (2.0 * speed),
        "beta": read["beta"] - (flank[0] * r - flank[2] * p) / speed,
        "p": p * b / (2.0 * speed),
        "q": q * c / (2.0 * speed),
        "r": r * b / (2.0 * speed),
        **{name: commands[:, j] for j, name in enumerate((*SURFACES, "throttle", *record.named))},
    }
    along["CL"] = _products(list(lift), along) @ np.array(list(lift.values())) if lift else np.zeros(record.length)
    return along


def _sizes(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    result: OutputErrorResult,
    axes: Sequence[_AxisTerms],
    values: Mapping[str, float],
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Variance of each part of an axis's misfit, by axis, and the axes that show theirs."""
    if not axes:
        return {}, ()
    further = [name for axis in axes for name in axis.further]
    whole = replace(problem, known=_joined(problem.known, [(axis, 1.0) for axis in axes]))
    estimation = build(whole, _extended(model, further), (*coefficients, *further), effects, result.sigma)
    start = start_values(problem, model, coefficients, effects) | dict(values)
    theta = estimation.start(start | dict.fromkeys(further, 0.0))
    predicted = estimation.predict(theta)
    residuals = estimation.residuals(predicted)
    information, downhill = estimation.normal_equations(
        theta, residuals, estimation.sensitivities(theta, predicted), result.sigma
    )
    names = [parameter.name for parameter in estimation.predictor.parameters]
    places = np.array([names.index(name) for name in further])
    # In parts of unit size outside the structure: theta - P gamma and root gamma in place of theta and gamma.
    turn = np.eye(theta.size)
    for axis in axes:
        rows, columns = ([names.index(name) for name in part] for part in (axis.own, axis.further))
        inverse = linalg.solve_triangular(axis.root, np.eye(len(columns)))
        turn[np.ix_(columns, columns)] = inverse
        turn[np.ix_(rows, columns)] = -axis.projection @ inverse
    information, downhill = turn.T @ information @ turn, turn.T @ downhill
    # The prior that `whole` has, of unit variance, is no information of the flight.
    information[places, places] -= 1.0
    others = np.setdiff1d(np.arange(theta.size), places)
    seen, pull = _reduced(information, downhill, others, places)
    owner = np.concatenate([np.full(len(axis.further), i) for i, axis in enumerate(axes)])
    variances, gains = _likeliest_variances(seen, pull, owner)
    shown = [axis for axis, gain in zip(axes, gains, strict=True) if gain > _GAIN]
    sizes = {axis.name: float(v) for axis, v in zip(axes, variances, strict=True)}
    if shown:
        # What is hidden in the noise of one axis is taken to be as large a part of it as of those that show theirs.
        # An axis that hardly changes has no measure of that.
        moving = [axis for axis in shown if axis.swing > _LEAST_SWING]
        shares = [min(sizes[axis.name] * len(axis.further) / axis.swing**2, 1.0) for axis in moving]
        share = float(np.exp(np.mean(np.log(shares)))) if shares else 0.0
        for axis in axes:
            if axis not in shown:
                sizes[axis.name] = max(sizes[axis.name], share * axis.swing**2 / len(axis.further))
    return sizes, tuple(axis.name for axis in shown)


def _reduced(information: Array, downhill: Array, others: Array, places: Array) -> tuple[Array, Array]:
    """Information and gradient of the unknowns `places`, the `others` being estimated beside them."""
    inner = information[np.ix_(others, others)]
    cross = information[np.ix_(others, places)]
    beside = solve(inner, cross)
    seen = information[np.ix_(places, places)] - cross.T @ beside
    pull = downhill[places] - beside.T @ downhill[others]
    # Directions of which the others leave nothing but rounding are not seen at all, or that would be their evidence.
    scale = np.sqrt(np.maximum(np.diag(information)[places], 1e-300))
    size, ways = np.linalg.eigh(0.5 * (seen + seen.T) / np.outer(scale, scale))
    kept = ways[:, size > _ROUNDING]
    return (
        (kept * size[size > _ROUNDING] @ kept.T) * np.outer(scale, scale),
        scale * (kept @ (kept.T @ (pull / scale))),
    )


def _likeliest_variances(seen: Array, pull: Array, owner: Array) -> tuple[Array, Array]:
    """Variance of the parts of each axis by the greatest marginal likelihood, and twice what each axis's gains.

    seen, pull: information of the parts and their gradient. owner: (K,) axis of each part.
    """
    count = int(owner.max()) + 1
    known = np.array([np.trace(seen[np.ix_(owner == a, owner == a)]) / np.sum(owner == a) for a in range(count)])
    variances = 1.0 / np.maximum(known, 1e-300)
    for _ in range(_EM_STEPS):
        root = np.sqrt(variances[owner])
        spread = root[:, None] * np.linalg.inv(np.eye(owner.size) + root[:, None] * seen * root) * root
        moment = (spread @ pull) ** 2 + np.diag(spread)
        before, variances = variances, np.array([moment[owner == a].mean() for a in range(count)])
        if np.all(np.abs(variances - before) < _EM_TOLERANCE * before):
            break
    best = _marginal(seen, pull, variances[owner])
    without = [_marginal(seen, pull, np.where(owner == a, 0.0, variances[owner])) for a in range(count)]
    return variances, 2.0 * (best - np.array(without))


def _marginal(seen: Array, pull: Array, variance: Array) -> float:
    """Log marginal likelihood of parts with the variances (K,), over that of none."""
    root = np.sqrt(variance)
    lower = np.linalg.cholesky(np.eye(root.size) + root[:, None] * seen * root)
    white = linalg.solve_triangular(lower, root * pull, lower=True)
    return float(0.5 * white @ white - np.log(np.diag(lower)).sum())
