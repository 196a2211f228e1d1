"""A quick look at every candidate, to spare the full fit of those that explain nothing.

Two looks, since either can be blind: along the reconstructed motion (equation error), where a strong nonlinearity
cannot upset a free-running simulation; and through the output-error sensitivities, where sensor effects show too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sim_vehicle.model import Model
from sim_vehicle.parameters import flatten
from sysid.candidates import Candidate, extended
from sysid.estimate import Problem, build
from sysid.flight import Array
from sysid.gap import Fixed
from sysid.output_error import OutputErrorResult, autocorrelation
from sysid.parameterisation import STATES
from sysid.prepare import Prepared, smoothed_states
from sysid.records import Record
from sysid.residuals import CUTOFF_HZ, along_path, measured_accelerations
from sysid.smoothing import fourier_smooth
from sysid.structure import usual_size


class PathScreen:
    """Accelerations along the reconstructed motion, measured and as a model gives them.

    flights: stretches with all IMU, airspeed and attitude samples. errors: sensor errors to take off.
    """

    def __init__(self, problem: Problem, flights: Sequence[Prepared], errors: Mapping[str, float]) -> None:
        self.problem, self.errors = problem, dict(errors)
        self.records: list[Record] = []
        self.paths: list[Array] = []
        measured = []
        for flight in flights:
            for stretch in flight.stretches:
                states = smoothed_states(stretch.record, flight.layout, self.errors)
                self.records.append(stretch.record)
                self.paths.append(np.stack([states[name] for name in STATES], axis=1))
                found = measured_accelerations(stretch.record, states, problem.vehicle, self.errors)
                measured.append(self._band(found, stretch.record.interval_s))
        motion = problem.motion
        self.axes = [i for i in range(6) if (motion.longitudinal if i in (0, 2, 4) else motion.lateral)]
        self.measured = np.concatenate(measured)

    @staticmethod
    def _band(values: Array, interval_s: float) -> Array:
        return np.column_stack([fourier_smooth(column, interval_s, CUTOFF_HZ).values for column in values.T])

    def predict(self, model: Model) -> Array:
        """(N, 6) ax ay az p' q' r' of a model in the band of the measurement, all stretches joined."""
        fixed = Fixed(flatten(self.problem.vehicle, model), self.errors, self.problem.command_first)
        return np.concatenate(
            [
                self._band(along_path(record, path, fixed)[:, 6:], record.interval_s)
                for record, path in zip(self.records, self.paths, strict=True)
            ]
        )

    def gains(
        self, model: Model, coefficients: Sequence[str], choices: Sequence[Candidate]
    ) -> list[tuple[float, dict[str, float]]]:
        """Likelihood gain of every candidate over the model with its coefficients fitted again, and the start."""
        base = self.predict(model)
        design = []
        for name in coefficients:
            step = 0.05 * usual_size(name)
            changed = self.predict(model.with_coefficient(name, model.values()[name] + step))
            design.append((changed - base) / step)
        residual = self.measured - base
        # One row per sample and axis, each axis weighted by what the coefficients leave over.
        X = np.stack(design, axis=2)
        free = np.concatenate([residual[:, i] for i in self.axes])
        wide = np.concatenate([X[:, i, :] for i in self.axes])
        length = residual.shape[0]
        weight = np.repeat([1.0 / max(float(np.std(residual[:, i])), 1e-9) for i in self.axes], length)
        for _ in range(2):
            weighted = wide * weight[:, None]
            left = free - wide @ np.linalg.lstsq(weighted, free * weight, rcond=None)[0]
            parts = np.split(left, len(self.axes))
            spread = [float(np.std(p)) * float(np.sqrt(max(np.sum(autocorrelation([p])), 1.0))) for p in parts]
            weight = np.repeat([1.0 / max(value, 1e-9) for value in spread], length)
        basis, _ = np.linalg.qr(wide * weight[:, None])
        target = free * weight
        target = target - basis @ (basis.T @ target)
        return [self._best_start(model, candidate, base, basis, weight, target) for candidate in choices]

    def _best_start(
        self, model: Model, candidate: Candidate, base: Array, basis: Array, weight: Array, target: Array
    ) -> tuple[float, dict[str, float]]:
        best = (0.0, dict(candidate.starts[0]))
        for start in candidate.starts:
            directions = []
            for name in candidate.free:
                changed = self.predict(extended(model, candidate, off_neutral(candidate, start, name)))
                direction = np.concatenate([(changed - base)[:, i] for i in self.axes]) * weight
                direction = direction - basis @ (basis.T @ direction)
                size = float(np.linalg.norm(direction))
                if np.isfinite(size) and size > 1e-9:
                    directions.append(direction / size)
            if directions:
                orthogonal, _ = np.linalg.qr(np.stack(directions, axis=1))
                gain = float(np.sum((orthogonal.T @ target) ** 2))
                best = max(best, (gain, dict(start)), key=lambda item: item[0])
        return best


