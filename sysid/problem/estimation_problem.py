"""From stretches of flight to coefficients and sensor errors: the one-step estimate and what it refuses."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Protocol

import numpy as np

from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.model_file import Coefficient, Model, ModelEffect
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.compatibility.selection import Refusal
from sysid.numerics.gaussian import Gaussian
from sysid.problem.free_parameters import FreeParameter, coefficient, effect_parameter, sensor_error, thrust_error
from sysid.problem.model_structure import (
    PRIOR_WIDTH,
    helpful_manoeuvre,
    is_longitudinal,
    not_believed,
    not_identified,
    usual_size,
)
from sysid.problem.predictor import Predictor
from sysid.signals.record import GROUND, LATERAL, LONGITUDINAL, OUTPUTS, STATES, SURFACES, Record
from sysid.signals.sensor_errors import SENSOR_ERRORS

# Longest free run between two starts: turbulence and the slow modes carry a longer one away.
MAX_RUN_S = 20.0
# A surface that moves by less than this (peak to peak) has excited nothing, rad.
QUIET_SURFACE = math.radians(0.6)
# One that moves by less than this stood still, rad.
STILL_SURFACE = math.radians(0.05)
LONGITUDINAL_STATES = ("u", "w", "q", "theta")

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Motion:
    """Which part of the motion is simulated freely; the other part's states are taken from the measurement.

    still: surfaces (of de, da, dr and controls of other names) that never moved; nothing they multiply is identifiable.
    ground: whether velocity over ground counts, with the wind unknown: where a vane is missing it determines the flow's
    direction.
    """

    longitudinal: bool
    lateral: bool
    still: frozenset[str] = frozenset()
    ground: bool = False

    @property
    def outputs(self) -> tuple[str, ...]:
        """Outputs that enter the likelihood."""
        own = (*(LONGITUDINAL if self.longitudinal else ()), *(LATERAL if self.lateral else ()))
        return (*own, *GROUND) if self.ground else own

    def takes(self, name: str) -> bool:
        """Whether a coefficient belongs to this motion."""
        if self.still & set(parse_term(name).factors):
            return False
        return self.longitudinal if is_longitudinal(name) else self.lateral


@dataclass(frozen=True)
class Problem:
    """Everything an estimation needs besides the choice of parameters.

    records: runs of at most MAX_RUN_S. guesses: per record (9,) initial states u v w p q r phi theta psi. paths: per
    record (N, 9) the same at every sample, reconstructed from the measurements.
    sensors: sensor errors to estimate, with start values. priors: sensor errors with (mean, std) known from elsewhere.
    known: coefficients and effect parameters known before the flight. thrust_errors: rows of every record's
    `thrust_doubt`, if filter error is to estimate them.
    """

    vehicle: Vehicle
    records: tuple[Record, ...]
    guesses: tuple[Array, ...]
    motion: Motion
    sensors: Mapping[str, float]
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    command_first: float = 0.0
    sub_steps: int = 2
    known: Gaussian | None = None
    paths: tuple[Array, ...] = ()
    thrust_errors: int = 0


def excited_motion(records: Sequence[Record], lost: Collection[str] = ()) -> Motion:
    """Which surfaces moved enough to be informative; longitudinal motion alone if none did.

    lost: "longitudinal" or "lateral" where a surface that steers it was not recorded; both parts may be left out then.
    """
    travel = np.max([np.ptp(record.commands[:, :3], axis=0) for record in records], axis=0)
    lateral = bool(max(travel[1], travel[2]) > QUIET_SURFACE)
    still = frozenset(name for name, moved in zip(SURFACES, travel, strict=True) if moved < STILL_SURFACE)
    for j, name in enumerate(records[0].named, 4):
        if float(np.ptp(np.concatenate([record.commands[:, j] for record in records]))) < STILL_SURFACE:
            still |= {name}
    longitudinal = (bool(travel[0] > QUIET_SURFACE) or not lateral) and "longitudinal" not in lost
    lateral = lateral and "lateral" not in lost
    wanted = (*(("alpha",) if longitudinal else ()), *(("beta",) if lateral else ()))
    ground = any(not _measured(record, wanted) and _measured(record, (*GROUND, "psi")) for record in records)
    return Motion(longitudinal, lateral, still, ground)


def _measured(record: Record, names: Sequence[str]) -> bool:
    return all(np.isfinite(record.z[:, OUTPUTS.index(name)]).any() for name in names)


def split_runs(
    record: Record, states: Mapping[str, Array], motion: Motion, run_s: float = MAX_RUN_S
) -> tuple[list[Record], list[Array]]:
    """Cut a stretch into runs of limited length, each with its reconstructed states.

    Where only a part of the motion is simulated freely, the states of the other part are imposed as reconstructed.

    Parameters
    ----------
    record : Record
        Stretch of a flight with N output samples.
    states : Mapping of str to Array, shape (N,) each
        Name of STATES -> reconstructed motion of the stretch, relative to the air: u, v, w, m/s, p, q, r, rad/s, phi,
        theta, psi, rad.
    motion : Motion
        Which part of the motion is simulated freely.
    run_s : float
        Longest duration of a run, s.

    Returns
    -------
    runs : list of Record
        Runs of at most `run_s`, one after the other.
    paths : list of Array, shape (N, 9) each
        Reconstructed STATES at the N samples of each run, in the units of `states`.
    """
    path = np.stack([states[name] for name in STATES], axis=1)
    held = np.zeros((0, 9))
    if not (motion.longitudinal and motion.lateral):
        held = np.full((record.start + record.length, 9), np.nan)
        for j, name in enumerate(STATES):
            if (name in LONGITUDINAL_STATES) != motion.longitudinal:
                held[record.start :, j] = path[:, j]
                held[: record.start, j] = path[0, j]
    record = replace(record, imposed_states=held)
    # From first to last sample: a stretch of just `run_s` is one run.
    count = max(1, math.ceil((record.length - 1) * record.interval_s / run_s - 1e-6))
    edges = np.linspace(0, record.length, count + 1).astype(int)
    runs = [record.window(int(a), int(b)) for a, b in pairwise(edges)]
    return runs, [path[int(a) : int(b)].copy() for a, b in pairwise(edges)]


def relevant_sensors(names: Sequence[str], motion: Motion) -> list[str]:
    """Those sensor errors whose output is in the likelihood."""
    return [name for name in names if name in SENSOR_ERRORS and SENSOR_ERRORS[name][0] in motion.outputs]


def free_coefficients(names: Sequence[str], motion: Motion) -> list[str]:
    """Coefficients that the motion lets one estimate."""
    return [name for name in names if motion.takes(name)]


def known_of(problem: Problem, predictor: Predictor) -> Gaussian | None:
    return None if problem.known is None else problem.known.of([entry.name for entry in predictor.parameters])


def predictor_of(
    problem: Problem, model: Model, coefficients: Sequence[str], effects: Sequence[tuple[str, str]] = ()
) -> Predictor:
    """Outputs of the problem's records as a function of those parameters that are free."""
    parameters: list[FreeParameter] = [coefficient(name, 0.0, PRIOR_WIDTH * usual_size(name)) for name in coefficients]
    parameters += [effect_parameter(effect, name) for effect, name in effects]
    for name in problem.sensors:
        entry = sensor_error(name)
        mean, std = problem.priors.get(name, (0.0, 10.0 * SENSOR_ERRORS[name][3]))
        parameters.append(replace(entry, prior_mean=mean, prior_std=std))
    parameters += [thrust_error(k) for k in range(problem.thrust_errors)]
    return Predictor(
        flatten(problem.vehicle, model),
        parameters,
        problem.records,
        command_first=problem.command_first,
        sub_steps=problem.sub_steps,
    )


