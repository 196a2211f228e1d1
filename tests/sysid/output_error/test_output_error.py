"""The one-step maximum-likelihood estimate against an independent truth, published bounds and closed forms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import mav_longitudinal as mav
import numpy as np
import pytest
from mav_problem import AERODYNAMIC, SENSORS, longitudinal_record, problem, vehicle
from numpy.typing import NDArray

from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.packed_model import flatten
from sysid.errors import EstimationError
from sysid.numerics.autocorrelation import pooled_autocorrelation
from sysid.numerics.normal_equations import damped_step
from sysid.output_error.estimator import OutputError, OutputErrorResult
from sysid.problem.free_parameters import FreeParameter, coefficient, effect_parameter, sensor_error
from sysid.problem.predictor import Predictor
from sysid.signals.record import LONGITUDINAL, OUTPUTS, Record, angle_wrap

pytestmark = pytest.mark.whole_flight

Array = NDArray[np.float64]

RUNS = 40
TRUE = {**mav.COEFFICIENTS, **{name: mav.ERRORS.get(name, 0.0) for name in SENSORS}}
NAMES = (*AERODYNAMIC, *SENSORS)
# Cramer-Rao bounds of this very case (one pulse of 2 deg in 10 s, the paper's Table II noise, all six sensors),
# computed elsewhere with another simulation and other sensitivities; printed to two or three digits.
BOUND = {
    "CL_0": 0.00023, "CL_alpha": 0.00086, "CL_de": 0.00555, "CD_0": 0.00004, "CD_k": 0.00019, "Cm_0": 0.00005,
    "Cm_alpha": 0.00011, "Cm_de": 0.00056, "accel_bias_x": 0.0035, "accel_bias_z": 0.0035,
    "gyro_bias_q": float(np.deg2rad(0.0015)), "alpha_scale": 0.0029, "theta_scale": 0.0003,
}  # fmt: skip


@dataclass(frozen=True)
class Runs:
    """Estimates and their standard errors, (RUNS, 13) each, in the order of NAMES."""

    values: Array
    white: Array
    std: Array
    results: tuple[OutputErrorResult, ...]


def start_values(generator: np.random.Generator) -> dict[str, float]:
    """Aerodynamic values 15 % off, sensor errors unknown."""
    return {name: TRUE[name] * (1.0 + 0.15 * generator.choice([-1.0, 1.0])) for name in AERODYNAMIC}


@pytest.fixture(scope="module")
def runs() -> Runs:
    truth = mav.fly(mav.pulse())
    found = []
    for seed in range(RUNS):
        generator = np.random.default_rng(seed)
        data = mav.measure(truth, generator)
        start = mav.trim()[0] + np.array([0.05, 0.05, 0.005, 0.005]) * generator.standard_normal(4)
        found.append(problem(data, start).solve(start_values(generator)))
    return Runs(
        np.array([[r.value(n) for n in NAMES] for r in found]),
        np.array([[r.std_white(n) for n in NAMES] for r in found]),
        np.array([[r.std(n) for n in NAMES] for r in found]),
        tuple(found),
    )


def test_every_run_converges_in_few_steps(runs: Runs) -> None:
    assert all(result.converged for result in runs.results)
    assert np.median([result.iterations for result in runs.results]) <= 5


def test_the_standard_error_is_the_published_bound(runs: Runs) -> None:
    """Within 10 %, and half of the last digit that is printed."""
    for name, found in zip(NAMES, runs.white.mean(axis=0), strict=True):
        rounding = {"CD_0": 5e-6, "Cm_0": 5e-6, "accel_bias_x": 5e-5, "accel_bias_z": 5e-5, "theta_scale": 5e-5}
        half_digit = rounding.get(name, 0.02 * BOUND[name])
        assert found == pytest.approx(BOUND[name], rel=0.10, abs=0.1 * BOUND[name] + half_digit), name


def test_the_bound_is_attained(runs: Runs) -> None:
    """Root mean square error over the mean standard error; with 40 runs its own scatter is 11 %."""
    truth = np.array([TRUE[name] for name in NAMES])
    ratio = np.sqrt(np.mean((runs.values - truth) ** 2, axis=0)) / runs.white.mean(axis=0)
    assert dict(zip(NAMES, ratio, strict=True)) == {name: pytest.approx(1.02, abs=0.28) for name in NAMES}
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.1)


def test_there_is_no_bias(runs: Runs) -> None:
    truth = np.array([TRUE[name] for name in NAMES])
    z = (runs.values.mean(axis=0) - truth) / (runs.white.mean(axis=0) / np.sqrt(RUNS))
    assert np.abs(z).max() < 3.5


def test_95_percent_intervals_hold_the_truth_95_times_in_100(runs: Runs) -> None:
    truth = np.array([TRUE[name] for name in NAMES])
    inside = np.abs(runs.values - truth) < 1.96 * runs.std
    assert 0.92 <= inside.mean() <= 0.99
    assert inside.mean(axis=0).min() >= 0.85


def test_white_residuals_leave_the_standard_error_as_it_is(runs: Runs) -> None:
    assert np.median(runs.std / runs.white) == pytest.approx(1.0, abs=0.05)
    for result in runs.results[:5]:
        used = [OUTPUTS.index(name) for name in LONGITUDINAL]
        np.testing.assert_array_less(result.inflation[used], 1.6)


def test_the_noise_found_is_the_noise_put_in(runs: Runs) -> None:
    for name in LONGITUDINAL:
        found = np.mean([result.sigma[OUTPUTS.index(name)] for result in runs.results])
        assert found == pytest.approx(mav.NOISE[name], rel=0.02), name


def test_a_perfect_measurement_gives_the_truth_back() -> None:
    """What is left is where the iteration stops and the difference of two integrators' steps."""
    data = mav.measure(mav.fly(mav.pulse(duration=6.0)), np.random.default_rng(0), noise={})
    result = problem(data, mav.trim()[0]).solve(start_values(np.random.default_rng(1)))
    for name in NAMES:
        assert result.value(name) == pytest.approx(TRUE[name], rel=1e-5, abs=2e-6), name