def off_neutral(candidate: Candidate, start: Mapping[str, float], name: str) -> dict[str, float]:
    """The start values with one parameter moved off the point where the effect vanishes."""
    parameter = next(p for p in candidate.effect.parameters if p.name == name)
    values = dict(start)
    if values[name] == 0.0:
        values[name] = 0.02 * max(abs(parameter.low), abs(parameter.high))
    return values


def sensitivity_gains(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    base: OutputErrorResult,
    choices: Sequence[Candidate],
    coloured: bool = True,
) -> list[tuple[float, dict[str, float]]]:
    """Likelihood gain each candidate promises after everything else is fitted again (score test), and from which start.

    The change that the effect makes in the outputs is freed of what the other unknowns can imitate, then compared with
    the residuals: gain = (d' W nu)^2 / (d' W d), W being the inverse noise covariance. coloured: whether
    outputs count less the more their residuals are correlated; where one output alone is far off, that hides its cause.
    """
    estimator = build(problem, model, coefficients, effects, base.sigma)
    theta = base.theta
    predicted = estimator.predict(theta)
    residuals = estimator.residuals(predicted)
    S = estimator.sensitivities(theta, predicted)
    columns = estimator.columns
    inflation = base.inflation[columns] if coloured else np.ones(columns.size)
    weights = 1.0 / (base.sigma[columns] * np.sqrt(inflation))

    def flat(values: Sequence[Array]) -> Array:
        return np.concatenate([(np.nan_to_num(v[:, columns]) * weights).ravel() for v in values])

    design = np.zeros((sum(r.shape[0] for r in residuals) * columns.size, estimator.predictor.size))
    begin = 0
    for k, s in enumerate(S):
        block = (s[:, columns, :] * weights[:, None]).reshape(-1, s.shape[2])
        design[begin : begin + block.shape[0], estimator.places(k)] = block
        begin += block.shape[0]
    scale = np.linalg.norm(design, axis=0)
    basis, _ = np.linalg.qr(design / np.where(scale > 0.0, scale, 1.0))
    residual = flat(residuals)
    residual -= basis @ (basis.T @ residual)
    gains = []
    for candidate in choices:
        best = (0.0, candidate.starts[0])
        for start in candidate.starts:
            directions = []
            for name in candidate.free:
                changed = _shifted(problem, model, coefficients, effects, candidate, start, name, theta)
                difference = [after - before for after, before in zip(changed, predicted, strict=True)]
                direction = flat(difference)
                direction -= basis @ (basis.T @ direction)
                if np.isfinite(direction).all() and np.linalg.norm(direction) > 1e-9:
                    directions.append(direction / np.linalg.norm(direction))
            if directions:
                orthogonal, _ = np.linalg.qr(np.stack(directions, axis=1))
                gain = float(np.sum((orthogonal.T @ residual) ** 2))
                best = max(best, (gain, start), key=lambda item: item[0])
        gains.append(best)
    return gains


def _shifted(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    candidate: Candidate,
    start: dict[str, float],
    name: str,
    theta: Array,
) -> list[Array]:
    """Outputs with one parameter of the effect moved off the point where the effect vanishes."""
    trial = build(problem, extended(model, candidate, off_neutral(candidate, start, name)), coefficients, effects)
    return trial.predict(theta)
