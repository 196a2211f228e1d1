"""Filter error: its filter against the dense Gaussian likelihood, its slopes against differences, and gusty flights."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from simulated import signals_of

from sim_vehicle.effects import EFFECTS
from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.flight.wind import WindField, dryden_gusts
from sim_vehicle.manoeuvres.plan import plan_of
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.arrays import Array
from sysid.compatibility.reconstruction import check_compatibility
from sysid.filter_error.estimation import build_filter, estimate_in_turbulence
from sysid.filter_error.estimator import FilterErrorResult
from sysid.filter_error.initial_noise import settled_path
from sysid.filter_error.kalman import kalman_pass, variance_gradient, variance_pass
from sysid.filter_error.thrust_noise import with_thrust_errors
from sysid.identify import Identification, identify
from sysid.numerics.dryden import Turbulence, gust_system
from sysid.problem.estimation_problem import free_coefficients
from sysid.problem.formulation import make_problem
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import prepare

pytestmark = pytest.mark.whole_flight

VEHICLE = load_vehicle("iitb-mav")
TRUTH = read_model("iitb-mav")
MAIN = ("CL_alpha", "Cm_alpha", "Cm_de", "Cl_p", "Cl_da", "Cn_beta", "Cn_dr", "CY_beta", "CD_0")


def gusty_flight(sigma: float, seed: int) -> FlightSignals:
    """20 s of multisine, flown with another step than the estimator's."""
    generator = np.random.default_rng(seed)
    suite = SensorSuite(VEHICLE, generator=generator)
    flown = fly(
        Plant(VEHICLE, TRUTH, max_step=0.0023), plan_of(["multisine"]), suite=suite, generator=generator,
        wind=WindField((1.0, -0.5, 0.0), 0.0, 0.0, sigma, 20.0),
    )  # fmt: skip
    return signals_of(flown, VEHICLE, f"seed {seed}")