def test_the_wrong_sample_of_the_command_costs_likelihood() -> None:
    data = mav.measure(mav.fly(mav.pulse(duration=6.0)), np.random.default_rng(0))
    costs = [
        problem(data, mav.trim()[0], command_first=first).solve(dict(mav.COEFFICIENTS)).cost for first in (True, False)
    ]
    assert costs[0] < costs[1] - 10.0


def test_missing_samples_count_for_nothing() -> None:
    """Half of the samples gone at random: standard errors grow by the square root of two."""
    generator = np.random.default_rng(2)
    data = mav.measure(mav.fly(mav.pulse()), generator)
    whole = problem(data, mav.trim()[0]).solve(dict(mav.COEFFICIENTS))
    thin = dict(data.columns)
    keep = np.arange(data.time_s.size) % 2 == 0
    for name in LONGITUDINAL:
        thin[name] = np.where(keep, thin[name], np.nan)
    half = problem(replace(data, columns=thin), mav.trim()[0]).solve(dict(mav.COEFFICIENTS))
    used = [OUTPUTS.index(name) for name in LONGITUDINAL]
    np.testing.assert_array_equal(half.samples[used], 250)
    for name in NAMES:
        assert half.std_white(name) / whole.std_white(name) == pytest.approx(np.sqrt(2.0), rel=0.12), name


def test_sensitivities_are_the_derivatives() -> None:
    """Forward differences of the estimator against central ones with a far larger step, in units of the column."""
    data = mav.measure(mav.fly(mav.pulse(duration=4.0)), np.random.default_rng(0))
    estimator = problem(data, mav.trim()[0])
    theta = estimator.start(TRUE)
    S = estimator.sensitivities(theta, estimator.predict(theta))[0]
    assert S.shape == (200, len(OUTPUTS), len(NAMES) + 4)
    for i in range(theta.size):
        step = 1e-4 * max(1.0, abs(theta[i]))
        ends = []
        for sign in (1.0, -1.0):
            shifted = theta.copy()
            shifted[i] += sign * step
            ends.append(estimator.predict(shifted)[0])
        central = (ends[0] - ends[1]) / (2.0 * step)
        for j, name in enumerate(OUTPUTS):
            size = np.abs(central[:, j]).max()
            np.testing.assert_allclose(S[:, j, i], central[:, j], atol=2e-3 * size + 1e-7, err_msg=f"{name} by {i}")


# --- one number in a held motion: closed forms ---


