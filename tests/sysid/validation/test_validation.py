import json

import numpy as np
import pytest
from scipy import signal, stats

from sysid.errors import EstimationError
from sysid.numerics.statistics import autoregressive_innovations, effective_count, gaussian_p, sample_autocorrelation
from sysid.validation.statistics import validate, validate_output

TIME = 0.02 * np.arange(1500)
TRUTH = np.sin(2.0 * TIME) + 0.5


def test_theils_coefficient_by_hand():
    z, y = np.array([1.0, 2.0, 3.0, 4.0] * 10), np.array([1.0, 2.0, 3.0, 2.0] * 10)
    out = validate_output(z, y)
    assert out.tic == pytest.approx(1.0 / (np.sqrt(7.5) + np.sqrt(4.5)))
    assert out.r2 == pytest.approx(1.0 - 1.0 / 1.25)
    assert out.residual_mean == pytest.approx(0.5)
    assert out.tic_bias + out.tic_variance + out.tic_covariance == pytest.approx(1.0)
    assert out.tic_bias == pytest.approx(0.25)


def test_the_parts_tell_bias_from_scale_from_noise():
    rng = np.random.default_rng(0)
    assert validate_output(TRUTH + 1.0, TRUTH).tic_bias == pytest.approx(1.0)
    assert validate_output(2.0 * (TRUTH - TRUTH.mean()), TRUTH - TRUTH.mean()).tic_variance == pytest.approx(1.0)
    assert validate_output(TRUTH + 0.1 * rng.standard_normal(TIME.size), TRUTH).tic_covariance > 0.95


def test_white_gaussian_residuals_pass_and_others_do_not():
    rng = np.random.default_rng(1)
    good = [validate_output(TRUTH + 0.1 * rng.standard_normal(TIME.size), TRUTH) for _ in range(200)]
    assert np.mean([out.white for out in good]) == pytest.approx(0.95, abs=0.015)
    # Probabilities of a true hypothesis are uniform.
    assert np.mean([out.gaussian_p < 0.05 for out in good]) == pytest.approx(0.05, abs=0.05)
    assert stats.kstest([out.gaussian_p for out in good], "uniform").pvalue > 1e-3
    bad = validate_output(TRUTH + 0.1 * rng.standard_exponential(TIME.size), TRUTH)
    assert bad.gaussian_p < 1e-6
    assert validate_output(1.1 * TRUTH, TRUTH).white < 0.3


def test_coloured_gaussian_residuals_are_still_gaussian():
    rng = np.random.default_rng(2)
    p = [gaussian_p(signal.lfilter([1.0], [1.0, -1.6, 0.8], rng.standard_normal(1200))[200:]) for _ in range(200)]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.05)


def test_whitening_and_effective_count():
    rng = np.random.default_rng(3)
    coloured = signal.lfilter([1.0], [1.0, -0.9], rng.standard_normal(20000))
    assert np.abs(sample_autocorrelation(autoregressive_innovations(coloured), 20)[1:]).max() < 0.03
    # An AR(1) series of phi is worth (1 - phi)/(1 + phi) of its samples.
    assert effective_count(coloured) == pytest.approx(20000 * 0.1 / 1.9, rel=0.4)


def test_the_mean_is_judged_with_its_correlation():
    rng = np.random.default_rng(4)
    z_values = []
    for _ in range(100):
        coloured = signal.lfilter([1.0], [1.0, -0.9], rng.standard_normal(2000))[500:]
        z_values.append(validate_output(TRUTH + coloured, TRUTH).mean_z)
    assert np.mean(np.abs(z_values) > 1.96) < 0.15


def test_verdict_and_limit():
    rng = np.random.default_rng(5)
    noise = 0.05 * rng.standard_normal(TIME.size)
    good = validate({"CL": TRUTH + noise, "CD": TRUTH}, {"CL": TRUTH})
    assert good.acceptable
    assert set(good.outputs) == {"CL"}
    bad = validate({"CL": TRUTH + noise}, {"CL": -TRUTH})
    assert not bad.acceptable
    assert "fly again" in bad.reason
    still = validate({"beta": noise}, {"beta": np.zeros(TIME.size)}, noise={"beta": 0.05})
    assert still.acceptable
    assert still.outputs["beta"].tic == pytest.approx(1.0)
    assert still.outputs["beta"].rms_over_noise == pytest.approx(1.0, rel=0.1)


def test_perfect_and_constant_series_give_json_without_nan():
    for z, y in ((TRUTH, TRUTH), (np.ones(100), np.ones(100)), (np.zeros(100), np.zeros(100))):
        written = json.dumps(validate_output(z, y).to_json(), allow_nan=False)
        assert json.loads(written)["tic"] == 0.0


@pytest.mark.parametrize(
    ("z", "y", "message"),
    [(np.ones(30), np.ones(29), "30 measured and 29"), (np.full(30, np.nan), np.ones(30), "0 samples in common")],
)
def test_nothing_to_compare_is_refused(z, y, message):
    with pytest.raises(EstimationError, match=message):
        validate_output(z, y)
