"""Least squares with covariance, 1e6 samples of 10 regressors, against statsmodels and numpy.

Run: python benchmarks/regression.py
"""

from __future__ import annotations

import os

# One thread on every side: the machine is shared, and two gain nothing here.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import statsmodels.api as sm
from telemetry import compare

from sysid.equation_error.least_squares import gram_regress

SAMPLES, REGRESSORS = 1_000_000, 10


def main() -> None:
    """Print the ratios and how far the results differ."""
    generator = np.random.default_rng(1)
    X = generator.standard_normal((SAMPLES, REGRESSORS)) * 10.0 ** generator.uniform(-3.0, 3.0, REGRESSORS)
    y = X @ generator.standard_normal(REGRESSORS) + generator.standard_normal(SAMPLES)

    def peer() -> tuple[np.ndarray, np.ndarray]:
        fitted = sm.OLS(y, X).fit()
        return fitted.params, fitted.cov_params()

    def singular_values() -> tuple[np.ndarray, np.ndarray]:
        values, rest, _, _ = np.linalg.lstsq(X, y, rcond=None)
        return values, rest / (SAMPLES - REGRESSORS) * np.linalg.inv(X.T @ X)

    def own() -> tuple[np.ndarray, np.ndarray]:
        values, covariance, _ = gram_regress(y, X)
        return values, covariance

    runs = {"statsmodels OLS": peer, "numpy lstsq and inverse": singular_values, "gram_regress": own}
    compare(
        "regression, 1e6 x 10, coefficients and covariance", "samples", dict.fromkeys(runs, float(SAMPLES)), runs, 5
    )
    values, covariance = own()
    theirs, spread = peer()
    std = np.sqrt(np.diag(spread))
    print(f"  largest difference of a coefficient: {np.max(np.abs(values - theirs) / std):.1e} standard errors")
    print(f"  largest difference of a covariance: {np.max(np.abs(covariance - spread) / np.outer(std, std)):.1e} of it")


if __name__ == "__main__":
    main()
