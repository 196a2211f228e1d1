"""Filter error: maximum-likelihood estimates for flights in turbulence.

Output error takes gusts for errors of the sensors; here they are process noise of an extended Kalman filter, whose
innovations are white, so that estimates are efficient and their standard errors real. Intensities and length of the
turbulence and the noise of every output are estimated too. Sources: Jategaonkar, "Flight Vehicle System
Identification", ch. 5; Maine & Iliff, NASA RP-1168, ch. 5; R. K. Mehra, IEEE TAC 17(5), 1972 (noise of the outputs).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import fftconvolve

from sim_vehicle.effects import slot
from sim_vehicle.parameters import FlatModel
from sim_vehicle.simulation import effects_flown
from sysid.dryden import DEFAULT_LENGTH_M, Turbulence, gust_system
from sysid.filter_pass import kalman_pass, predict_path, run_actuators
from sysid.filter_slopes import STATE_COLUMNS, THRUST_COLUMN, path_slopes
from sysid.filter_variances import variance_pass
from sysid.flight import Array, IntArray
from sysid.output_error import angle_wrap, autocorrelation, prior_knowledge
from sysid.parameterisation import Parameter, Predictor, error_gains, sensor_derivative, with_placed_errors
from sysid.prior import Gaussian
from sysid.records import OUTPUT_PLACES, OUTPUTS, Record
from sysid.smoothing import noise_sigma

MAX_ITERATIONS = 30
# Standard deviations of what is known of the start: a reconstruction from noisy sensors is far better than this.
_START = np.array([3.0, 3.0, 3.0, 1.0, 1.0, 1.0, 0.3, 0.3, 0.3])
# Effects with a memory that the filter's state does not hold.
_UNSUPPORTED = ("unsteady_lift", "vane_lag", "pitot_lag", "attitude_lag")
# A step of less than this share of a standard error ends a stage.
_SETTLED = 0.05
_NEAR = 1.0  # standard errors, within which noise and turbulence are estimated anew
_NOISE_ROUNDS = 3
_LOSS = 5.0
_SCORING_STEPS = 15
_NUDGE = 1e-5
_FAINT = 0.003  # m/s, below any sensor
_SEARCH_S = 60.0  # of flight, from which the turbulence is estimated
_FLOOR = {"airspeed": 1e-3, "vn": 0.02, "ve": 0.02, "vd": 0.02}
_LOWEST_NOISE = 1e-5
_GPS_NOISE = 0.1  # m/s; too few samples to read it off them


@dataclass(frozen=True)
class FilterErrorResult:
    """Estimates and what they rest on.

    theta: (P,) estimates. covariance: (P, P) statistical, corrected for what colour the innovations keep;
    covariance_white: as if they were white. sigma: (15,) noise of each output, NaN where unused. turbulence: as
    estimated. residuals: per record (N, 15) innovations. cost: negative log likelihood, prior included. calm_cost: the
    same without turbulence, all else equal. converged: whether the steps ended.
    """

    parameters: tuple[Parameter, ...]
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


@dataclass
class _Path:
    """Where a record is linearised: (N, 9) states and (N, 3) gusts before and after each sample."""

    before: Array
    after: Array
    gust_before: Array
    gust_after: Array

    @property
    def gust_over(self) -> Array:
        """(N - 1, 3) mean gust of each step, as far as it is known at its begin."""
        return 0.5 * (self.gust_after[:-1] + self.gust_before[1:])


@dataclass(frozen=True)
class _Linear:
    """A record linearised about its path; gusts still as body-axis velocities, scaled in by `_pass`."""

    drift: Array  # (N - 1, nf)
    step_x: Array  # (N - 1, nf, nf + na)
    step_theta: Array  # (N - 1, nf, P)
    left: Array  # (N, m) of the used outputs
    read_x: Array  # (N, m, nf + na)
    read_theta: Array  # (N, m, P)


@dataclass(frozen=True)
class _System:
    """A record as a linear system driven by white noise (sysid.filter_pass.kalman_pass). output: gusts from states."""

    transition: Array
    drift: Array
    left: Array
    observe: Array
    jump: Array
    process: Array
    p_start: Array
    output: Array


@dataclass(frozen=True)
class _Pass:
    """Sums over all records of one filter pass; per record innovations, their variances and slopes, and deviations of
    the filter from the path before and after each sample, with their slopes.
    """

    likelihood: float
    information: Array
    gradient: Array
    innovations: list[Array]
    variances: list[Array]
    slopes: list[Array]
    deviations: list[tuple[Array, Array]]
    deviation_slopes: list[tuple[Array, Array]]
    outputs: list[Array]


def supports(flat: FlatModel) -> bool:
    """Whether a model has no memory besides its motion and its actuators."""
    return not any(flat.E[slot(name)] for name in _UNSUPPORTED)


class FilterError:
    """One estimation problem: a predictor (its records and parameters), paths to start from, outputs that count.

    paths: per record (N, 9) u v w p q r phi theta psi, reconstructed. used: names of OUTPUTS in the likelihood. prior:
    what is known of several parameters together, in place of their own priors.
    """

    def __init__(
        self, predictor: Predictor, paths: Sequence[Array], used: Sequence[str], prior: Gaussian | None = None
    ) -> None:
        self.predictor = predictor
        self.records: tuple[Record, ...] = predictor.records
        measured = np.any([np.isfinite(record.z).any(axis=0) for record in self.records], axis=0)
        self.columns = np.array([OUTPUTS.index(name) for name in used if measured[OUTPUTS.index(name)]])
        self.free = [np.array(free, dtype=np.int64) for free in predictor.free_states]
        # Gusts along an imposed axis would act on nothing.
        self.axes = [np.array([a for a in range(3) if a in free], dtype=np.int64) for free in self.free]
        self.prior_mean, self.prior_information = prior_knowledge(predictor.parameters, prior)
        self.low = np.array([parameter.low for parameter in predictor.parameters])
        self.high = np.array([parameter.high for parameter in predictor.parameters])
        self.noise = self._measured_noise()
        calm = [np.zeros((record.length, 3)) for record in self.records]
        self.paths = [_Path(p.copy(), p.copy(), g.copy(), g.copy()) for p, g in zip(paths, calm, strict=True)]

    def _measured_noise(self) -> Array:
        """(m,) variances of the used outputs from their highest frequencies."""
        found = []
        for j in self.columns:
            name = OUTPUTS[j]
            if name in ("vn", "ve", "vd"):
                found.append(_GPS_NOISE**2)
                continue
            sigma = [noise_sigma(r.z[:, j], r.interval_s) for r in self.records if np.isfinite(r.z[:, j]).sum() > 20]
            found.append(max(float(np.median(sigma)) if sigma else 0.0, _FLOOR.get(name, _LOWEST_NOISE)) ** 2)
        return np.array(found)

    def solve(
        self,
        values: dict[str, float],
        turbulence: Turbulence,
        progress: Callable[[int, float], None] = lambda iteration, cost: None,
        max_iterations: int = MAX_ITERATIONS,
        known: FilterErrorResult | None = None,
    ) -> FilterErrorResult:
        """Estimate from parameter values and a first guess of the turbulence.

        known: an estimate whose noise of the outputs is kept, and the turbulence as given.

        Raises EstimationError where the filter diverges.
        """
        theta = np.array([values.get(p.name, p.prior_mean) for p in self.predictor.parameters])
        theta = np.clip(theta, self.low, self.high)
        noise, converged, iteration = self.noise.copy(), False, 0
        linear, found = self._settled_path(theta, noise, turbulence)
        calls = 0
        if known is None:
            noise, turbulence = self._likeliest(linear, noise, turbulence)
        else:
            noise, calls = known.sigma[self.columns] ** 2, _NOISE_ROUNDS
        linear, found = self._settled_path(theta, noise, turbulence)
        damping, cost, last = 0.0, self._cost(found, theta), np.zeros(theta.size)
        while iteration < max_iterations and not converged:
            iteration += 1
            step, covariance = self._step(found, theta, damping)
            step = step if calls < _NOISE_ROUNDS or damping > 0.0 else _lengthened(step, last, covariance)
            last = step
            size = float(np.max(np.abs(step) / np.sqrt(np.diag(covariance))))
            trial = np.clip(theta + step, self.low, self.high)
            kept = [_copy(path) for path in self.paths]
            self._move(found, trial - theta)
            trial_linear = [self._linearised(k, trial) for k in range(len(self.records))]
            trial_found = self._pass(trial_linear, noise, turbulence)
            trial_cost = self._cost(trial_found, trial)
            # The step solves the estimating equations, not quite the cost's gradient: only a real loss counts.
            if not trial_cost < cost + _LOSS and damping < 1e6:
                self.paths, damping = kept, max(10.0 * damping, 1e-3)
                continue
            damping = 0.1 * damping if damping > 1e-4 else 0.0
            theta, linear, found, cost = trial, trial_linear, trial_found, trial_cost
            progress(iteration, cost)
            if size > _NEAR or (converged := calls >= _NOISE_ROUNDS and size < _SETTLED):
                continue
            if calls < _NOISE_ROUNDS:
                calls += 1
                noise, turbulence = self._likeliest(linear, noise, turbulence)
                found = self._pass(linear, noise, turbulence)
                cost = self._cost(found, theta)
        return self._result(theta, linear, found, noise, turbulence, cost, iteration, converged)

    def _settled_path(self, theta: Array, noise: Array, turbulence: Turbulence) -> tuple[list[_Linear], _Pass]:
        """Linearise where this model's own filter runs: a reconstruction is not there."""
        for _ in range(2):
            linear = [self._linearised(k, theta) for k in range(len(self.records))]
            found = self._pass(linear, noise, turbulence, wanted=False)
            self._move(found)
        linear = [self._linearised(k, theta) for k in range(len(self.records))]
        return linear, self._pass(linear, noise, turbulence)

    def covariance_at(self, values: dict[str, float], turbulence: Turbulence) -> Array:
        """(P, P) predicted covariance of the parameters at given values, in turbulence as given."""
        theta = np.array([values.get(p.name, p.prior_mean) for p in self.predictor.parameters])
        return self._step(self._settled_path(theta, self.noise, turbulence)[1], theta, 0.0)[1]

    def step_at(self, result: FilterErrorResult) -> Array:
        """(P,) Gauss-Newton step at an estimate, its noise and turbulence kept: what a changed problem would move."""
        noise = result.sigma[self.columns] ** 2
        for _ in range(3):
            linear = [self._linearised(k, result.theta) for k in range(len(self.records))]
            found = self._pass(linear, noise, result.turbulence)
            self._move(found)
        return self._step(found, result.theta, 0.0)[0]

    def _linearised(self, k: int, theta: Array) -> _Linear:
        record, path, free = self.records[k], self.paths[k], self.free[k]
        flat, errors = self.predictor.apply(theta)
        thrust = self._thrust(k, errors)
        mean, seen = self._surfaces(k, flat)
        ahead, y = self._predicted(k, flat, thrust, mean, seen)
        gains = error_gains(errors)
        predicted = with_placed_errors(y, errors)
        places, terms, columns, weights = self._direct(flat, record)
        step_x, step_v, read_x, read_v = path_slopes(
            path.before, path.gust_before, path.after, path.gust_over, ahead, free, self.axes[k], mean, seen, thrust,
            record.rho[record.start :], record.interval_s, flat.P, self._effects(flat, record), flat.C, flat.F, flat.K,
            flat.T, terms, columns, weights, np.arange(len(OUTPUTS)),
        )  # fmt: skip
        step_theta = np.zeros((record.length - 1, free.size, theta.size))
        read_theta = np.zeros((record.length, len(OUTPUTS), theta.size))
        step_theta[:, :, places] = step_v
        read_theta[:, :, places] = read_v * gains[None, :, None]
        for i, parameter in enumerate(self.predictor.parameters):
            if parameter.kind == "sensor":
                sensor_derivative(parameter.name, predicted, errors, read_theta[:, :, i])
            elif parameter.kind != "coefficient":
                h = parameter.step * max(1.0, abs(theta[i]))
                h = -h if theta[i] + h > parameter.high else h
                moved = theta.copy()
                moved[i] += h
                other, _ = self.predictor.apply(moved)
                there = self._predicted(k, other, thrust, *self._surfaces(k, other))
                step_theta[:, :, i] = _apart(there[0], ahead)[:, free] / h
                read_theta[:, :, i] = (there[1] - y) * gains / h
        return _Linear(
            drift=_apart(ahead, path.before[1:])[:, free],
            step_x=step_x,
            step_theta=step_theta,
            left=angle_wrap(record.z - predicted)[:, self.columns],
            read_x=(read_x * gains[None, :, None])[:, self.columns],
            read_theta=np.ascontiguousarray(read_theta[:, self.columns]),
        )

    def _direct(self, flat: FlatModel, record: Record) -> tuple[list[int], IntArray, IntArray, Array]:
        """Parameters with a slope in closed form: their places, terms, columns of the Jacobian and weights."""
        axis = np.searchsorted(flat.T, np.arange(flat.C.size), side="right") - 1
        found: list[tuple[int, int, int, float]] = []
        for i, parameter in enumerate(self.predictor.parameters):
            if parameter.kind == "coefficient":
                term = flat.names.index(parameter.name)
                found.append((i, term, STATE_COLUMNS + int(axis[term]), 1.0))
            elif parameter.name == "accel_bias_x" and record.moving_mass > 0.0:
                # The thrust that the bias feigns, beside the bias itself.
                found.append((i, -1, THRUST_COLUMN, -record.moving_mass))
        places, terms, columns, weights = zip(*found, strict=True) if found else ((), (), (), ())
        return list(places), np.array(terms, np.int64), np.array(columns, np.int64), np.array(weights, np.float64)

    def _thrust(self, k: int, errors: Mapping[str, float]) -> Array:
        record = self.records[k]
        return record.thrust[record.start :] + self.predictor.thrust_shift(record, errors)

    def _effects(self, flat: FlatModel, record: Record) -> Array:
        return effects_flown(flat.E, record.thrust[record.start])

    def _surfaces(self, k: int, flat: FlatModel) -> tuple[Array, Array]:
        """What the motion feels (N, sub, 4) and what sensors see (N, 4) of the surfaces along a record."""
        record, sub_steps = self.records[k], self.predictor.sub_steps
        mean, seen = np.empty((record.length, sub_steps, 4)), np.empty((record.length, 4))
        run_actuators(record.commands, record.start, record.length, record.interval_s, sub_steps,
                      self.predictor.command_first, flat.P, flat.E, mean, seen)  # fmt: skip
        return mean, seen

    def _predicted(self, k: int, flat: FlatModel, thrust: Array, mean: Array, seen: Array) -> tuple[Array, Array]:
        record, path = self.records[k], self.paths[k]
        return predict_path(
            path.before, path.gust_before, path.after, path.gust_over, self.free[k], mean, seen, thrust,
            record.rho[record.start :], record.interval_s, bool(record.held.size), flat.P, self._effects(flat, record),
            flat.C, flat.F, flat.K, flat.T, OUTPUT_PLACES,
        )  # fmt: skip

    def _system(self, k: int, one: _Linear, turbulence: Turbulence) -> _System:
        """The linear system of a record in these gusts."""
        record, path, nf, axes = self.records[k], self.paths[k], self.free[k].size, self.axes[k]
        n, m = one.left.shape
        speed = float(np.mean(np.linalg.norm(path.before[:, :3], axis=1)))
        gusts = gust_system(turbulence, axes.tolist(), speed, record.interval_s)
        nx = nf + gusts.transition.shape[0]
        transition, observe = np.zeros((n - 1, nx, nx)), np.zeros((n, m, nx))
        # Over a step acts the mean of the gusts at both its ends, so what is new in the second acts at once, half.
        felt = 0.5 * one.step_x[:, :, nf:] @ gusts.output
        transition[:, :nf, :nf] = one.step_x[:, :, :nf]
        transition[:, :nf, nf:] = felt + felt @ gusts.transition
        transition[:, nf:, nf:] = gusts.transition
        observe[:, :, :nf] = one.read_x[:, :, :nf]
        observe[:, :, nf:] = one.read_x[:, :, nf:] @ gusts.output
        entry = np.concatenate((felt, np.broadcast_to(np.eye(nx - nf), (n - 1, nx - nf, nx - nf))), axis=1)
        p_start = np.zeros((nx, nx))
        p_start[nf:, nf:] = gusts.stationary
        p_start[np.arange(nf), np.arange(nf)] = _START[self.free[k]] ** 2
        jump, drift = np.zeros((n, nx)), np.zeros((n - 1, nx))
        jump[:, :nf] = _apart(path.after, path.before)[:, self.free[k]]
        # Gusts are whole here, not deviations: what the path assumed of them comes off again.
        drift[:, :nf] = one.drift - np.einsum("kia,ka->ki", one.step_x[:, :, nf:], path.gust_over[:, axes])
        left = one.left + np.einsum("kja,ka->kj", one.read_x[:, :, nf:], path.gust_before[:, axes])
        process = entry @ gusts.process @ entry.transpose(0, 2, 1)
        return _System(transition, drift, left, observe, jump, process, p_start, gusts.output)

    def _pass(self, linear: Sequence[_Linear], noise: Array, turbulence: Turbulence, wanted: bool = True) -> _Pass:
        count = len(self.predictor.parameters)
        total = _Pass(0.0, np.zeros((count, count)), np.zeros(count), [], [], [], [], [], [])
        likelihood = 0.0
        for k, one in enumerate(linear):
            system, nf = self._system(k, one, turbulence), self.free[k].size
            slopes = np.zeros((*system.drift.shape, count))
            slopes[:, :nf] = one.step_theta
            passed = kalman_pass(
                system.transition, system.drift, slopes, system.left, system.observe, one.read_theta, system.jump,
                noise, system.process, system.p_start, wanted,
            )  # fmt: skip
            likelihood += passed[0]
            total.information[:] += passed[1]
            total.gradient[:] += passed[2]
            total.innovations.append(passed[3])
            total.variances.append(passed[4])
            total.slopes.append(passed[7])
            total.deviations.append((passed[5], passed[6]))
            total.deviation_slopes.append((passed[8], passed[9]))
            total.outputs.append(system.output)
        return replace(total, likelihood=likelihood if np.isfinite(likelihood) else -np.inf)

    def _move(self, found: _Pass, step: Array | None = None) -> None:
        """Bring every path to where the filter was, or to where it will be after a step (P,) of the parameters."""
        for k, (deviations, slopes) in enumerate(zip(found.deviations, found.deviation_slopes, strict=True)):
            path, free, axes, nf = self.paths[k], self.free[k], self.axes[k], self.free[k].size
            there = [s if step is None else s + d @ step for s, d in zip(deviations, slopes, strict=True)]
            path.before[:, free] += there[0][:, :nf]
            path.after[:, free] += there[1][:, :nf]
            path.gust_before[:, axes] = there[0][:, nf:] @ found.outputs[k].T
            path.gust_after[:, axes] = there[1][:, nf:] @ found.outputs[k].T

    def _cost(self, found: _Pass, theta: Array) -> float:
        from_prior = theta - self.prior_mean
        return -found.likelihood + 0.5 * float(from_prior @ self.prior_information @ from_prior)

    def _step(self, found: _Pass, theta: Array, damping: float) -> tuple[Array, Array]:
        """Gauss-Newton step (P,), damped, and covariance (P, P) of the parameters, prior included."""
        information = found.information + self.prior_information
        downhill = found.gradient - self.prior_information @ (theta - self.prior_mean)
        scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-30))
        scaled = information * np.outer(scale, scale)
        covariance = np.linalg.pinv(scaled, rcond=1e-13, hermitian=True) * np.outer(scale, scale)
        scaled[np.diag_indices_from(scaled)] += damping
        return np.linalg.lstsq(scaled, downhill * scale, rcond=1e-13)[0] * scale, covariance

    def _likeliest(self, linear: Sequence[_Linear], noise: Array, turbulence: Turbulence) -> tuple[Array, Turbulence]:
        """Noise and turbulence of greatest likelihood about the same paths, by scoring in their logarithms."""
        chosen, total = 0, 0.0
        for record in self.records:
            chosen, total = chosen + 1, total + record.length * record.interval_s
            if total >= _SEARCH_S:
                break
        axes = set(np.concatenate(self.axes).tolist())
        names = [*(["horizontal"] if axes & {0, 1} else []), *(["vertical"] if 2 in axes else []), "length"]
        turbulence = replace(turbulence, **{name: max(getattr(turbulence, name), _FAINT) for name in names})
        # The scale length near the ground is known to a factor of three; the noise is near what high frequencies show.
        middle = np.concatenate((np.log(self.noise), np.zeros(len(names))))
        middle[-1] = np.log(DEFAULT_LENGTH_M)
        weight = np.concatenate((np.full(noise.size, 1.0 / 9.0), np.full(len(names) - 1, 1e-4), [1.0]))
        low = np.concatenate((np.log(self.noise) - 7.0, np.full(len(names) - 1, np.log(_FAINT)), [np.log(5.0)]))
        high = np.concatenate((np.log(self.noise) + 9.0, np.full(len(names) - 1, np.log(5.0)), [np.log(300.0)]))
        eta = np.concatenate((np.log(noise), np.log([getattr(turbulence, name) for name in names])))
        damping = 1e-3
        value, downhill, information = self._scores(linear[:chosen], eta, names, turbulence)
        value -= 0.5 * float(np.sum(weight * (eta - middle) ** 2))
        for _ in range(_SCORING_STEPS):
            step = np.linalg.solve(
                information + np.diag(weight + damping * np.diag(information) + 1e-9),
                downhill - weight * (eta - middle),
            )
            trial = np.clip(eta + np.clip(step, -1.5, 1.5), low, high)
            tried = self._scores(linear[:chosen], trial, names, turbulence)
            gained = tried[0] - 0.5 * float(np.sum(weight * (trial - middle) ** 2)) - value
            if not gained > -1e-6:
                damping = max(10.0 * damping, 1e-2)
                if damping > 1e6:
                    break
                continue
            eta, value, downhill, information = trial, value + gained, tried[1], tried[2]
            damping *= 0.1
            if gained < 0.05:
                break
        found = dict(zip(names, np.exp(eta[noise.size :]).tolist(), strict=True))
        return np.exp(eta[: noise.size]), replace(turbulence, **found)

    def _scores(
        self, linear: Sequence[_Linear], eta: Array, names: Sequence[str], turbulence: Turbulence
    ) -> tuple[float, Array, Array]:
        """Log likelihood, gradient and information of the logarithms of noise variances and turbulence `names`."""
        m = self.columns.size
        noise = np.exp(eta[:m])
        here = replace(turbulence, **dict(zip(names, np.exp(eta[m:]).tolist(), strict=True)))
        likelihood, gradient, information = 0.0, np.zeros(eta.size), np.zeros((eta.size, eta.size))
        for k, one in enumerate(linear):
            system = self._system(k, one, here)
            moved = [self._system(k, one, replace(here, **{n: getattr(here, n) * (1.0 + _NUDGE)})) for n in names]
            change = [
                np.array([(getattr(other, part) - getattr(system, part)) / _NUDGE for other in moved])
                for part in ("transition", "process", "p_start")
            ]
            passed = variance_pass(
                system.transition, system.drift, system.left, system.observe, system.jump, noise, system.process,
                system.p_start, *change,
            )  # fmt: skip
            likelihood, gradient, information = likelihood + passed[0], gradient + passed[1], information + passed[2]
        return float(likelihood) if np.isfinite(likelihood) else -np.inf, gradient, information

    def _calm_cost(self, linear: Sequence[_Linear], noise: Array, theta: Array) -> float:
        """Cost without turbulence, the noise of the outputs and the parameters as that needs them."""
        cost = np.inf
        for _ in range(6):
            found = self._pass(linear, noise, Turbulence())
            step, _ = self._step(found, theta, 0.0)
            downhill = found.gradient - self.prior_information @ (theta - self.prior_mean)
            cost = min(cost, self._cost(found, theta) - 0.5 * float(step @ downhill))
            noise = noise * self._power(found)
        return cost

    def _power(self, found: _Pass) -> Array:
        """(m,) mean square of the innovations over their variance."""
        ratios = [v**2 / s for v, s in zip(found.innovations, found.variances, strict=True)]
        return np.asarray(np.nanmean(np.concatenate(ratios), axis=0), dtype=np.float64)

    def _result(
        self, theta: Array, linear: Sequence[_Linear], found: _Pass, noise: Array, turbulence: Turbulence, cost: float,
        iteration: int, converged: bool,
    ) -> FilterErrorResult:  # fmt: skip
        white = self._step(found, theta, 0.0)[1]
        sigma = np.full(len(OUTPUTS), np.nan)
        sigma[self.columns] = np.sqrt(noise)
        residuals = []
        for innovation in found.innovations:
            full = np.full((innovation.shape[0], len(OUTPUTS)), np.nan)
            full[:, self.columns] = innovation
            residuals.append(full)
        return FilterErrorResult(
            self.predictor.parameters, theta, self._coloured(found, white), white, sigma, turbulence, tuple(residuals),
            cost, self._calm_cost(linear, noise, theta), iteration, converged,
        )  # fmt: skip

    def _coloured(self, found: _Pass, white: Array) -> Array:
        """Covariance for what colour the innovations keep (Morelli & Klein), never below the white one."""
        middle = self.prior_information.copy()
        for j in range(self.columns.size):
            scaled = [v[:, j] / np.sqrt(s[:, j]) for v, s in zip(found.innovations, found.variances, strict=True)]
            kernel = autocorrelation(scaled)
            for one, slope, variance in zip(scaled, found.slopes, found.variances, strict=True):
                rows = np.where(np.isfinite(one)[:, None], slope[:, j] / np.sqrt(variance[:, j, None]), 0.0)
                wide = rows if kernel.size == 1 else fftconvolve(rows, kernel[:, None], mode="same", axes=0)
                middle += rows.T @ wide
        coloured = white @ (0.5 * (middle + middle.T)) @ white
        growth = np.sqrt(np.maximum(np.diag(coloured) / np.maximum(np.diag(white), 1e-300), 1.0))
        return np.asarray(white * np.outer(growth, growth))


def _apart(ahead: Array, behind: Array) -> Array:
    """(N, 9) differences of states, angles the short way round."""
    apart = ahead - behind
    for place in (6, 8):
        apart[:, place] = (apart[:, place] + np.pi) % (2.0 * np.pi) - np.pi
    return apart


def _lengthened(step: Array, last: Array, covariance: Array) -> Array:
    """A step as long as the series it begins, where it only repeats the last one on a smaller scale (Aitken)."""
    unit = np.sqrt(np.diag(covariance))
    now, then = step / unit, last / unit
    size = float(then @ then)
    share = float(now @ then) / size if size > 0.0 else 0.0
    alike = share * np.sqrt(size) > 0.9 * np.linalg.norm(now)
    return step / (1.0 - share) if alike and share < 0.9 else step


def _copy(path: _Path) -> _Path:
    return _Path(path.before.copy(), path.after.copy(), path.gust_before.copy(), path.gust_after.copy())
