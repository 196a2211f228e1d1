"""Scale and timing of single sensors that only the whole motion tells: the lateral accelerometer's before all.

Kinematics compare a lateral acceleration with a noisy vane, which says little of its scale. The free-running
simulation explains every sensor at once. At the estimate one Gauss-Newton step along a reading itself, or along its
rate of change, says which multiple of true it is, and how late (score test: C. R. Rao, Proc. Camb. Phil. Soc. 44,
1948). What stands out counts if the flight, so corrected, is far likelier and explained down to the noise of every
sensor: else it is the model that lacks something, and no sensor is blamed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.numerics.autoregression import pooled_autocorrelation
from sysid.numerics.fractional_delay import read_later
from sysid.numerics.normal_equations import inverse, single_gram, single_pulls
from sysid.numerics.parallel import side_by_side
from sysid.output_error.fit import fit, warmed
from sysid.output_error.linearisation import Linearised, NuisanceUnknowns
from sysid.signal_check.fault import Mistake, delay_mistake
from sysid.signal_check.fault_hypotheses import scale_hypothesis
from sysid.signal_check.fault_search import (
    GAIN,
    LONGEST_DELAY_S,
    SCALE_LEAST,
    SCALE_REFUSED,
    SCALE_SIGMAS,
    noise_at_most,
)
from sysid.signals.delay import Delay
from sysid.signals.record import GROUND, OUTPUTS, Record

# Outputs whose scale is no sensor error of its own; headings turn through pi, and have no scale.
SCALED = ("q", "p", "r", "ax", "ay", "az", "phi", *GROUND)
# Outputs that may come late alone; groups of sensors are asked for elsewhere (sysid.output_error.delay_selection).
TIMED = ("airspeed", "alpha", "beta", "q", "p", "r", "ax", "ay", "az", "phi", "theta")
# A delay counts from so many standard errors and this size, s, on. Lift that follows its angle by less than that is
# physics which a quasi-steady model lacks, and looks like an accelerometer that is early or late; along the lift by so
# much that it takes more standard errors.
SIGMAS, SIGMAS_OF_LIFT, LEAST_S = 5.0, 8.0, 4e-3
# Residuals above the sensors' noise by which a model does not explain the flight.
_UNEXPLAINED = 1.15
_MOST, _STEPS = 3, 4
KINDS = ("scale", "delay")


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


def told_by_motion(here: Linearised, others: Callable[[], Sequence[NuisanceUnknowns]]) -> tuple[Mistake, ...]:
    """The surest mistake of a single sensor, if any; others show better once the flight is estimated anew without it.

    here: an estimate in calm air. others: gives what the errors of calibrations and the noise of thrust and propeller
    speed do to every record; asked for where something stands out. Over a long flight what calibrations leave does,
    over a short one the noise of the thrust; neither is a mistake of another sensor.
    """
    found: list[Mistake] = []
    known: Sequence[NuisanceUnknowns] | None = None
    for _ in range(_MOST):
        alone = _alone(here)
        errors = [one for one in _errors(alone, known) if one.likely()]
        if errors and known is None:
            known = others()
            errors = [one for one in _errors(alone, known) if one.likely()]
        best = max(errors, key=lambda one: one.sigmas, default=None)
        told = None if best is None else _settled(here, best, known)
        if told is None:
            break
        error, here = told
        found.append(error.mistake())
    if found and not _explained(here):
        return ()
    return tuple(found[:1])


def _settled(
    here: Linearised, error: _Error, others: Sequence[NuisanceUnknowns] | None
) -> tuple[_Error, Linearised] | None:
    """An error after further steps with the flight corrected for it, and that flight's estimate; None if it fades."""
    problem, result = here.problem, here.result
    values = {p.name: float(v) for p, v in zip(result.parameters, result.theta, strict=False)}
    before = result.cost
    for _ in range(_STEPS):
        if abs(error.value) > (0.9 if error.kind == "scale" else LONGEST_DELAY_S):
            return None
        records = tuple(error.corrected(record) for record in problem.records)
        other = replace(warmed(problem, result), records=records)
        try:
            fitted = fit(other, here.model, here.coefficients, here.effects, values)
        except EstimationError:
            return None
        there = replace(here, problem=other, result=fitted)
        (more,) = (
            one for one in _errors(_alone(there), others) if (one.output, one.kind) == (error.output, error.kind)
        )
        if abs(more.value) < more.std:
            break
        error = error.joined(more)
    error = replace(error, std=more.std, white=more.white)
    gain = before - fitted.cost - error.stretched(problem.records)
    return (error, there) if error.counts() and gain > GAIN else None