def held_still(noise: Array, count: int = 1) -> list[Record]:
    """Records in which nothing moves freely; `noise` is what the roll gyro reads, cut into `count` records."""
    n = noise.size
    z = np.full((n, len(OUTPUTS)), np.nan)
    z[:, OUTPUTS.index("p")] = noise
    states = np.tile(np.where(np.arange(9) == 0, 15.0, 0.0), (n, 1))
    record = Record(
        "still", 0.02, 0.02 * np.arange(n), 0, np.zeros((n, 4)), np.full(n, 3.7), np.full(n, 1.225), z, states
    )
    edges = [round(i * n / count) for i in range(count + 1)]
    return [record.window(a, b) for a, b in pairwise(edges)]


def bias_alone(
    records: list[Record], entry: FreeParameter | None = None, sigma: float | None = None
) -> OutputErrorResult:
    """Estimate of the roll gyro's bias and of nothing else."""
    model = Model("mav", {name: Coefficient(value) for name, value in mav.COEFFICIENTS.items()})
    predictor = Predictor(flatten(vehicle(), model), [entry or sensor_error("gyro_bias_p")], records)
    known = None if sigma is None else np.where(np.arange(len(OUTPUTS)) == OUTPUTS.index("p"), sigma, np.nan)
    states = np.zeros(9)
    states[0] = 15.0
    return OutputError(predictor, [states] * len(records), ("p",), known).solve({})


def ar1(phi: float, count: int, generator: np.random.Generator) -> Array:
    """Stationary first-order autoregressive series of unit variance."""
    x = np.empty(count)
    x[0] = generator.standard_normal()
    kick = np.sqrt(1.0 - phi**2) * generator.standard_normal(count)
    for k in range(1, count):
        x[k] = phi * x[k - 1] + kick[k]
    return x


def test_a_bias_alone_is_the_mean_and_its_error_that_of_a_mean() -> None:
    noise = 0.01 + 0.002 * np.random.default_rng(4).standard_normal(900)
    result = bias_alone(held_still(noise, 3))
    assert result.value("gyro_bias_p") == pytest.approx(noise.mean(), abs=1e-9)
    assert result.std_white("gyro_bias_p") == pytest.approx(noise.std() / np.sqrt(900), rel=1e-5)
    assert result.samples[OUTPUTS.index("p")] == 900


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.8, 0.9])
def test_coloured_residuals_widen_the_error_as_theory_says(phi: float) -> None:
    """Variance of the mean of an AR(1) series: sigma^2 / N (1 + phi) / (1 - phi), for N far above its memory."""
    count, stds, whites = 1500, [], []
    for seed in range(12):
        result = bias_alone(held_still(0.002 * ar1(phi, count, np.random.default_rng(seed))))
        stds.append(result.std("gyro_bias_p"))
        whites.append(result.std_white("gyro_bias_p"))
    white = 0.002 / np.sqrt(count)
    assert np.mean(whites) == pytest.approx(white, rel=0.1)
    wanted = white * np.sqrt((1.0 + phi) / (1.0 - phi))
    assert np.sqrt(np.mean(np.square(stds))) == pytest.approx(wanted, rel=0.2)


def test_a_prior_draws_the_estimate_as_bayes_says() -> None:
    noise = 0.01 + 0.002 * np.random.default_rng(5).standard_normal(400)
    entry = replace(sensor_error("gyro_bias_p"), prior_mean=0.02, prior_std=1e-4)
    result = bias_alone(held_still(noise), entry, sigma=0.002)
    told, known = 400 / 0.002**2, 1.0 / 1e-4**2
    wanted = (told * noise.mean() + known * 0.02) / (told + known)
    assert result.value("gyro_bias_p") == pytest.approx(wanted, abs=1e-9)
    assert result.std_white("gyro_bias_p") == pytest.approx((told + known) ** -0.5, rel=1e-5)


def test_an_estimate_stays_inside_its_bounds() -> None:
    noise = 0.01 + 0.002 * np.random.default_rng(6).standard_normal(400)
    result = bias_alone(held_still(noise), replace(sensor_error("gyro_bias_p"), low=-0.005, high=0.005))
    assert result.value("gyro_bias_p") == pytest.approx(0.005, abs=1e-12)


