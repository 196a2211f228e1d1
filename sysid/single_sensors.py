"""Scale and timing of single sensors that only the whole motion tells: the lateral accelerometer's before all.

Kinematics compare a lateral acceleration with a noisy vane, which says little of its scale. The free-running
simulation explains every sensor at once. At the estimate one Gauss-Newton step along a reading itself, or along its
rate of change, says which multiple of true it is, and how late (score test: C. R. Rao, Proc. Camb. Phil. Soc. 44,
1948). What stands out counts if the flight, so corrected, is far likelier and explained down to the noise of every
sensor: else it is the model that lacks something, and no sensor is blamed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.model import Model
from sysid.bench import BenchError, bench_slopes
from sysid.delays import Delay
from sysid.errors import EstimationError
from sysid.estimate import Problem, build, fit, warmed
from sysid.findings import Mistake, delay_mistake
from sysid.flight import Array
from sysid.hypotheses import scale_hypothesis
from sysid.inputnoise import input_slopes
from sysid.mistakes import GAIN, LONGEST_DELAY_S, SCALE_LEAST, SCALE_REFUSED, SCALE_SIGMAS, noise_at_most
from sysid.output_error import OutputError, OutputErrorResult, autocorrelation
from sysid.records import GROUND, OUTPUTS, Record
from sysid.shifts import read_later
from sysid.steps import inverse

# Outputs whose scale is no sensor error of its own; headings turn through pi, and have no scale.
SCALED = ("q", "p", "r", "ax", "ay", "az", "phi", *GROUND)
# Outputs that may come late alone; groups of sensors are asked for elsewhere (sysid.delaychoice).
TIMED = ("airspeed", "alpha", "beta", "q", "p", "r", "ax", "ay", "az", "phi", "theta")
# A delay counts from so many standard errors and this size, s, on. Lift that follows its angle by less than that is
# physics which a quasi-steady model lacks, and looks like an accelerometer that is early or late; along the lift by so
# much that it takes more standard errors.
SIGMAS, SIGMAS_OF_LIFT, LEAST_S = 5.0, 8.0, 4e-3
# Residuals above the sensors' noise by which a model does not explain the flight.
_UNEXPLAINED = 1.15
_MOST, _STEPS = 3, 4


@dataclass(frozen=True)
class _Error:
    """What one reading would have to be. kind: "scale" (value: measured = (1 + value) true) or "delay" (s).

    std: standard error. white: the same as if residuals were white, which a mistake makes them not to be.
    """

    output: str
    kind: str
    value: float
    std: float
    white: float

    @property
    def sigmas(self) -> float:
        """Size in standard errors for white residuals."""
        return abs(self.value) / self.white

    def likely(self) -> bool:
        """Whether it is worth a look."""
        least, sigmas = self._least()
        return self.sigmas > sigmas and abs(self.value) > 0.5 * least

    def counts(self) -> bool:
        """Whether it is no accident and large enough to matter."""
        least, sigmas = self._least()
        return abs(self.value) > max(sigmas * self.std, least)

    def _least(self) -> tuple[float, float]:
        if self.kind == "scale":
            return SCALE_LEAST, SCALE_SIGMAS
        return LEAST_S, SIGMAS_OF_LIFT if self.output == "az" else SIGMAS

    def joined(self, more: _Error) -> _Error:
        """Both, one after the other."""
        if self.kind == "delay":
            return replace(more, value=self.value + more.value)
        return replace(more, value=(1.0 + self.value) * (1.0 + more.value) - 1.0)

    def corrected(self, record: Record) -> Record:
        """The record as the sensor should have read."""
        z, j = record.z.copy(), OUTPUTS.index(self.output)
        z[:, j] = (
            z[:, j] / (1.0 + self.value) if self.kind == "scale" else read_later(z[:, j], self.value, record.interval_s)
        )
        return replace(record, z=z)

    def stretched(self, records: Sequence[Record]) -> float:
        """Log of the Jacobian: a reading in smaller numbers leaves smaller residuals, which is no merit."""
        if self.kind == "delay":
            return 0.0
        count = sum(int(np.isfinite(record.z[:, OUTPUTS.index(self.output)]).sum()) for record in records)
        return count * float(np.log1p(self.value))

    def mistake(self) -> Mistake:
        """As a finding."""
        if self.kind == "delay":
            return delay_mistake(Delay((self.output,), self.value, self.std))
        sentence = scale_hypothesis((self.output,), self.value).sentence
        usable = abs(self.value) < SCALE_REFUSED
        factor = 1.0 / (1.0 + self.value)
        return Mistake(self.output, "scale", factor, self.std * factor**2, "1", sentence, (self.output,), usable)


def told_by_motion(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    result: OutputErrorResult,
    bench: Sequence[BenchError] = (),
) -> tuple[Mistake, ...]:
    """The surest mistake of a single sensor, if any; others show better once the flight is estimated anew without it.

    problem, model, coefficients, effects: as they were given to `fit`, which gave `result`, in calm air. bench: errors
    of calibrations. Over a long flight what they leave stands out, over a short one the noise of the thrust; neither is
    a mistake of another sensor.
    """
    found: list[Mistake] = []
    slopes: list[Array] | None = None
    for _ in range(_MOST):
        errors = [one for one in _errors(problem, model, coefficients, effects, result, slopes) if one.likely()]
        if errors and slopes is None:
            slopes = _slopes_of_inputs(bench, problem, model, coefficients, effects, result)
            errors = [one for one in _errors(problem, model, coefficients, effects, result, slopes) if one.likely()]
        best = max(errors, key=lambda one: one.sigmas, default=None)
        told = None if best is None else _settled(problem, model, coefficients, effects, result, best, slopes)
        if told is None:
            break
        error, problem, result = told
        found.append(error.mistake())
    if found and not _explained(problem, result):
        return ()
    return tuple(found[:1])


def _slopes_of_inputs(
    bench: Sequence[BenchError],
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    result: OutputErrorResult,
) -> list[Array]:
    """Per record (N, 15, K): what benches leave open, and the noise of thrust and propeller speed."""
    noise = input_slopes(problem, model, coefficients, effects, result)
    if not bench:
        return noise
    left = bench_slopes(bench, problem, model, coefficients, effects, result)
    return [np.concatenate(pair, axis=2) for pair in zip(left, noise, strict=True)]


def _settled(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    result: OutputErrorResult,
    error: _Error,
    slopes: Sequence[Array] | None,
) -> tuple[_Error, Problem, OutputErrorResult] | None:
    """An error after further steps with the flight corrected for it, and that flight's estimate; None if it fades."""
    values = {p.name: float(v) for p, v in zip(result.parameters, result.theta, strict=False)}
    before = result.cost
    for _ in range(_STEPS):
        if abs(error.value) > (0.9 if error.kind == "scale" else LONGEST_DELAY_S):
            return None
        records = tuple(error.corrected(record) for record in problem.records)
        other = replace(warmed(problem, result), records=records)
        try:
            there = fit(other, model, coefficients, effects, values)
        except EstimationError:
            return None
        (more,) = (
            one
            for one in _errors(other, model, coefficients, effects, there, slopes)
            if (one.output, one.kind) == (error.output, error.kind)
        )
        if abs(more.value) < more.std:
            break
        error = error.joined(more)
    error = replace(error, std=more.std, white=more.white)
    gain = before - there.cost - error.stretched(problem.records)
    return (error, other, there) if error.counts() and gain > GAIN else None