class Small:
    """A random linear system of 3 states, 2 outputs and 2 parameters over 6 samples, with one reading missing."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        n, nx, m, p = 6, 3, 2, 2
        self.transition = 0.6 * rng.standard_normal((n - 1, nx, nx))
        self.drift = 0.1 * rng.standard_normal((n - 1, nx))
        self.step_slopes = rng.standard_normal((n - 1, nx, p))
        self.observe = rng.standard_normal((n, m, nx))
        self.read_slopes = rng.standard_normal((n, m, p))
        self.jump = np.zeros((n, nx))
        self.noise = np.array([0.3, 0.7])
        root = rng.standard_normal((nx, nx))
        self.process = np.tile(0.2 * root @ root.T, (n - 1, 1, 1))
        self.start = np.eye(nx)
        self.left = rng.standard_normal((n, m))
        self.left[2, 1] = np.nan

    def dense(self, theta: Array, noise: Array, process: Array) -> tuple[Array, Array]:
        """Mean and covariance of all finite readings, by stacking."""
        n, nx = self.left.shape[0], 3
        mean_x, blocks = np.zeros(nx), [self.start]
        means, cross = [mean_x], {(0, 0): self.start}
        for k in range(n - 1):
            mean_x = self.transition[k] @ mean_x + self.drift[k] + self.step_slopes[k] @ theta
            means.append(mean_x)
            blocks.append(self.transition[k] @ blocks[-1] @ self.transition[k].T + process[k])
            cross[k + 1, k + 1] = blocks[-1]
            for j in range(k + 1):
                cross[k + 1, j] = self.transition[k] @ cross[k, j]
                cross[j, k + 1] = cross[k + 1, j].T
        mean = np.concatenate([self.observe[k] @ means[k] + self.read_slopes[k] @ theta for k in range(n)])
        covariance = np.block([[self.observe[i] @ cross[i, j] @ self.observe[j].T for j in range(n)] for i in range(n)])
        covariance += np.diag(np.tile(noise, n))
        good = np.isfinite(self.left.ravel())
        return mean[good], covariance[np.ix_(good, good)]

    def likelihood(self, theta: Array, noise: Array, process: Array) -> float:
        mean, covariance = self.dense(theta, noise, process)
        z = self.left.ravel()[np.isfinite(self.left.ravel())]
        log = float(stats.multivariate_normal(mean, covariance).logpdf(z))
        return log + 0.5 * z.size * float(np.log(2.0 * np.pi))

    def filtered(self, theta: Array) -> tuple[float, Array, Array]:
        found = kalman_pass(
            self.transition, self.drift + self.step_slopes @ theta, self.step_slopes,
            self.left - self.read_slopes @ theta, self.observe, self.read_slopes, self.jump, self.noise, self.process,
            self.start, True,
        )  # fmt: skip
        return found[0], found[1], found[2]


@pytest.mark.parametrize("seed", [1, 2])
def test_the_filter_is_the_dense_gaussian_likelihood_with_its_gradient_and_information(seed: int) -> None:
    system, theta = Small(seed), np.array([0.3, -0.2])
    likelihood, information, gradient = system.filtered(theta)
    assert likelihood == pytest.approx(system.likelihood(theta, system.noise, system.process), rel=1e-10)
    _, covariance = system.dense(theta, system.noise, system.process)
    step = 1e-6
    for i in range(2):
        moved = theta + step * np.eye(2)[i]
        slope = (system.likelihood(moved, system.noise, system.process) - likelihood) / step
        assert gradient[i] == pytest.approx(slope, rel=1e-4, abs=1e-5)
    means = [
        system.dense(theta + change, system.noise, system.process)[0] for change in np.vstack((np.zeros(2), np.eye(2)))
    ]
    slopes = np.column_stack([mean - means[0] for mean in means[1:]])
    np.testing.assert_allclose(information, slopes.T @ np.linalg.solve(covariance, slopes), rtol=1e-9)


def test_scores_of_variances_are_the_slopes_of_the_dense_likelihood() -> None:
    system, theta = Small(3), np.zeros(2)
    likelihood, gradient, information = variance_pass(
        system.transition, system.drift, system.left, system.observe, system.jump, system.noise, system.process,
        system.start, np.zeros((1, *system.transition.shape)), system.process[None], np.zeros((1, 3, 3)),
    )  # fmt: skip
    assert likelihood == pytest.approx(system.likelihood(theta, system.noise, system.process), rel=1e-10)
    step = 1e-6
    base, changes = system.dense(theta, system.noise, system.process)[1], []
    for i in range(3):
        noise = system.noise * (np.exp(step) if i < 2 else 1.0) ** (np.arange(2) == i)
        process = system.process * (1.0 + step if i == 2 else 1.0)
        slope = (system.likelihood(theta, noise, process) - likelihood) / step
        assert gradient[i] == pytest.approx(slope, rel=1e-3, abs=1e-4)
        changes.append((system.dense(theta, noise, process)[1] - base) / step)
    inverse = np.linalg.inv(base)
    expected = [[0.5 * np.trace(inverse @ a @ inverse @ b) for b in changes] for a in changes]
    # One draw's information holds its own innovations; that of many is the expected one.
    assert information.shape == (3, 3)
    assert np.all(np.linalg.eigvalsh(information) > 0.0)
    assert np.trace(information) == pytest.approx(float(np.trace(np.array(expected))), rel=1.0)


def test_the_way_back_gives_the_same_gradient_as_the_filter_differentiated() -> None:
    system, rng = Small(4), np.random.default_rng(7)
    system.left[3, 1] = np.nan
    half = rng.normal(size=(2, *system.transition.shape))
    changes = [0.1 * half, half @ half.transpose(0, 1, 3, 2), np.broadcast_to(np.eye(3), (2, 3, 3)).copy()]
    arguments = (
        system.transition, system.drift, system.left, system.observe, system.jump, system.noise, system.process,
        system.start, *changes,
    )  # fmt: skip
    likelihood, gradient, _ = variance_pass(*arguments)
    again, short = variance_gradient(*arguments)
    assert again == pytest.approx(likelihood, rel=1e-12)
    np.testing.assert_allclose(short, gradient, rtol=1e-9, atol=1e-9)


def test_gusts_have_the_variance_and_the_memory_of_the_simulators() -> None:
    turbulence, speed, dt = Turbulence(0.4, 0.7, 25.0), 15.0, 0.02
    system = gust_system(turbulence, (0, 1, 2), speed, dt)
    np.testing.assert_allclose(
        system.transition @ system.stationary @ system.transition.T + system.process, system.stationary, atol=1e-14
    )
    variance = np.diag(system.output @ system.stationary @ system.output.T)
    np.testing.assert_allclose(variance, [0.16, 0.16, 0.49], rtol=1e-12)
    later = np.linalg.matrix_power(system.transition, 50)
    ours = np.diag(system.output @ later @ system.stationary @ system.output.T) / variance
    made = dryden_gusts(400_000, dt, sigma=1.0, length=25.0, airspeed=speed, generator=np.random.default_rng(5))
    theirs = np.mean(made[50:] * made[:-50], axis=0)
    np.testing.assert_allclose(ours, theirs, atol=0.06)


def test_slopes_along_a_path_are_those_of_its_predictions() -> None:
    prepared = [prepare(gusty_flight(0.2, 3), VEHICLE)]
    problem = with_thrust_errors(make_problem(prepared, VEHICLE, check_compatibility(prepared)), prepared)
    assert problem.thrust_errors > 0
    names = ["CL_0", "CL_alpha", "CL_q", "CL_de", "CD_0", "CD_k", "Cm_alpha", "Cm_q", "Cl_p", "Cl_da", "Cn_beta"]
    model = Model("test", {name: TRUTH.coefficients.get(name, TRUTH.coefficients["CL_0"]) for name in names})
    filtered = build_filter(problem, model, names)
    values = {**model.values(), **problem.sensors}
    theta = np.array([values.get(p.name, 0.0) for p in filtered.predictor.parameters])
    here = filtered.linearised(0, theta)
    for i, parameter in enumerate(filtered.predictor.parameters):
        step = 1e-5
        ends = []
        for sign in (1.0, -1.0):
            moved = theta.copy()
            moved[i] += sign * step
            ends.append(filtered.linearised(0, moved, slopes=False))
        read = -(ends[0].left - ends[1].left) / (2.0 * step)
        good = np.isfinite(read)
        size = np.abs(read[good]).max()
        assert np.abs(read - here.read_theta[:, :, i])[good].max() < 1e-3 * max(size, 1e-6), parameter.name
        flown = (ends[0].drift - ends[1].drift) / (2.0 * step)
        size = np.abs(flown).max()
        # One Jacobian a step: the error of the midpoint rule, largest for the roll rate, which settles in 50 ms.
        assert np.abs(flown - here.step_theta[:, :, i]).max() < 0.04 * max(size, 1e-9), parameter.name


def test_steps_through_sheared_wind_have_the_slopes_of_its_predictions() -> None:
    """What the shear adds to them: by every state, at a gradient that shows in one step."""
    prepared = [prepare(gusty_flight(0.2, 3), VEHICLE)]
    problem = make_problem(prepared, VEHICLE, check_compatibility(prepared))
    found, flown = [], []
    for gradient in (0.5, 0.0):
        model = TRUTH.with_effect(EFFECTS["wind_shear"], {"gradient": gradient})
        filtered = build_filter(problem, model, [])
        theta = np.array([problem.sensors.get(p.name, 0.0) for p in filtered.predictor.parameters])
        step_x = filtered.linearised(0, theta).step_x
        after = filtered.paths[0].after
        slopes = np.empty((after.shape[0] - 1, 9, 9))
        for state in range(9):
            ends = []
            for sign in (1.0, -1.0):
                filtered.paths[0].after = after + sign * 1e-4 * np.eye(9)[state]
                ends.append(filtered.linearised(0, theta, slopes=False).drift)
            slopes[:, :, state] = (ends[0] - ends[1]) / 2e-4
        found.append(step_x[:, :, :9])
        flown.append(slopes)
    added, expected = found[0] - found[1], flown[0] - flown[1]
    for state in (0, 1, 2, 6, 7, 8):
        size = np.abs(expected[:, :3, state]).max()
        assert size > 1e-3
        assert np.abs(added[:, :3, state] - expected[:, :3, state]).max() < 0.05 * size, state


@pytest.fixture(scope="module")
def rough() -> list[Identification]:
    return [identify([gusty_flight(0.3, 41)], VEHICLE, method=method, systematic=False) for method in ("fe", "oe")]


def test_a_flight_in_gusts_is_identified_by_filter_error_more_accurately_than_by_output_error(
    rough: list[Identification],
) -> None:
    filtered, plain = rough
    assert filtered.likeliest is not None
    assert filtered.likeliest.method == "fe"
    result = filtered.likeliest.result
    assert isinstance(result, FilterErrorResult)
    assert 0.2 < result.turbulence.vertical < 0.45
    assert 0.2 < result.turbulence.horizontal < 0.45
    misses = np.array([_misses(found, filtered) for found in (filtered, plain)])
    assert np.abs(misses[0]).max() < 4.0
    size = np.sqrt(np.nanmean(misses**2, axis=1))
    assert size[0] < 1.8
    assert size[1] > 1.5 * size[0]
    assert any("turbulence" in warning for warning in plain.warnings)


def test_the_estimate_is_the_top_of_the_likelihoods_ridge_and_its_bars_are_the_ridges_width(
    rough: list[Identification],
) -> None:
    """Along the directions that a flight in gusts tells least, the filter's own path found anew at every point."""
    found = rough[0].likeliest
    assert found is not None
    result = found.result
    assert isinstance(result, FilterErrorResult)
    names = [parameter.name for parameter in result.parameters]
    coefficients = [parameter.name for parameter in result.parameters if parameter.kind == "coefficient"]
    model = Model("test", dict.fromkeys(coefficients, TRUTH.coefficients["CL_0"]))
    filtered = build_filter(found.problem, model, coefficients)
    noise = result.sigma[filtered.columns] ** 2
    start = [path.copy() for path in filtered.paths]

    def likelihood(theta: Array) -> float:
        filtered.paths = [path.copy() for path in start]
        return settled_path(filtered, theta, noise, result.turbulence)[1].likelihood

    top = likelihood(result.theta)
    for weak in ("airspeed_scale", "beta_bias"):
        i = names.index(weak)
        # A quarter of a bar: the ridge is bent, a whole one along its tangent already leaves it.
        step = 0.25 * result.covariance_white[:, i] / np.sqrt(result.covariance_white[i, i])
        up, down = likelihood(result.theta + step), likelihood(result.theta - step)
        assert abs(up - down) / 0.5 < 0.25, weak
        assert 0.6 < (2.0 * top - up - down) / 0.25**2 < 1.5, weak