def start_values(
    problem: Problem, model: Model, coefficients: Sequence[str], effects: Sequence[tuple[str, str]]
) -> dict[str, float]:
    """Where an estimation starts: the model's values, and the sensor errors of the problem."""
    values = {name: model.flown()[name] for name in coefficients}
    values |= {f"{effect}.{name}": (model.effect(effect) or {})[name] for effect, name in effects}
    return values | dict(problem.sensors)


class Estimates(Protocol):
    """Values and standard errors by name: of an estimate, or predicted."""

    def value(self, name: str) -> float:
        """Value of a parameter."""

    def std(self, name: str) -> float:
        """Standard error of a parameter."""


class Likeliest(Estimates, Protocol):
    """A maximum-likelihood estimate, whatever method found it; the parameters stand first in theta and covariance."""

    @property
    def parameters(self) -> tuple[FreeParameter, ...]:
        """What was estimated, P of them."""

    @property
    def theta(self) -> Array:
        """(P or more,) estimates."""

    @property
    def covariance(self) -> Array:
        """Their covariance."""

    @property
    def converged(self) -> bool:
        """Whether the iteration ended."""


def refusals(result: Estimates, names: Sequence[str], travel: Mapping[str, float]) -> list[Refusal]:
    """Coefficients whose standard error exceeds REFUSED_SHARE of both their own and their usual size.

    travel: what linkages have in the standard errors: a derivative is known as well as the travel of its surface.
    """
    refused = []
    for name in names:
        value, std = result.value(name), result.std(name)
        if (reason := not_identified(name, value, std, travel.get(name, 0.0))) is not None:
            refused.append(Refusal(name, reason, helpful_manoeuvre(name)))
    return refused