def _explained(problem: Problem, result: OutputErrorResult) -> bool:
    """Whether no residual exceeds its sensor's noise."""
    for name in problem.motion.outputs:
        j = OUTPUTS.index(name)
        dense = [r for r in problem.records if np.isfinite(r.z[:, j]).mean() > 0.9]
        if name not in GROUND and dense:
            noise = float(np.mean([noise_at_most(r.z[:, j], r.interval_s) for r in dense]))
            if result.sigma[j] > _UNEXPLAINED * noise:
                return False
    return True


def _errors(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    result: OutputErrorResult,
    nuisances: Sequence[Array] | None = None,
) -> list[_Error]:
    """What one step from the estimate makes of every reading's scale and delay, each alone.

    nuisances: per record (N, 15, K), what others that are 0 with standard deviation 1 add to the residuals.
    """
    problem = warmed(problem, result)
    estimation = build(problem, model, coefficients, effects, result.sigma)
    values = {p.name: float(v) for p, v in zip(result.parameters, result.theta, strict=False)}
    theta = estimation.start(values)
    predicted = estimation.predict(theta)
    residuals, S = estimation.residuals(predicted), estimation.sensitivities(theta, predicted)
    if nuisances is not None:
        S = [np.concatenate(pair, axis=2) for pair in zip(S, nuisances, strict=True)]
    count = 0 if nuisances is None else nuisances[0].shape[2]
    information, gradient = estimation.normal_equations(theta, residuals, S, result.sigma, count)
    white = inverse(information)
    found = []
    for j in estimation.columns:
        kernel = autocorrelation([residual[:, j] for residual in residuals])
        for kind, columns in _slopes(problem.records, predicted, int(j)):
            value, std = _alone(estimation, residuals, S, white, gradient, int(j), columns)
            if np.isfinite(value) and std > 0.0:
                inflation = max(float(np.sum(kernel)), 1.0)
                found.append(_Error(OUTPUTS[j], kind, value, std * float(np.sqrt(inflation)), std))
    return found


def _slopes(records: Sequence[Record], predicted: Sequence[Array], j: int) -> Iterator[tuple[str, list[Array]]]:
    """Derivatives (N,) of one output's readings by its scale, and by its delay, s."""
    if OUTPUTS[j] in SCALED:
        yield "scale", [y[:, j] for y in predicted]
    if OUTPUTS[j] in TIMED:
        yield (
            "delay",
            [
                -np.gradient(np.unwrap(y[:, j]) if OUTPUTS[j] == "phi" else y[:, j], record.interval_s)
                for record, y in zip(records, predicted, strict=True)
            ],
        )


def _alone(
    estimation: OutputError,
    residuals: Sequence[Array],
    S: Sequence[Array],
    white: Array,
    gradient: Array,
    j: int,
    columns: Sequence[Array],
) -> tuple[float, float]:
    """One more unknown beside all others: its Gauss-Newton step and standard error for white residuals."""
    own, across, downhill = 0.0, np.zeros(gradient.size), 0.0
    weight = float(estimation.sigma(residuals)[j]) ** -2.0
    for k, (residual, s, column) in enumerate(zip(residuals, S, columns, strict=True)):
        rows = np.where(np.isfinite(residual[:, j]), column, 0.0) * weight
        own += float(rows @ column)
        downhill += float(rows @ np.nan_to_num(residual[:, j]))
        own_places = estimation.places(k, gradient.size - estimation.predictor.size)
        across[own_places] += rows @ s[:, j, :]
    left = own - float(across @ white @ across)
    if not left > 1e-9 * own:
        return float("nan"), float("inf")
    return (downhill - float(across @ white @ gradient)) / left, left**-0.5