def test_autocorrelation_of_an_ar1_series() -> None:
    """phi^k, until the correlation is lost in its own noise."""
    generator = np.random.default_rng(7)
    kernel = pooled_autocorrelation([ar1(0.8, 4000, generator) for _ in range(5)])
    middle = kernel.size // 2
    np.testing.assert_allclose(kernel[middle : middle + 8], 0.8 ** np.arange(8), atol=0.05)
    np.testing.assert_allclose(kernel, kernel[::-1], atol=1e-12)
    assert pooled_autocorrelation([np.zeros(50)]).tolist() == [1.0]


def test_angles_are_compared_round_the_circle() -> None:
    residual = np.zeros((2, len(OUTPUTS)))
    residual[:, OUTPUTS.index("psi")] = 2.0 * np.pi - 0.01, -2.0 * np.pi + 0.02
    residual[:, OUTPUTS.index("theta")] = 3.5, -3.5
    wrapped = angle_wrap(residual)
    np.testing.assert_allclose(wrapped[:, OUTPUTS.index("psi")], [-0.01, 0.02], atol=1e-12)
    np.testing.assert_allclose(wrapped[:, OUTPUTS.index("theta")], [3.5, -3.5])


def test_a_start_from_which_the_simulation_diverges_is_named_in_one_line() -> None:
    data = mav.measure(mav.fly(mav.pulse(duration=4.0)), np.random.default_rng(0))
    with pytest.raises(EstimationError, match="diverges") as caught:
        problem(data, mav.trim()[0]).solve({"CD_0": -500.0})
    assert "\n" not in str(caught.value)
    assert "mav" in str(caught.value)


def test_slopes_that_diverge_next_to_an_estimate_are_named_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """As late attitude angles make them: the motion itself stays finite, its derivatives do not."""
    data = mav.measure(mav.fly(mav.pulse(duration=4.0)), np.random.default_rng(0))
    estimation = problem(data, mav.trim()[0])
    plain = estimation.sensitivities

    def diverging(theta: Array, predicted: Sequence[Array]) -> list[Array]:
        slopes = plain(theta, predicted)
        slopes[0][-1, :, 0] = np.inf
        return slopes

    monkeypatch.setattr(estimation, "sensitivities", diverging)
    start = estimation.start(dict(mav.COEFFICIENTS))
    for attempt in (lambda: estimation.solve(dict(mav.COEFFICIENTS)), lambda: estimation.step_at(start)):
        with pytest.raises(EstimationError, match=r"nearly diverges.* check units, signs and delays") as caught:
            attempt()
        assert "\n" not in str(caught.value)


def test_a_damped_step_is_newtons_without_damping_and_the_gradients_with_much() -> None:
    information, downhill = np.array([[4.0, 1.0], [1.0, 3.0e4]]), np.array([1.0, -2.0])
    np.testing.assert_allclose(damped_step(information, downhill, 0.0, "f"), np.linalg.inv(information) @ downhill)
    much = 1e9
    np.testing.assert_allclose(
        damped_step(information, downhill, much, "f"), downhill / np.diag(information) / much, rtol=1e-6
    )


def test_an_effect_hidden_in_the_data_is_found_with_its_size() -> None:
    """The vehicle file says that the elevator turns further than it does."""
    data = mav.measure(mav.fly(mav.multisine(duration=10.0)), np.random.default_rng(8))
    halved = dict(data.columns)
    # The linkage turns the elevator only 80 % as far as the command says.
    halved["de"] = data.columns["de"] / 0.8
    record = longitudinal_record(replace(data, columns=halved))
    model = Model("mav", {name: Coefficient(value) for name, value in mav.COEFFICIENTS.items()})
    predictor = Predictor(
        flatten(vehicle(), model),
        [effect_parameter("elevator_gain", "scale"), coefficient("CL_alpha"), *map(sensor_error, SENSORS)],
        [record],
        command_first=True,
    )
    guess = np.zeros(9)
    guess[[0, 2, 4, 7]] = mav.trim()[0]
    result = OutputError(predictor, [guess], LONGITUDINAL).solve({"CL_alpha": 2.6, "elevator_gain.scale": 0.0})
    gain, std = result.value("elevator_gain.scale"), result.std("elevator_gain.scale")
    assert std < 0.002
    assert abs(gain + 0.2) < 4.0 * std