def unbelieved(result: Estimates, names: Sequence[str]) -> list[Refusal]:
    """Coefficients with a value that no aircraft has; the others were estimated beside it."""
    reasons = ((name, not_believed(name, result.value(name))) for name in names)
    return [Refusal(name, why, helpful_manoeuvre(name), flies=False) for name, why in reasons if why is not None]


def flying(joint: Gaussian | None, refused: Sequence[Refusal]) -> Gaussian | None:
    """What is known of coefficients that fly, those refused for want of information included."""
    grounded = {entry.name for entry in refused if not entry.flies}
    return None if joint is None else joint.of([name for name in joint.names if name not in grounded])


def coefficient_entries(
    base: Mapping[str, Coefficient], values: Mapping[str, tuple[float, float]], refused: Sequence[Refusal]
) -> dict[str, Coefficient]:
    """Entries of a model file: estimates, what is refused with what flies in its place, and what stays as it was.

    base: the entries before. values: means and standard errors of all that flies.
    """
    reasons = {entry.name: entry.reason for entry in refused}
    return {
        name: Coefficient(None, None, reasons[name], {}, *values.get(name, (None, None)))
        if name in reasons
        else Coefficient(*values[name])
        if name in values
        else old
        for name, old in base.items()
    }


def model_of(
    base: Model,
    name: str,
    result: Likeliest,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    refused: Sequence[Refusal],
    validity: Mapping[str, tuple[float, float]],
    known: Gaussian | None = None,
) -> Model:
    """Model file of an estimate: `base` with its estimated entries replaced, refused ones without a value.

    known: what was known before; coefficients that the flight did not move stay as known, updated by their
    correlations.
    """
    unknowns = [*coefficients, *(f"{effect}.{key}" for effect, key in effects)]
    joint = flying(estimated(result, unknowns), refused)
    if joint is not None and known is not None:
        joint = known.updated(joint)
    values = {} if joint is None else joint.entries()
    entries = coefficient_entries(base.coefficients, values, refused)
    model_effects = []
    for effect in base.effects:
        parameters = dict(effect.parameters)
        for key in parameters:
            if (effect.name, key) in effects:
                parameters[key] = Coefficient(*values[f"{effect.name}.{key}"])
        model_effects.append(ModelEffect(effect.name, parameters))
    return Model(name, entries, tuple(model_effects), validity, None if joint is None else joint.correlation())


def estimated(result: Likeliest, names: Sequence[str]) -> Gaussian | None:
    """Estimates of some parameters with their covariance; None without names."""
    every = [parameter.name for parameter in result.parameters]
    place = [every.index(name) for name in names]
    return Gaussian(tuple(names), result.theta[place], result.covariance[np.ix_(place, place)]) if place else None
