"""An estimate with the simulation and its sensitivities there, each computed once for all that ask what moves it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim_vehicle.model.model_file import Model
from sysid.arrays import Array, IntArray
from sysid.numerics.normal_equations import crossed, gram, require_numbers
from sysid.numerics.parallel import side_by_side
from sysid.output_error.estimator import OutputError, OutputErrorResult
from sysid.output_error.from_problem import build, step_callback
from sysid.problem.estimation_problem import Problem, Progress, start_values
from sysid.signals.record import OUTPUTS


@dataclass(frozen=True)
class NuisanceUnknowns:
    """What further unknowns, 0 with standard deviation 1, add to one record's residuals or take from them.

    added: (N, 15, K), numbers everywhere. which: (K,) numbers of these unknowns among all such.
    """

    added: Array
    which: IntArray


@dataclass(frozen=True)
class OutputErrorLinearisation:
    """An estimate of output error and its neighbourhood.

    problem, model, coefficients, effects: as given to `sysid.output_error.from_problem.fit`, which gave `result`.
    """

    problem: Problem
    model: Model
    coefficients: Sequence[str]
    effects: Sequence[tuple[str, str]]
    result: OutputErrorResult

    @classmethod
    def fitted(
        cls,
        problem: Problem,
        model: Model,
        coefficients: Sequence[str],
        effects: Sequence[tuple[str, str]],
        progress: Progress = lambda share, text: None,
    ) -> OutputErrorLinearisation:
        """The estimate of the problem, with what its last step knew already."""
        values = start_values(problem, model, coefficients, effects)
        result, near = build(problem, model, coefficients, effects).solved(values, step_callback(progress))
        here = cls(problem, model, coefficients, effects, result)
        # Where the cached properties keep theirs; copies with another problem or result begin without.
        vars(here).update(predicted=near.predicted, S=near.S, normal=near.normal)
        return here

    @cached_property
    def estimation(self) -> OutputError:
        """The estimation, with the noise of the sensors as it was estimated."""
        return build(self.problem, self.model, self.coefficients, self.effects, self.result.sigma)

    @cached_property
    def predicted(self) -> list[Array]:
        """Outputs (N, 15) of every record."""
        return self.estimation.predict(self.result.theta)

    @cached_property
    def residuals(self) -> list[Array]:
        """Measured minus predicted, (N, 15) of every record."""
        return self.estimation.residuals(self.predicted)

    @cached_property
    def S(self) -> list[Array]:
        """Sensitivities (N, 15, P + states) of every record."""
        return self.estimation.sensitivities(self.result.theta, self.predicted)

    @cached_property
    def normal(self) -> tuple[Array, Array]:
        """Information matrix and gradient, downhill, prior included."""
        return self.estimation.normal_equations(self.result.theta, self.residuals, self.S, self.result.sigma)

    def gradient_changes(self, shifts: Sequence[Sequence[Array]]) -> Array:
        """Gradients (unknowns, shifts) from changes of the residuals, (N, 15) of every record each; NaN is none."""
        # Found side by side themselves, so before records are worked on side by side.
        S, residuals = self.S, self.residuals
        columns, sigma = self.estimation.columns, self.result.sigma

        def of_record(k: int) -> Array:
            more = self._added(k, [shift[k] for shift in shifts])
            return crossed(S[k], more, residuals[k], columns, sigma)

        pulled = np.zeros((self.estimation.predictor.size, len(shifts)))
        for k, part in enumerate(side_by_side(of_record, range(len(S)))):
            pulled[self.estimation.places(k)] += part
        return pulled

    def _added(self, k: int, changes: Sequence[Array]) -> Array:
        """(N, 15, K) of what changes one record's readings, 0 where nothing was read.

        Raises EstimationError where a simulation next to the estimate diverged.
        """
        record = self.problem.records[k]
        added = np.zeros((record.length, len(OUTPUTS), len(changes)))
        good = np.isfinite(record.z)
        for i, change in enumerate(changes):
            np.copyto(added[:, :, i], change, where=good)
        require_numbers(record.flight, added)
        return added

    def others(self, added: Sequence[Mapping[int, Array]]) -> list[NuisanceUnknowns]:
        """What further unknowns do to each record; added: of each, record -> (N, 15) for those that it acts on."""
        found = []
        for k in range(len(self.problem.records)):
            which = [number for number, one in enumerate(added) if k in one]
            found.append(
                NuisanceUnknowns(self._added(k, [added[number][k] for number in which]), np.array(which, np.int64))
            )
        return found

    def bordered_information(self, others: Sequence[NuisanceUnknowns]) -> tuple[Array, Array]:
        """Information matrix and gradient of the unknowns and, behind them, of the `others` of every record."""
        information, downhill = self.normal
        n = information.shape[0]
        count = max((int(one.which.max()) + 1 for one in others if one.which.size), default=0)
        joint, gradient = np.eye(n + count), np.concatenate((downhill, np.zeros(count)))
        joint[:n, :n] = information
        columns, sigma = self.estimation.columns, self.result.sigma

        def of_record(s: Array, one: NuisanceUnknowns, nu: Array) -> tuple[Array, Array, Array]:
            return crossed(s, one.added, nu, columns, sigma), *gram(one.added, nu, columns, sigma)

        found = side_by_side(of_record, self.S, others, self.residuals)
        for k, ((across, own, pulled), one) in enumerate(zip(found, others, strict=True)):
            here, there = self.estimation.places(k), n + one.which
            joint[np.ix_(here, there)] += across
            joint[np.ix_(there, here)] += across.T
            joint[np.ix_(there, there)] += own
            gradient[there] += pulled
        return joint, gradient
