"""What a flight can tell of a hidden effect at all, by the truth: whether it stands out, and from which others.

The outputs' answers to the effect, to each impostor and to everything else that is unknown are whitened (sensor noise;
in turbulence by a Kalman filter with the gusts as process noise), and the effect's answer is freed of all that the
others can imitate with free amplitudes. What is left is the likelihood ratio of an efficient test, in sigma.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from discrepancy_cases import (
    GUST_LENGTH_M,
    KINDS,
    Case,
    fly_calm,
    off_by_values,
    structure,
    the_vehicle,
    true_model,
)
from effect_responses import (
    OUTER,
    impostor_columns,
    impostors,
    neutral,
    parameter_slopes,
    read_inputs,
    whole_response,
)
from flight_bounds import INPUTS, LATERAL_OUTPUTS, LONGITUDINAL_OUTPUTS, Array, Experiment, Slopes, slopes
from gust_bounds import gust_model, linear_path, whitened

from sim_vehicle.effects import EFFECTS
from sim_vehicle.model.aerodynamic_terms import AXES
from sim_vehicle.model.model_file import Model

# Sensor errors that are unknown in every flight, and what a bench calibration leaves of the airspeed.
ERRORS = (
    "accel_bias_x", "accel_bias_y", "accel_bias_z", "gyro_bias_p", "gyro_bias_q", "gyro_bias_r", "alpha_scale",
    "alpha_bias", "beta_scale", "beta_bias", "airspeed_scale", "airspeed_bias",
)  # fmt: skip
BENCH = {"airspeed_bias": 0.02, "airspeed_scale": 0.002}
STANDS_OUT = 5.0
# Nuisances of every flight, which to name is no mistake where they are.
AIR = ("steady_wind", "turbulence")
# Columns of which less than this is left are imitated by the others: what is left is the differences' own error.
_IMITATED = 1e-5


@dataclass(frozen=True)
class Told:
    """What a flight tells of one effect.

    detect: sigma by which it stands out. separate: impostor -> sigma by which it can be told from that one.
    bounds: parameter -> smallest standard deviation, the effect being known to be there.
    """

    detect: float
    separate: Mapping[str, float]
    bounds: Mapping[str, float]


def basis_of(columns: Array) -> Array:
    """Orthonormal columns (M, r) that span the given ones (M, n); columns of zeros span nothing."""
    size = np.linalg.norm(columns, axis=0)
    used = columns[:, size > 0.0] / size[size > 0.0]
    if used.shape[1] == 0:
        return used
    left, values, _ = np.linalg.svd(used, full_matrices=False)
    return np.asarray(left[:, values > 1e-9 * values[0]])


def remainder(columns: Array, basis: Array) -> Array:
    """The columns (M, k) less what an orthonormal basis (M, r) can imitate."""
    found = columns - basis @ (basis.T @ columns)
    found = found - basis @ (basis.T @ found)
    small = np.linalg.norm(found, axis=0) < _IMITATED * np.linalg.norm(columns, axis=0)
    return np.where(small, 0.0, found)


def separations(
    hidden: Array, imitators: Mapping[str, Sequence[Array]], nuisances: Array
) -> tuple[float, dict[str, float]]:
    """Sigma by which the hidden answer (M,) stands out of the nuisances (M, n), and out of those and each imitator.

    imitators: name -> its columns (M, k), one array for each size from which it may start; the likeliest counts.
    """
    basis = basis_of(nuisances)
    clear = remainder(hidden[:, None], basis)
    separate = {
        name: min(float(np.linalg.norm(remainder(clear, basis_of(remainder(start, basis))))) for start in starts)
        for name, starts in imitators.items()
    }
    return float(np.linalg.norm(clear)), separate


def smallest_stds(parameters: Mapping[str, Array], nuisances: Array) -> dict[str, float]:
    """Cramer-Rao bounds of parameters, each with its answer per unit (M,), beside the nuisances (M, n)."""
    if not parameters:
        return {}
    free = remainder(np.stack(list(parameters.values()), axis=1), basis_of(nuisances))
    size = np.linalg.norm(free, axis=0)
    if not np.all(size > 0.0):
        return {}
    covariance = np.linalg.pinv((free / size).T @ (free / size), rcond=1e-12)
    return {name: float(np.sqrt(covariance[i, i]) / size[i]) for i, name in enumerate(parameters)}


class Whitener:
    """Answers of the outputs as independent rows of unit variance, what was known before appended."""

    def __init__(self, experiment: Experiment, base: Slopes, gust: float) -> None:
        self.base, self.gust = base, gust
        self._path = linear_path(experiment) if gust else None
        dt = float(experiment.flown.time_s[1] - experiment.flown.time_s[0])
        self._gusts = gust_model(gust, GUST_LENGTH_M, experiment.vehicle.flight.airspeed, dt) if gust else None

    def rows(self, values: Array, prior: Array) -> Array:
        """values: (N, outputs, P) answers; prior: (R, P) rows known before. Returns (M, P)."""
        told = Slopes(("",) * values.shape[2], values, self.base.sigma, np.zeros((values.shape[2],) * 2))
        if self._path is None or self._gusts is None:
            white = (values / told.sigma[:, :, None]).reshape(-1, values.shape[2])
        else:
            white = np.concatenate(list(whitened(told, self._path, self._gusts)))
        return np.concatenate([white, prior])


def _prior_rows(base: Slopes, kept: Sequence[int], priors: Mapping[str, float]) -> Array:
    """Rows (R, P) whose squares are what is known of the kept unknowns beforehand."""
    information = base.prior[np.ix_(kept, kept)].copy()
    for name, std in priors.items():
        place = [base.names[i] for i in kept].index(name)
        information[place, place] += 1.0 / std**2
    values, vectors = np.linalg.eigh(information)
    used = values > 1e-12 * max(float(values[-1]), 1e-300)
    return np.asarray((vectors[:, used] * np.sqrt(values[used])).T)


@dataclass(frozen=True)
class Point:
    """A model at which the outputs' answers are taken, and those to all that the job does not know (N, outputs, P)."""

    experiment: Experiment
    base: Slopes
    nuisances: Array
    prior: Array
    whitener: Whitener

    def white(self, columns: Array) -> Array:
        """Whitened answers (M, P) to what nothing was known of before."""
        clean = np.nan_to_num(columns, nan=0.0, posinf=0.0, neginf=0.0)
        return self.whitener.rows(clean, np.zeros((self.prior.shape[0], columns.shape[2])))

    @cached_property
    def white_nuisances(self) -> Array:
        """The same (M, P) to the nuisances, with what was known of them."""
        extra = np.zeros((self.prior.shape[0], self.nuisances.shape[2] - self.prior.shape[1]))
        return self.whitener.rows(np.nan_to_num(self.nuisances), np.hstack([self.prior, extra]))

    @cached_property
    def imitators(self) -> dict[str, list[Array]]:
        """Of every effect that the model lacks, whitened answers (M, k), one for each size from which it may start."""
        owners, parts = [], []
        for name in impostors(self.experiment.model):
            for part in impostor_columns(self.experiment, name):
                owners.append(name)
                parts.append(part)
        ends = np.cumsum([part.shape[2] for part in parts])
        pieces = np.split(self.white(np.concatenate(parts, axis=2)), ends[:-1], axis=1)
        found: dict[str, list[Array]] = {}
        for name, piece in zip(owners, pieces, strict=True):
            found.setdefault(name, []).append(piece)
        return found


