"""Output error: maximum-likelihood estimates from a free-running simulation.

Maine & Iliff, NASA RP-1168, ch. 4 and 5; Jategaonkar, Flight Vehicle System Identification, ch. 4. The noise
covariance is diagonal and estimated with the parameters (concentrated likelihood); steps are Levenberg-Marquardt's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import convolve1d

from sysid.arrays import Array, IntArray
from sysid.errors import EstimationError
from sysid.numerics.autocorrelation import pooled_autocorrelation
from sysid.numerics.filters import convolved
from sysid.numerics.gaussian import Gaussian
from sysid.numerics.normal_equations import add_squares, damped_step, gram, inverse, require_numbers
from sysid.numerics.parallel import side_by_side
from sysid.problem.free_parameters import FreeParameter
from sysid.problem.predictor import Predictor
from sysid.signals.record import OUTPUTS, angle_wrap

MAX_ITERATIONS = 25  # of Gauss-Newton
# An estimate has converged when a step gains less log likelihood than this: 0.02 is a fifth of a standard error.
# Along a curved valley, as a wrong model makes it, three small gains in a row will do.
COST_TOLERANCE, SLOW_TOLERANCE, SLOW_STEPS = 0.02, 0.5, 3
# After a step that gained less than this the sensitivities hold for one step more.
SAME_SENSITIVITIES = 1.0
# Damping of the first step, if that gains its share of what the quadratic model promises, and what a step that does not
# falls back to. Damped along what the flight hardly determines, a start near the estimate would take twice the steps.
_UNDAMPED, _DAMPED, _KEPT = 1e-9, 1e-3, 0.25
# The cost cannot fall by so many times what its quadratic model promises, after the first step and before it.
_NEAR, _FAR = 3.0, 6.0
_SIGMA_FLOOR = 1e-7
_LONG_KERNEL = 64  # weights from which on the fast Fourier transform is faster


@dataclass(frozen=True)
class OutputErrorResult:
    """Estimates and what they rest on.

    theta: (P + states,) estimates. covariance: the same squared, statistical, corrected for coloured residuals;
    covariance_white: as if residuals were white (the Cramer-Rao bound). sigma: (15,) noise of each output, NaN where
    unused. residuals: per record (N, 15), measured minus predicted, NaN where missing. cost: the concentrated
    negative log likelihood, prior included. samples: (15,) measurements used per output. inflation: (15,) factor by
    which the residual spectrum at low frequency exceeds that of white noise of the same power. converged: whether the
    cost stopped falling.
    """

    parameters: tuple[FreeParameter, ...]
    theta: Array
    covariance: Array
    covariance_white: Array
    sigma: Array
    residuals: tuple[Array, ...]
    cost: float
    samples: Array
    inflation: Array
    iterations: int
    converged: bool

    def value(self, name: str) -> float:
        """Estimate of a parameter."""
        return float(self.theta[self._index(name)])

    def std(self, name: str) -> float:
        """Standard error of a parameter."""
        i = self._index(name)
        return float(np.sqrt(self.covariance[i, i]))

    def std_white(self, name: str) -> float:
        """Standard error of a parameter for white residuals."""
        i = self._index(name)
        return float(np.sqrt(self.covariance_white[i, i]))

    def _index(self, name: str) -> int:
        return [parameter.name for parameter in self.parameters].index(name)


@dataclass(frozen=True)
class Neighbourhood:
    """What the last step of an estimation knew of where it led.

    predicted: outputs (N, 15) of every record. S: their sensitivities (N, 15, P + states), which may be those of a last
    step that gained next to nothing. normal: information matrix and gradient (downhill) with them, prior included.
    """

    predicted: list[Array]
    S: list[Array]
    normal: tuple[Array, Array]


class UnlikelyError(EstimationError):
    """The estimate will be less likely than what was asked for."""


def prior_knowledge(parameters: Sequence[FreeParameter], prior: Gaussian | None) -> tuple[Array, Array]:
    """Prior means and information: each parameter's own, or `prior` for those that it names.

    Parameters
    ----------
    parameters : Sequence[FreeParameter], length P
        What is estimated, each with mean and standard deviation of its own prior.
    prior : Gaussian or None
        What is known of several of the parameters together, in place of their own priors.

    Returns
    -------
    mean : Array, shape (P,)
        Prior means, each in its parameter's unit.
    information : Array, shape (P, P)
        Inverse of the prior covariance, per product of the two parameters' units; 0 where nothing is known.
    """
    mean = np.array([parameter.prior_mean for parameter in parameters])
    information = np.diag([parameter.prior_std**-2.0 for parameter in parameters])
    if prior is not None:
        place = [[parameter.name for parameter in parameters].index(name) for name in prior.names]
        mean[place] = prior.mean
        information[place] = information[:, place] = 0.0
        information[np.ix_(place, place)] = prior.information()
    return mean, information


class OutputError:
    """One estimation problem: a predictor, a start, and the outputs that count.

    guesses: per record the nine initial states to start from. used: names of OUTPUTS in the likelihood.
    sigma: (15,) known noise to use instead of estimating it, or None. prior: what is known of several parameters
    together, in place of their own priors.
    """

    def __init__(
        self,
        predictor: Predictor,
        guesses: Sequence[Array],
        used: Sequence[str],
        sigma: Array | None = None,
        prior: Gaussian | None = None,
    ) -> None:
        self.predictor = predictor
        self.guesses = [np.asarray(guess, dtype=np.float64) for guess in guesses]
        _, self._measured = self._squares([record.z for record in predictor.records])
        places = [OUTPUTS.index(name) for name in used if self._measured[OUTPUTS.index(name)]]
        self.columns = np.array(places, dtype=np.int64)
        self.known_sigma = sigma
        self.prior_mean, self.prior_information = prior_knowledge(predictor.parameters, prior)

    def start(self, values: dict[str, float]) -> Array:
        """Unknowns from parameter values (0 where none is given) and the initial-state guesses."""
        theta = np.zeros(self.predictor.size)
        for i, parameter in enumerate(self.predictor.parameters):
            theta[i] = np.clip(values.get(parameter.name, self.prior_mean[i]), parameter.low, parameter.high)
        for index, guess in enumerate(self.guesses):
            theta[self.predictor.state_slice(index)] = guess[self.predictor.free_states[index]]
        return theta

    def predict(self, theta: Array) -> list[Array]:
        """Predicted outputs of every record."""
        flat, errors = self.predictor.apply(theta)
        return side_by_side(
            lambda i: self.predictor.outputs(i, flat, errors, self.predictor.initial_states(i, theta, self.guesses[i])),
            range(len(self.predictor.records)),
        )

    def residuals(self, predicted: Sequence[Array]) -> list[Array]:
        """Measured minus predicted of every record, angles wrapped."""
        return [angle_wrap(record.z - y) for record, y in zip(self.predictor.records, predicted, strict=True)]

    def sigma(self, residuals: Sequence[Array]) -> Array:
        """Noise of each output: root mean square of its residuals over all records."""
        if self.known_sigma is not None:
            return self.known_sigma
        sums, counts = self._squares(residuals)
        sigma = np.full(len(OUTPUTS), np.nan)
        for j in self.columns:
            sigma[j] = max(float(np.sqrt(sums[j] / counts[j])), _SIGMA_FLOOR) if counts[j] else np.nan
        return sigma

    def _squares(self, residuals: Sequence[Array]) -> tuple[Array, IntArray]:
        """Sum of squares (15,) of the residuals of each output, and how many there are."""
        sums, counts = np.zeros(len(OUTPUTS)), np.zeros(len(OUTPUTS), dtype=np.int64)
        for residual in residuals:
            add_squares(residual, sums, counts)
        return sums, counts

    def cost(self, theta: Array, residuals: Sequence[Array]) -> float:
        """Negative log likelihood, constants left out; infinite where the simulation diverged."""
        total = 0.0
        sigma = self.sigma(residuals)
        sums, counts = self._squares(residuals)
        for j in self.columns:
            if counts[j] < self._measured[j]:
                return np.inf
            if counts[j]:
                total += counts[j] * np.log(sigma[j]) + 0.5 * float(sums[j]) / sigma[j] ** 2
        from_prior = theta[: len(self.prior_mean)] - self.prior_mean
        return total + 0.5 * float(from_prior @ self.prior_information @ from_prior)

    def sensitivities(
        self, theta: Array, predicted: Sequence[Array], into: Sequence[Array] | None = None
    ) -> list[Array]:
        """Derivatives of every record's outputs, (N, 15, P + its own initial states).

        into: earlier ones to write over; they are large, and new memory takes as long as a part of the work.
        """

        def of_record(k: int, y: Array) -> Array:
            states = self.predictor.initial_states(k, theta, self.guesses[k])
            return self.predictor.derivatives(k, theta, states, y, None if into is None else into[k])

        return side_by_side(of_record, range(len(predicted)), predicted)

    def places(self, index: int) -> IntArray:
        """Where the unknowns of a record's sensitivities stand among all unknowns."""
        own = self.predictor.state_slice(index)
        return np.concatenate((np.arange(len(self.prior_mean)), np.arange(own.start, own.stop)))

    def normal_equations(
        self, theta: Array, residuals: Sequence[Array], S: Sequence[Array], sigma: Array
    ) -> tuple[Array, Array]:
        """Information matrix and gradient (downhill), prior included."""
        p = len(self.prior_mean)
        M, g = self.data_equations(residuals, S, sigma)
        M[:p, :p] += self.prior_information
        g[:p] -= self.prior_information @ (theta[:p] - self.prior_mean)
        return M, g

    def data_equations(self, residuals: Sequence[Array], S: Sequence[Array], sigma: Array) -> tuple[Array, Array]:
        """What the measurements alone add to the normal equations: (unknowns, unknowns) and (unknowns,)."""
        n = self.predictor.size
        M, g = np.zeros((n, n)), np.zeros(n)
        found = side_by_side(lambda s, nu: gram(s, nu, self.columns, sigma), S, residuals)
        for k, (information, gradient) in enumerate(found):
            place = self.places(k)
            M[np.ix_(place, place)] += information
            g[place] += gradient
        return M, g

    def solve(
        self,
        values: dict[str, float],
        progress: Callable[[int, float], None] = lambda iteration, cost: None,
        max_iterations: int = MAX_ITERATIONS,
        give_up_above: float = np.inf,
    ) -> OutputErrorResult:
        """Estimate, from parameter values and in at most so many steps; raises as `solved` does."""
        return self.solved(values, progress, max_iterations, give_up_above)[0]

    def solved(
        self,
        values: dict[str, float],
        progress: Callable[[int, float], None] = lambda iteration, cost: None,
        max_iterations: int = MAX_ITERATIONS,
        give_up_above: float = np.inf,
    ) -> tuple[OutputErrorResult, Neighbourhood]:
        """Estimate, and what its last step knew of its neighbourhood, which is large.

        Raises EstimationError where the simulation diverges, from the start values or next to an estimate, and
        UnlikelyError as soon as it shows that the cost will stay above `give_up_above`: by three times what the
        quadratic model still promises, and by six times at the start, where that model is less to be trusted.
        """
        flight = self.predictor.records[0].flight
        theta = self.start(values)
        predicted = self.predict(theta)
        residuals = self.residuals(predicted)
        cost = self.cost(theta, residuals)
        if not np.isfinite(cost):
            raise EstimationError(
                f"{flight}: the simulation from the start values diverges; "
                "give a better start (--prior MODEL.json) or a shorter part (--from, --to)"
            )
        damping, converged, iteration, slow = _UNDAMPED, False, 0, 0
        S, age, gained = self.sensitivities(theta, predicted), 0, np.inf
        while iteration < max_iterations and not converged:
            iteration += 1
            sigma = self.sigma(residuals)
            if age > 0 and (age > 1 or gained > SAME_SENSITIVITIES):
                S, age = self.sensitivities(theta, predicted, S), 0
            M, g = self.normal_equations(theta, residuals, S, sigma)
            first = iteration == 1
            promised = 0.5 * float(g @ damped_step(M, g, 0.0, flight)) if first or np.isfinite(give_up_above) else 0.0
            if cost - (_FAR if first else _NEAR) * promised > give_up_above:
                raise UnlikelyError(f"{flight}: less likely than what is known")
            while True:
                trial = self.bounded(theta + damped_step(M, g, damping, flight))
                trial_predicted = self.predict(trial)
                trial_residuals = self.residuals(trial_predicted)
                trial_cost = self.cost(trial, trial_residuals)
                wanted = _KEPT * promised if first and damping == _UNDAMPED else 0.0
                if trial_cost <= cost - wanted or damping > 1e8:
                    break
                damping = max(10.0 * damping, _DAMPED)
            if trial_cost > cost:
                converged = True
                break
            age += 1
            gained = cost - trial_cost
            slow = slow + 1 if gained < SLOW_TOLERANCE else 0
            converged = damping <= 1e-1 and (gained < COST_TOLERANCE or slow >= SLOW_STEPS)
            damping = max(damping * 0.1, _UNDAMPED)
            theta, predicted, residuals, cost = trial, trial_predicted, trial_residuals, trial_cost
            progress(iteration, cost)
        if age > 0 and gained > COST_TOLERANCE:
            S = self.sensitivities(theta, predicted, S)
        result, normal = self._result(theta, S, residuals, cost, iteration, converged)
        return result, Neighbourhood(predicted, S, normal)

    def step_at(self, theta: Array) -> tuple[Array, Array]:
        """One Gauss-Newton step from `theta`, and the covariance of where it leads, corrected for coloured residuals.

        Predicts, at an estimate without some parameters, what these would be (score test).
        """
        predicted = self.predict(theta)
        residuals = self.residuals(predicted)
        sigma = self.sigma(residuals)
        S = self.sensitivities(theta, predicted)
        M, g = self.normal_equations(theta, residuals, S, sigma)
        require_numbers(self.predictor.records[0].flight, M, g)
        white = inverse(M)
        step: Array = white @ g
        return step, self._coloured(residuals, S, sigma, white)[0]

    def bounded(self, theta: Array) -> Array:
        """Unknowns (P,) with every parameter within its bounds, in place."""
        for i, parameter in enumerate(self.predictor.parameters):
            theta[i] = min(max(theta[i], parameter.low), parameter.high)
        return theta

    def _result(
        self, theta: Array, S: list[Array], residuals: list[Array], cost: float, iteration: int, converged: bool
    ) -> tuple[OutputErrorResult, tuple[Array, Array]]:
        sigma = self.sigma(residuals)
        M, g = self.normal_equations(theta, residuals, S, sigma)
        require_numbers(self.predictor.records[0].flight, M)
        white = inverse(M)
        coloured, inflation = self._coloured(residuals, S, sigma, white)
        samples = np.zeros(len(OUTPUTS))
        for residual in residuals:
            samples += np.isfinite(residual).sum(axis=0)
        result = OutputErrorResult(
            self.predictor.parameters, theta, coloured, white, sigma, tuple(residuals), cost, samples, inflation,
            iteration, converged,
        )  # fmt: skip
        return result, (M, g)

    def _coloured(
        self, residuals: Sequence[Array], S: Sequence[Array], sigma: Array, white: Array
    ) -> tuple[Array, Array]:
        """Covariance for coloured residuals (Morelli & Klein, J. Aircraft 34(2), 1997), never below the white one."""
        n = self.predictor.size
        p = len(self.prior_mean)
        middle = np.zeros((n, n))
        middle[:p, :p] = self.prior_information
        inflation = np.full(len(OUTPUTS), np.nan)
        kernels = {int(j): pooled_autocorrelation([residual[:, j] for residual in residuals]) for j in self.columns}
        for j, kernel in kernels.items():
            inflation[j] = max(float(np.sum(kernel)), 1.0)
        white_columns = np.array([j for j, kernel in kernels.items() if kernel.size == 1], dtype=np.int64)

        def of_record(s: Array, residual: Array) -> Array:
            total, _ = gram(s, residual, white_columns, sigma)
            for j, kernel in kernels.items():
                if kernel.size > 1:
                    rows = s[:, j, :] * (np.isfinite(residual[:, j]) / sigma[j])[:, None]
                    total += rows.T @ _filtered(rows, kernel)
            return total

        for k, total in enumerate(side_by_side(of_record, S, residuals)):
            middle[np.ix_(self.places(k), self.places(k))] += total
        coloured = white @ (0.5 * (middle + middle.T)) @ white
        growth = np.sqrt(np.maximum(np.diag(coloured) / np.maximum(np.diag(white), 1e-300), 1.0))
        return white * np.outer(growth, growth), inflation


def _filtered(rows: Array, kernel: Array) -> Array:
    """Each column of `rows` (N, unknowns) convolved with a symmetric kernel, zeros beyond the ends."""
    if kernel.size > _LONG_KERNEL:
        return convolved(rows, kernel)
    return np.asarray(convolve1d(rows, kernel, axis=0, mode="constant"))