def _misses(found: Identification, bars: Identification) -> list[float]:
    """Errors of the main derivatives in standard errors of `bars`; NaN where refused."""
    misses = []
    for name in MAIN:
        value, true, std = (
            found.model.coefficients[name].value, TRUTH.coefficients[name].value, bars.model.coefficients[name].std,
        )  # fmt: skip
        assert true is not None
        assert std is not None
        misses.append(np.nan if value is None else (value - true) / std)
    return misses


@pytest.mark.parametrize(("gain", "kept"), [(5.0, False), (2.0, True)])
def test_a_sensor_error_that_no_sensor_has_is_held_and_refused(gain: float, kept: bool) -> None:
    """A vane that reads five times the sideslip, in gusts, about which kinematics alone say nothing."""
    flight = gusty_flight(0.3, 5)
    beta = flight.signals["beta"]
    wrong = {**flight.signals, "beta": replace(beta, values=gain * beta.values)}
    prepared = [prepare(replace(flight, signals=wrong), VEHICLE, 0.0, 8.0)]
    compatible = check_compatibility(prepared)
    sensors = ("accel_bias_y", "beta_scale")
    problem = make_problem(prepared, VEHICLE, compatible, sensors, run_s=60.0)
    names = free_coefficients(list(TRUTH.coefficients), problem.motion)
    solved, found, refused = estimate_in_turbulence(problem, TRUTH, names, (), compatible, sensors)
    told = [parameter.name for parameter in found.parameters if parameter.kind == "sensor"]
    assert tuple(solved.sensors) == tuple(told) == (sensors if kept else sensors[:1])
    if kept:
        assert refused == []
        assert abs(1.0 + found.value("beta_scale") - 1.005 * gain) < 4.0 * found.std("beta_scale")
        return
    (refusal,) = refused
    assert refusal.name == "beta_scale"
    asked_for = re.match(r"the readings ask for ([\d.]+) of true", refusal.reason)
    assert asked_for is not None
    assert float(asked_for[1]) == pytest.approx(1.005 * gain, rel=0.1)
    assert "held at its nominal value" in refusal.reason