def _explained(here: Linearised) -> bool:
    """Whether no residual exceeds its sensor's noise."""
    for name in here.problem.motion.outputs:
        j = OUTPUTS.index(name)
        dense = [r for r in here.problem.records if np.isfinite(r.z[:, j]).mean() > 0.9]
        if name not in GROUND and dense:
            noise = float(np.mean([noise_at_most(r.z[:, j], r.interval_s) for r in dense]))
            if here.result.sigma[j] > _UNEXPLAINED * noise:
                return False
    return True


@dataclass(frozen=True)
class _Alone:
    """Every reading's scale and delay beside the unknowns of an estimate.

    slopes: (N, 15, 2) of every record, see `_slopes`. across: (15, 2, unknowns), own and downhill: (15, 2) information
    and gradient. inflation: (15,) of the variance, by the colour of the residuals; 0 where there are none.
    """

    here: Linearised
    slopes: list[Array]
    across: Array
    own: Array
    downhill: Array
    inflation: Array


def _alone(here: Linearised) -> _Alone:
    estimation, sigma = here.estimation, here.result.sigma

    def of_record(record: Record, y: Array, nu: Array, s: Array) -> tuple[Array, Array, Array, Array]:
        slopes = _slopes(record, y)
        own, downhill = np.zeros((len(OUTPUTS), len(KINDS))), np.zeros((len(OUTPUTS), len(KINDS)))
        single_gram(nu, estimation.columns, sigma, slopes, own, downhill)
        across = np.zeros((len(OUTPUTS), len(KINDS), s.shape[2]))
        single_pulls(s, nu, estimation.columns, sigma, slopes, across)
        return slopes, across, own, downhill

    parts = side_by_side(of_record, here.problem.records, here.predicted, here.residuals, here.S)
    across = np.zeros((len(OUTPUTS), len(KINDS), estimation.predictor.size))
    for k, (_, part, _, _) in enumerate(parts):
        across[:, :, estimation.places(k)] += part
    inflation = np.zeros(len(OUTPUTS))
    for j in estimation.columns:
        kernel = pooled_autocorrelation([nu[:, j] for nu in here.residuals])
        inflation[j] = max(float(np.sum(kernel)), 1.0)
    own, downhill = sum(part[2] for part in parts), sum(part[3] for part in parts)
    return _Alone(here, [part[0] for part in parts], across, np.asarray(own), np.asarray(downhill), inflation)


def _errors(alone: _Alone, others: Sequence[NuisanceUnknowns] | None = None) -> list[_Error]:
    """What one step from the estimate makes of every reading's scale and delay, each alone beside all unknowns.

    others: what else the residuals hold, of every record.
    """
    here, across = alone.here, alone.across
    information, gradient = here.normal if others is None else here.bordered_information(others)
    if others is not None:
        across = np.concatenate((across, _beside(alone, others, gradient.size - across.shape[2])), axis=2)
    white = inverse(information)
    found = []
    for j in here.estimation.columns:
        for i, kind in enumerate(KINDS):
            # The Gauss-Newton step of one more unknown beside all others.
            row, own = across[j, i], alone.own[j, i]
            left = own - float(row @ white @ row)
            if left > 1e-9 * own:
                value = float((alone.downhill[j, i] - row @ white @ gradient) / left)
                std = float(np.sqrt(alone.inflation[j] / left))
                found.append(_Error(OUTPUTS[j], kind, value, std, left**-0.5))
    return found


def _beside(alone: _Alone, others: Sequence[NuisanceUnknowns], count: int) -> Array:
    """(15, 2, count) information that readings' scales and delays share with the others."""
    here = alone.here

    def of_record(slopes: Array, nu: Array, added: Array) -> Array:
        across = np.zeros((len(OUTPUTS), len(KINDS), added.shape[2]))
        single_pulls(added, nu, here.estimation.columns, here.result.sigma, slopes, across)
        return across

    found = np.zeros((len(OUTPUTS), len(KINDS), count))
    parts = side_by_side(of_record, alone.slopes, here.residuals, [one.added for one in others])
    for one, part in zip(others, parts, strict=True):
        found[:, :, one.which] += part
    return found


def _slopes(record: Record, y: Array) -> Array:
    """Derivatives (N, 15, 2) of every output's readings by their scale, and by their delay, s; 0 where it has none."""
    slopes = np.zeros((*y.shape, len(KINDS)))
    for name in SCALED:
        slopes[:, OUTPUTS.index(name), 0] = y[:, OUTPUTS.index(name)]
    for name in TIMED:
        reading = y[:, OUTPUTS.index(name)]
        slopes[:, OUTPUTS.index(name), 1] = -np.gradient(
            np.unwrap(reading) if name == "phi" else reading, record.interval_s
        )
    return slopes
