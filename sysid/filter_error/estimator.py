"""Filter error: maximum-likelihood estimates for flights in turbulence.

Output error takes gusts for errors of the sensors; here they are process noise of an extended Kalman filter, whose
innovations are white, so that estimates are efficient and their standard errors real. Intensities and length of the
turbulence and the noise of every output are estimated too. Sources: Jategaonkar, "Flight Vehicle System
Identification", ch. 5; Maine & Iliff, NASA RP-1168, ch. 5; R. K. Mehra, IEEE TAC 17(5), 1972 (noise of the outputs).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.filter_error.initial_noise import followed, follows, settled_path
from sysid.filter_error.joint_score import ScoredPoint, TrialPoint, joint_scores
from sysid.filter_error.linearised_flight import FilteredFlight, LinearisedRecord, Pass
from sysid.filter_error.noise_scoring import FAINT, SEARCH_S, NoiseParameters, likeliest_noise, surroundings
from sysid.numerics.dryden import Turbulence
from sysid.numerics.gaussian import Gaussian
from sysid.numerics.normal_equations import damped_step, hold, inverse, require_numbers
from sysid.output_error.estimator import prior_knowledge
from sysid.problem.free_parameters import FreeParameter
from sysid.problem.predictor import Predictor
from sysid.signals.record import OUTPUTS

MAX_ITERATIONS = 30  # of Gauss-Newton
# A step of less than this share of a standard error ends the estimation.
_SETTLED = 0.05
_NEAR = 1.0  # standard errors, within which noise and turbulence are estimated anew
_NOISE_ROUNDS = 2
_LOSS = 5.0
_BRIEF_S = 10.0  # of flight, from which noise is estimated in brief
_JOINT_STEPS = 12
_LOST = "filter error: the filter loses the flight (the model explains too little of the motion); use --method ee"
_CHORDS = 6  # steps with the same slopes
_DETOUR = 100.0  # of log likelihood that a step may cost, to be won back by the next


@dataclass(frozen=True)
class FilterErrorResult:
    """Estimates and what they rest on.

    theta: (P,) estimates. covariance: (P, P) statistical, corrected for what colour the innovations keep;
    covariance_white: as if they were white. sigma: (15,) noise of each output, NaN where unused. turbulence: as
    estimated. residuals: per record (N, 15) innovations. cost: negative log likelihood, prior included. calm_cost: the
    same without turbulence, all else equal. converged: whether the steps ended.
    """

    parameters: tuple[FreeParameter, ...]
    theta: Array
    covariance: Array
    covariance_white: Array
    sigma: Array
    turbulence: Turbulence
    residuals: tuple[Array, ...]
    cost: float
    calm_cost: float
    iterations: int
    converged: bool

    @property
    def together(self) -> bool:
        """Whether noise and turbulence were estimated with the parameters, not beside them."""
        return bool(np.isfinite(self.calm_cost))

    def value(self, name: str) -> float:
        """Estimate of a parameter."""
        return float(self.theta[self._index(name)])

    def std(self, name: str) -> float:
        """Standard error of a parameter."""
        i = self._index(name)
        return float(np.sqrt(self.covariance[i, i]))

    def values(self) -> dict[str, float]:
        """All estimates by name."""
        return {parameter.name: float(value) for parameter, value in zip(self.parameters, self.theta, strict=True)}

    def _index(self, name: str) -> int:
        return [parameter.name for parameter in self.parameters].index(name)


class FilterError(FilteredFlight):
    """One estimation problem: a predictor (its records and parameters), paths to start from, outputs that count.

    paths: per record (N, 9) u v w p q r phi theta psi, reconstructed. used: names of OUTPUTS in the likelihood. prior:
    what is known of several parameters together, in place of their own priors.
    """

    def __init__(
        self, predictor: Predictor, paths: Sequence[Array], used: Sequence[str], prior: Gaussian | None = None
    ) -> None:
        super().__init__(predictor, paths, used)
        self.prior_mean, self.prior_information = prior_knowledge(predictor.parameters, prior)
        self.stepping = np.array([parameter.is_stepping for parameter in predictor.parameters])
        self.resolution = np.array([0.5 * (parameter.difference or 0.0) for parameter in predictor.parameters])
        self.low = np.array([parameter.low for parameter in predictor.parameters])
        self.high = np.array([parameter.high for parameter in predictor.parameters])

    @np.errstate(all="ignore")  # a trial that runs away is refused by its cost
    def solve(
        self,
        values: dict[str, float],
        turbulence: Turbulence,
        progress: Callable[[int, float], None] = lambda iteration, cost: None,
        max_iterations: int = MAX_ITERATIONS,
        known: FilterErrorResult | None = None,
        near: FilterErrorResult | None = None,
        brief: bool = False,
        search_s: float | None = None,
    ) -> FilterErrorResult:
        """Estimate from parameter values and a first guess of the turbulence.

        known: an estimate whose noise of the outputs is kept, and the turbulence as given: a short way to a cost that
        can be compared with others found so, without the information that variances carry. near: an estimate whose
        noise lets the filter follow the flight from these values, to start from. brief: noise and turbulence
        are estimated, but beside the parameters, not together with them: near the estimate in a fifth of the time.
        search_s: of flight [s] from which noise and turbulence are estimated beside the parameters; costs of briefly
        estimated models can be compared where that is all of it.

        Raises EstimationError where the filter diverges.
        """
        theta = np.array([values.get(p.name, p.prior_mean) for p in self.predictor.parameters])
        theta = np.clip(theta, self.low, self.high)
        iteration = calls = 0
        if search_s is None:
            search_s = _BRIEF_S if brief else SEARCH_S
        if known is None:
            noise, linear, found, turbulence = self._begun(theta, turbulence, search_s, near)
        else:
            noise, calls = known.sigma[self.columns] ** 2, _NOISE_ROUNDS
            linear, found = settled_path(self, theta, noise, turbulence)
        damping, cost, last = 0.0, self._cost(found, theta), np.zeros(theta.size)
        settled = False
        while iteration < max_iterations and not settled:
            iteration += 1
            step, covariance = self._step(found, theta, damping)
            step = step if calls < _NOISE_ROUNDS or damping > 0.0 else _lengthened(step, last, covariance)
            last = step
            step = self._within(theta, step)
            size = float(np.max(np.abs(step) / np.sqrt(np.diag(covariance))))
            trial = np.clip(theta + step, self.low, self.high)
            kept = [path.copy() for path in self.paths]
            self.move(found, trial - theta)
            trial_linear = self.all_linearised(trial)
            trial_found = self.filtered(trial_linear, noise, turbulence)
            trial_cost = self._cost(trial_found, trial) if trial_found.is_finite else np.inf
            # The step solves the estimating equations, not quite the cost's gradient: only a real loss counts.
            if not trial_cost < cost + _LOSS and damping < 1e6:
                self.paths, damping = kept, max(10.0 * damping, 1e-3)
                continue
            if not np.isfinite(trial_cost):
                if brief and iteration > 1:
                    # No way on from here; what was found so far may still show what is missing.
                    self.paths = kept
                    break
                raise EstimationError(_LOST)
            damping = 0.1 * damping if damping > 1e-4 else 0.0
            theta, linear, found, cost = trial, trial_linear, trial_found, trial_cost
            progress(iteration, cost)
            settled = calls >= _NOISE_ROUNDS and size < _NEAR
            if size < _NEAR and calls < _NOISE_ROUNDS:
                calls += 1
                likeliest = likeliest_noise(self, linear, noise, turbulence, search_s)
                again = self.filtered(linear, *likeliest)
                if again.is_finite:
                    (noise, turbulence), found, cost = likeliest, again, self._cost(again, theta)
        covariance = self._step(found, theta, 0.0)[1]
        if known is not None or brief:
            return self._short(theta, covariance, noise, turbulence, found, cost, iteration, settled)
        return self._joint(theta, covariance, noise, turbulence, iteration, settled, progress)

    def _begun(
        self, theta: Array, turbulence: Turbulence, search_s: float, near: FilterErrorResult | None
    ) -> tuple[Array, list[LinearisedRecord], Pass, Turbulence]:
        """Noise (m,), linearised records, filter pass and turbulence to start from."""
        if near is None:
            first, linear, found = followed(self, theta, turbulence)
        else:
            first = near.sigma[self.columns] ** 2
            linear, found = settled_path(self, theta, first, turbulence)
        kept = [path.copy() for path in self.paths]
        noise, rough = likeliest_noise(self, linear, first, turbulence, search_s)
        with np.errstate(all="ignore"):
            likeliest, there = settled_path(self, theta, noise, rough)
        if follows(there):
            return noise, likeliest, there, rough
        # The likeliest noise about that path loses the flight: the larger one, which follows it, until the model is
        # better.
        self.paths = kept
        return first, linear, found, turbulence

    def _short(
        self, theta: Array, covariance: Array, noise: Array, turbulence: Turbulence, found: Pass, cost: float,
        iteration: int, near: bool,
    ) -> FilterErrorResult:  # fmt: skip
        """An estimate with noise and turbulence as they were known: they are not estimated."""
        sigma = np.full(len(OUTPUTS), np.nan)
        sigma[self.columns] = np.sqrt(noise)
        return FilterErrorResult(
            self.predictor.parameters, theta, covariance, covariance, sigma, turbulence,
            self._residuals(found), cost, np.nan, iteration, near,
        )  # fmt: skip

    def _residuals(self, found: Pass) -> tuple[Array, ...]:
        residuals = []
        for innovation in found.innovations:
            full = np.full((innovation.shape[0], len(OUTPUTS)), np.nan)
            full[:, self.columns] = innovation
            residuals.append(full)
        return tuple(residuals)

    def _joint(
        self, theta: Array, covariance: Array, noise: Array, turbulence: Turbulence, iteration: int, near: bool,
        progress: Callable[[int, float], None],
    ) -> FilterErrorResult:  # fmt: skip
        """Scoring of parameters, noise and turbulence together, from near the estimate."""
        known = surroundings(self)
        turbulence = replace(turbulence, **{name: max(getattr(turbulence, name), FAINT) for name in known.names})
        eta, share, converged = known.eta(noise, turbulence), 1.0, False
        best = self._scored(theta, eta, covariance, turbulence)
        for _ in range(_JOINT_STEPS):
            trial = self._climbed(best, known, turbulence, share)
            if trial is None:
                converged = near
                break
            iteration += 1
            progress(iteration, min(trial.cost, best.cost))
            if trial.cost < best.cost:
                covariance = best.covariance[: theta.size, : theta.size]
                best, share = self._scored(trial.theta, trial.eta, covariance, turbulence), min(1.0, 3.0 * share)
            else:
                self.paths, share = best.paths, 0.3 * share
        self.paths = best.paths
        noise, turbulence = known.values(best.eta, turbulence)
        return self._result(best, noise, turbulence, iteration, converged)

    def _climbed(
        self, best: ScoredPoint, known: NoiseParameters, turbulence: Turbulence, share: float
    ) -> TrialPoint | None:
        """A `share` of the way to where the scores vanish by the slopes of `best`; None where it is no way any more.

        The likelihood has a narrow, bent ridge: a step along it leaves it, and the next ones come back.
        """
        std = np.sqrt(np.diag(best.covariance)[: best.theta.size])
        whole = best.step(best)
        whole[: std.size] = self._within(best.theta, whole[: std.size])
        if np.max(np.abs(whole[: std.size]) / std) < _SETTLED:
            return None
        here: TrialPoint = best
        step = share * whole
        for _ in range(_CHORDS):
            theta = np.clip(here.theta + step[: std.size], self.low, self.high)
            eta = np.clip(here.eta + np.clip(step[std.size :], -1.0, 1.0), known.low, known.high)
            with np.errstate(all="ignore"):
                here = self._placed(theta, eta, known, turbulence)
            if not here.cost < best.cost + _DETOUR:
                break
            step = best.step(here) - (1.0 - share) * whole
            if np.max(np.abs(step[: std.size]) / std) < _SETTLED:
                break
        return here

    def _within(self, theta: Array, step: Array) -> Array:
        """A step without what would leave the bounds from a parameter that lies on one."""
        outward = ((theta <= self.low) & (step < 0.0)) | ((theta >= self.high) & (step > 0.0))
        return np.where(outward, 0.0, step)

    def _placed(self, theta: Array, eta: Array, known: NoiseParameters, turbulence: Turbulence) -> TrialPoint:
        """The filter at parameters theta and surroundings eta, on the path that it takes itself."""
        noise, here = known.values(eta, turbulence)
        for _ in range(2):
            linear = self.all_linearised(theta, slopes=False)
            self.move(self.filtered(linear, noise, here, wanted=False))
        linear = self.all_linearised(theta, slopes=False)
        found = self.filtered(linear, noise, here, wanted=False)
        cost = self._cost(found, theta) + known.cost(eta)
        return TrialPoint(theta, eta, self.paths, found, cost if np.isfinite(cost) else np.inf)

    def _scored(self, theta: Array, eta: Array, covariance: Array, turbulence: Turbulence) -> ScoredPoint:
        """The whole likelihood about there, covariance (P, P) saying how far is near."""
        known = surroundings(self)
        here = self._placed(theta, eta, known, turbulence)
        if not np.isfinite(here.cost):
            raise EstimationError(_LOST)
        noise, air = known.values(eta, turbulence)
        scores, base = joint_scores(self, theta, np.sqrt(np.diag(covariance)), noise, air, known.names)
        p = theta.size
        prior = np.zeros((p + eta.size, p + eta.size))
        prior[:p, :p] = self.prior_information
        prior[np.arange(p, p + eta.size), np.arange(p, p + eta.size)] = known.weight
        middle = np.concatenate((self.prior_mean, known.middle))
        information = scores.information + prior
        require_numbers(self.records[0].flight, information)
        return ScoredPoint(theta, eta, here.paths, base, here.cost, scores, prior, middle, inverse(information))

    def covariance_at(self, values: dict[str, float], turbulence: Turbulence) -> Array:
        """(P, P) predicted covariance of the parameters at given values, in turbulence as given."""
        theta = np.array([values.get(p.name, p.prior_mean) for p in self.predictor.parameters])
        return self._step(followed(self, theta, turbulence)[2], theta, 0.0)[1]

    def step_at(self, result: FilterErrorResult) -> Array:
        """(P,) Gauss-Newton step at an estimate, its noise and turbulence kept: what a changed problem would move."""
        noise = result.sigma[self.columns] ** 2
        for _ in range(3):
            linear = self.all_linearised(result.theta)
            found = self.filtered(linear, noise, result.turbulence)
            self.move(found)
        return self._step(found, result.theta, 0.0)[0]

    def _cost(self, found: Pass, theta: Array) -> float:
        from_prior = theta - self.prior_mean
        return -found.likelihood + 0.5 * float(from_prior @ self.prior_information @ from_prior)

    def _step(self, found: Pass, theta: Array, damping: float) -> tuple[Array, Array]:
        """Gauss-Newton step (P,), damped, and covariance (P, P) of the parameters, prior included."""
        information = found.information + self.prior_information
        downhill = found.gradient - self.prior_information @ (theta - self.prior_mean)
        hold(information, downhill, self.stepping, self.resolution)
        step = damped_step(information, downhill, damping, self.records[0].flight)
        return step, inverse(information)

    def _calm_cost(self, linear: Sequence[LinearisedRecord], noise: Array, theta: Array) -> float:
        """Cost without turbulence, the noise of the outputs and the parameters as that needs them."""
        cost = np.inf
        for _ in range(6):
            found = self.filtered(linear, noise, Turbulence())
            step, _ = self._step(found, theta, 0.0)
            downhill = found.gradient - self.prior_information @ (theta - self.prior_mean)
            cost = min(cost, self._cost(found, theta) - 0.5 * float(step @ downhill))
            ratios = [v**2 / s for v, s in zip(found.innovations, found.variances, strict=True)]
            noise = noise * np.nanmean(np.concatenate(ratios), axis=0)
        return cost

    def _result(
        self, best: ScoredPoint, noise: Array, turbulence: Turbulence, iteration: int, converged: bool
    ) -> FilterErrorResult:
        p = best.theta.size
        sigma = np.full(len(OUTPUTS), np.nan)
        sigma[self.columns] = np.sqrt(noise)
        linear = self.all_linearised(best.theta)
        cost = self._cost(self.filtered(linear, noise, turbulence, wanted=False), best.theta)
        return FilterErrorResult(
            self.predictor.parameters, best.theta, best.coloured()[:p, :p], best.covariance[:p, :p], sigma, turbulence,
            self._residuals(best.found), cost, self._calm_cost(linear, noise, best.theta), iteration, converged,
        )  # fmt: skip


def _lengthened(step: Array, last: Array, covariance: Array) -> Array:
    """A step as long as the series it begins, where it only repeats the last one on a smaller scale (Aitken)."""
    unit = np.sqrt(np.diag(covariance))
    now, then = step / unit, last / unit
    size = float(then @ then)
    share = float(now @ then) / size if size > 0.0 else 0.0
    alike = share * np.sqrt(size) > 0.9 * np.linalg.norm(now)
    return step / (1.0 - share) if alike and share < 0.9 else step
