"""What has changed an aircraft: physical causes, each with what it does to all axes at once.

A cause changes coefficients along directions that hang on their own values: half an elevator takes half of every term
in de, a centre of gravity that moved changes both stabilities by force derivatives times an arm, a surface that sticks
takes its terms away and leaves a constant. From the equations since the change least squares estimates, with a prior on
each size, what explains that which the coefficients known before leave, of all axes together; causes are weighed by
their evidence, tempered, since samples follow one another.
Sources: M. Basseville & I. V. Nikiforov, "Detection of Abrupt Changes", 1993, section 7.2 (signatures); for a tailplane
Etkin & Reid, "Dynamics of Flight", 1996, section 5.3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.icing import HEAVY_COAT
from sysid.arrays import Array
from sysid.numerics.normal_equations import inverse

Values = Mapping[str, float]
Direction = dict[str, float]

# Samples of equations so many of which count as one, for they follow one another and the model is not exact.
_TEMPER = 6.0
# Linkages and servos fail more often than what they move is torn off.
_OFTEN = 4.0
# What is lost of a part is between nothing and all of it.
_LOST = (0.0, 1.0)
_TAIL_STIFFNESS = 0.1  # of damping in pitch, what a tailplane gives of stability


@dataclass(frozen=True)
class Lengths:
    """Span and chord, m."""

    span: float
    chord: float


@dataclass(frozen=True)
class Cause:
    """name: in words. short: for a text of 50 characters. directions: by values of the coefficients and the lengths, of
    each size the change of the coefficients that a size of 1 is. std: of each size before, 1 sigma. fixed: a change
    that goes with it whatever its sizes. often: how often it happens beside others. shown: the first size as a person
    reads it, in `unit`. possible: first sizes that there are. sensor: the signal that reads wrong, where the aircraft
    is as it was; with a unit it reads another share of the truth, without one it is late.
    """

    name: str
    short: str
    directions: Callable[[Values, Lengths], Sequence[Direction]]
    std: tuple[float, ...]
    shown: Callable[[float], float]
    unit: str
    fixed: Callable[[Values, Lengths], Direction] = lambda values, lengths: {}
    often: float = 1.0
    possible: tuple[float, float] = (-np.inf, np.inf)
    sensor: str = ""


@dataclass(frozen=True)
class CauseFound:
    """A cause, its probability among all, its first size as `shown`, and the standard error of that."""

    cause: Cause
    probability: float
    size: float
    std: float


@dataclass(frozen=True)
class KnownAxis:
    """An axis before the change: names and values (P,) of its coefficients, variance and mean of what they left."""

    names: Sequence[str]
    values: Array
    variance: float
    mean: float


@dataclass(frozen=True)
class AxisEquations:
    """An axis since the change: terms (N, P) and left side (N,)."""

    known: KnownAxis
    X: Array
    y: Array


def _less(names: Sequence[str], values: Values) -> Direction:
    return {name: -values[name] for name in names if name in values}


def _terms_of(surface: str, values: Values) -> list[str]:
    return [name for name in values if surface in parse_term(name).factors]


def _weak(surface: str) -> Callable[[Values, Lengths], Sequence[Direction]]:
    return lambda values, lengths: [_less(_terms_of(surface, values), values)]


def _lost(surface: str) -> Callable[[Values, Lengths], Direction]:
    return lambda values, lengths: _less(_terms_of(surface, values), values)


def _stands(surface: str) -> Callable[[Values, Lengths], Sequence[Direction]]:
    """What a surface that stands at 1 rad leaves at rest."""

    def directions(values: Values, lengths: Lengths) -> Sequence[Direction]:
        own = {f"{axis}_0": values.get(f"{axis}_{surface}", 0.0) for axis in ("CL", "CY", "Cl", "Cm", "Cn")}
        return [{name: value for name, value in own.items() if value and name in values}]

    return directions


def _one_aileron(values: Values, lengths: Lengths) -> Direction:
    return {name: 0.5 * value for name, value in _lost("da")(values, lengths).items()}


def _mass(values: Values, lengths: Lengths) -> Sequence[Direction]:
    # By the mass of the vehicle file these forces seem to grow, and no moment does; drag is known beside the thrust.
    return [{name: value for name, value in values.items() if name[:2] in ("CL", "CY")}]


def _airspeed(values: Values, lengths: Lengths) -> Sequence[Direction]:
    # Size: true over measured dynamic pressure less 1. All forces and moments are off alike, and the nondimensional
    # rates, which go with the airspeed alone, by half as much the other way.
    return [{n: (0.5 if {*"pqr"} & {*parse_term(n).factors} else 1.0) * value for n, value in values.items()}]


def _vane_lag(values: Values, lengths: Lengths) -> Sequence[Direction]:
    # Size: lag times 2 V over the chord. An angle that comes late lacks the lag times its rate of change, which is the
    # pitch rate where the path is slow beside it: what hangs on the angle seems to hang on the rate.
    own = {f"{axis}_q": values.get(f"{axis}_alpha", 0.0) for axis in ("CL", "CD", "Cm")}
    return [{name: value for name, value in own.items() if value and name in values}]


def _gravity(values: Values, lengths: Lengths) -> Sequence[Direction]:
    """By a chord to the back: every force has an arm."""
    found = {f"Cm_{name[3:]}": value for name, value in values.items() if name.startswith("CL_")}
    aside = lengths.chord / lengths.span
    found |= {f"Cn_{name[3:]}": -aside * value for name, value in values.items() if name.startswith("CY_")}
    return [{name: value for name, value in found.items() if name in values}]


def _ice(values: Values, lengths: Lengths) -> Sequence[Direction]:
    return [{name: share * values[name] for name, share in HEAVY_COAT.items() if name in values}]


def _tail(values: Values, lengths: Lengths) -> Sequence[Direction]:
    lost = _less(("Cm_q", "Cm_de", "CL_de", "CL_q"), values)
    if "Cm_q" in values and "Cm_alpha" in values:
        lost["Cm_alpha"] = -_TAIL_STIFFNESS * values["Cm_q"]
    return [lost]


def _fin(values: Values, lengths: Lengths) -> Sequence[Direction]:
    return [_less(("CY_beta", "CY_r", "CY_dr", "Cl_dr", "Cn_beta", "Cn_r", "Cn_dr"), values)]


def _wing(values: Values, lengths: Lengths) -> Sequence[Direction]:
    return [_less(("Cl_p", "Cl_da", "Cl_beta"), values), _at_rest("Cl_0")(values, lengths)[0]]


def _at_rest(*names: str, shares: tuple[float, ...] = (1.0,)) -> Callable[[Values, Lengths], Sequence[Direction]]:
    return lambda values, lengths: [{name: share for name, share in zip(names, shares, strict=True) if name in values}]


def _left(size: float) -> float:
    return 100.0 * (1.0 - size)


def _degrees(size: float) -> float:
    return float(np.degrees(size))


def _read_of_true(size: float) -> float:
    return 100.0 / float(np.sqrt(max(1.0 + size, 0.01)))


def _of_one(size: float) -> float:
    return 2.0 * _degrees(size)  # one of two makes half of the moment


CAUSES: tuple[Cause, ...] = (
    Cause("the elevator", "ELEVATOR", _weak("de"), (0.6,), _left, "%", often=_OFTEN, possible=_LOST),
    Cause("the ailerons", "AILERONS", _weak("da"), (0.6,), _left, "%", often=_OFTEN, possible=_LOST),
    Cause("the rudder", "RUDDER", _weak("dr"), (0.6,), _left, "%", often=_OFTEN, possible=_LOST),
    Cause("the elevator, stuck", "ELEVATOR STUCK", _stands("de"), (0.15,), _degrees, "deg", _lost("de")),
    Cause("the ailerons, stuck", "AILERONS STUCK", _stands("da"), (0.15,), _degrees, "deg", _lost("da")),
    Cause("the rudder, stuck", "RUDDER STUCK", _stands("dr"), (0.15,), _degrees, "deg", _lost("dr")),
    Cause("one aileron", "ONE AILERON OFF", _stands("da"), (0.15,), _of_one, "deg", _one_aileron),
    Cause("the tailplane", "TAILPLANE", _tail, (0.4,), _left, "%", possible=_LOST),
    Cause("the fin", "FIN", _fin, (0.4,), _left, "%", possible=_LOST),
    Cause("a wing tip", "WING", _wing, (0.2, 0.01), _left, "%", possible=_LOST),
    Cause("ice", "ICE", _ice, (1.5,), lambda size: 100.0 * size, "% of a heavy coat"),
    # What falls off makes an aircraft lighter; nothing makes it heavier in flight, but for ice.
    Cause("the mass", "MASS", _mass, (0.2,), lambda size: 100.0 / (1.0 + size), "%", possible=(0.0, np.inf)),
    Cause("the airspeed", "AIRSPEED", _airspeed, (0.3,), _read_of_true, "% of true", possible=(-0.9, np.inf),
          sensor="airspeed"),
    Cause("the alpha vane's lag", "ALPHA VANE", _vane_lag, (15.0,), lambda size: size, "", possible=(0.0, np.inf),
          sensor="alpha"),
    Cause("the centre of gravity", "CG", _gravity, (0.1,), lambda size: 100.0 * size, "% of the chord back"),
    Cause("flaps", "FLAPS", _at_rest("CL_0", "CD_0", "Cm_0", shares=(1.0, 0.15, -0.1)), (0.2,), lambda size: size,
          "more CL"),
    Cause("something that hangs out", "DRAG", _at_rest("CD_0"), (0.03,), lambda size: size, "more CD"),
)  # fmt: skip


def likeliest(axes: Sequence[AxisEquations], lengths: Lengths) -> list[CauseFound]:
    """Causes by their probability, the likeliest first; each with its size. axes: all that were known."""
    values = {n: float(v) for axis in axes for n, v in zip(axis.known.names, axis.known.values, strict=True)}
    scores, found = [], []
    for cause in CAUSES:
        evidence = _evidence(cause, axes, values, lengths)
        if evidence is not None:
            score, size, std = evidence
            low, high = cause.possible
            if size + 2.0 * std < low or size - 2.0 * std > high:
                continue
            shown = cause.shown(size)
            scores.append(score + float(np.log(cause.often)))
            found.append((cause, shown, abs(cause.shown(size + std) - shown)))
    if not found:
        return []
    shares = np.exp(np.array(scores) - max(scores))
    shares /= shares.sum()
    every = [CauseFound(one, float(p), size, std) for p, (one, size, std) in zip(shares, found, strict=True)]
    return sorted(every, key=lambda one: -one.probability)


def _evidence(
    cause: Cause, axes: Sequence[AxisEquations], values: Values, lengths: Lengths
) -> tuple[float, float, float] | None:
    """Log evidence over that of no change, the first size and its standard error; None where no axis shows it."""
    fixed, directions = cause.fixed(values, lengths), cause.directions(values, lengths)
    count = len(directions)
    A, b, gain = np.diag(1.0 / np.array(cause.std) ** 2), np.zeros(count), 0.0
    seen = False
    for axis in axes:
        names, weight = axis.known.names, 1.0 / (_TEMPER * axis.known.variance)
        D = np.array([[one.get(name, 0.0) for one in directions] for name in names]).reshape(len(names), count)
        d = np.array([fixed.get(name, 0.0) for name in names])
        if not (D.any() or d.any()) or axis.X.shape[0] < 2:
            continue
        seen = True
        e = axis.y - axis.X @ axis.known.values - axis.known.mean
        left, x = e - axis.X @ d, axis.X @ D
        gain += weight * float(e @ e - left @ left)
        A, b = A + weight * x.T @ x, b + weight * x.T @ left
    if not seen:
        return None
    covariance = inverse(A)
    size = covariance @ b
    prior = float(np.sum(np.log(np.array(cause.std) ** 2)))
    evidence = 0.5 * (gain + float(b @ size) - float(np.linalg.slogdet(A)[1]) - prior)
    return evidence, float(size[0]), float(np.sqrt(covariance[0, 0]))