# Effects that are no coefficients share the model without them, and so all that can be told at it.
_POINTS: dict[tuple[str, float, str], Point] = {}
_KEPT = 2


def point_at(case: Case, model: Model, known: Collection[str] = ()) -> Point:
    """The case's flight to fit, flown in still air by `model`. known: coefficients that are not among the nuisances."""
    lag_hidden = any(name == "actuator_lag" for name, _ in case.effects)
    key = case.kind, case.gust, json.dumps([model.to_json(), sorted(known), lag_hidden])
    if key not in _POINTS:
        while len(_POINTS) >= _KEPT:
            _POINTS.pop(next(iter(_POINTS)))
        _POINTS[key] = _point(case, model, known, lag_hidden)
    return _POINTS[key]


def _point(case: Case, model: Model, known: Collection[str], lag_hidden: bool) -> Point:
    vehicle = the_vehicle()
    thrust = "thrust" not in KINDS[case.kind].without
    flown = read_inputs(fly_calm(case, vehicle, model), model, thrust=thrust)
    experiment = Experiment(flown, vehicle, model, (*LONGITUDINAL_OUTPUTS, *LATERAL_OUTPUTS), lateral=True)
    base = slopes(experiment)
    kept = [i for i, name in enumerate(base.names) if _unknown(name) and name not in known]
    columns = [base.values[:, :, kept]]
    if not lag_hidden:
        tau = model.effect("actuator_lag") or {}
        columns.append(parameter_slopes(experiment, "actuator_lag", tau)["tau"][:, :, None])
    prior = _prior_rows(base, kept, BENCH)
    return Point(experiment, base, np.concatenate(columns, axis=2), prior, Whitener(experiment, base, case.gust))


def tell(case: Case) -> dict[str, Told]:
    """By the name of each hidden effect, what the case's flight to fit tells of it.

    A coefficient's answers are taken at the truth, where the motion is what flies with it: damping that is not there
    yet would change far more than the damping that is. Any other effect's are taken at the model without it, where the
    whole change from nothing to its size begins. The bounds of parameters hold at the truth.
    """
    hidden = [name for name, _ in case.effects]
    true, plain = true_model(case, air=False), structure(case)
    # These act on what is put into the model, not in it: their answers are taken from outside, at the plain model.
    true = _without_outer(true)
    flies = replace(plain, coefficients=true.coefficients)
    own = {p.name for name in hidden if EFFECTS[name].is_coefficient for p in EFFECTS[name].parameters}
    here = point_at(case, flies, own)
    imitators = {name: starts for name, starts in here.imitators.items() if name not in hidden}
    wholes, apart = _answers(here, case, plain)
    there = point_at(case, true, own)
    _, at_truth = _answers(there, case, plain)
    found = {}
    for name in hidden:
        nuisances = np.hstack([here.white_nuisances, *_of_others(apart, name)])
        detect, separate = separations(wholes[name], imitators, nuisances)
        nuisances = np.hstack([there.white_nuisances, *_of_others(at_truth, name)])
        found[name] = Told(detect, separate, smallest_stds(at_truth[name], nuisances))
    return found


def _without_outer(model: Model) -> Model:
    return replace(model, effects=tuple(effect for effect in model.effects if effect.name not in OUTER))


def _answers(point: Point, case: Case, plain: Model) -> tuple[dict[str, Array], dict[str, dict[str, Array]]]:
    """Whitened answers (M,) to each hidden effect as it is, and to each of its parameters per unit."""
    names: list[tuple[str, str]] = []
    columns = []
    for effect, values in case.values().items():
        names.append((effect, ""))
        columns.append(whole_response(point.experiment, effect, values))
        every = {**neutral(effect, plain), **values}
        for parameter, slope in parameter_slopes(point.experiment, effect, every).items():
            names.append((effect, parameter))
            columns.append(slope)
    white = point.white(np.stack(columns, axis=2))
    wholes = {effect: white[:, i] for i, (effect, parameter) in enumerate(names) if not parameter}
    apart: dict[str, dict[str, Array]] = {effect: {} for effect in wholes}
    for i, (effect, parameter) in enumerate(names):
        if parameter:
            apart[effect][parameter] = white[:, i]
    return wholes, apart


def _of_others(apart: Mapping[str, Mapping[str, Array]], name: str) -> list[Array]:
    return [column[:, None] for other, found in apart.items() if other != name for column in found.values()]


def _unknown(name: str) -> bool:
    """Whether one of the bound's unknowns is unknown to the job: it does not doubt attitude."""
    return name in ERRORS or name.startswith(INPUTS) or name.split("_")[0] in AXES


def error_sigma(case: Case) -> float:
    """Sigma by which the baseline's wrong coefficients stand out where nothing else is wrong."""
    point = point_at(case, structure(case))
    errors = off_by_values(case)
    wrong = [point.base.names.index(name) for name in errors]
    answer = point.base.values[:, :, wrong] @ np.array(list(errors.values()))
    rest = [i for i, name in enumerate(point.base.names) if _unknown(name) and name not in errors]
    prior = _prior_rows(point.base, rest, BENCH)
    others = point.whitener.rows(point.base.values[:, :, rest], prior)
    return float(np.linalg.norm(remainder(point.white(answer[:, :, None]), basis_of(others))))


class Truths:
    """What the flights tell, by effect, size, kind of flight and turbulence; kept in a file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._known: dict[str, dict[str, Any]] = {}
        if path.exists():
            for text in path.read_text(encoding="utf-8").splitlines():
                try:
                    line = json.loads(text)
                except json.JSONDecodeError:
                    continue
                self._known[line["key"]] = line

    def of(self, case: Case) -> dict[str, Any]:
        """{"effects": name -> {"detect", "separate", "bounds"}}, or {"error_sigma"} where nothing is hidden."""
        key = case.truth_key if case.effects else case.key
        if key not in self._known:
            self._known[key] = {"key": key} | self._computed(case)
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a", encoding="utf-8") as sink:
                sink.write(json.dumps(self._known[key]) + "\n")
        return self._known[key]

    @staticmethod
    def _computed(case: Case) -> dict[str, Any]:
        if not case.effects:
            return {"error_sigma": 0.0 if case.exact else error_sigma(case)}
        if any(name in AIR for name, _ in case.effects):
            # A nuisance of every flight: nothing to be told.
            return {"effects": {name: {"detect": 0.0, "separate": {}, "bounds": {}} for name, _ in case.effects}}
        return {"effects": {name: told.__dict__ for name, told in tell(case).items()}}
