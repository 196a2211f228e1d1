"""How well a model predicts a flight that it was not fitted to.

TIC and R2 are what readers expect, but do not discriminate: a control derivative 40 % wrong can pass TIC 0.1. So
residual size against sensor noise, mean and whiteness stand beside them.
Sources: Jategaonkar, "Flight Vehicle System Identification", chapter 11 (TIC and its parts: H. Theil, 1970);
Klein & Morelli, chapter 5 (R2, whiteness).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.numerics.statistics import effective_count, gaussian_p, sample_autocorrelation
from sysid.validation.largest_residual import Largest

TIC_LIMIT = 0.25  # Theil's inequality coefficient that is customarily acceptable


@dataclass(frozen=True)
class OutputValidation:
    """Measured z against predicted y of one output.

    tic: Theil's inequality coefficient, rms(z - y) / (rms z + rms y). tic_bias, tic_variance, tic_covariance: shares of
    the mean square error due to mean, to standard deviation and to lack of correlation; they sum to 1 (None for a
    residual of zero). r2: 1 - residual over variance of z (None for a constant z).
    residual_mean, residual_std: unit of the output. mean_z: mean over its own standard error, correlation allowed for.
    white: share of autocorrelations (lag 1..) within 1.96/sqrt(N). gaussian_p: after whitening; None if too short.
    rms_over_noise: residual rms over the sensor's sigma, where given.
    """

    tic: float
    tic_bias: float | None
    tic_variance: float | None
    tic_covariance: float | None
    r2: float | None
    residual_mean: float
    residual_std: float
    mean_z: float | None
    white: float
    gaussian_p: float | None
    rms_over_noise: float | None

    def to_json(self) -> dict[str, float | None]:
        """All figures by name, as the result file has them."""
        return dict(vars(self))


@dataclass(frozen=True)
class Validation:
    """All outputs, the verdict, and what it rests on. limit: largest TIC that counts as acceptable.

    largest: output -> its largest residual, where its noise is known.
    """

    outputs: dict[str, OutputValidation]
    acceptable: bool
    limit: float
    reason: str
    largest: dict[str, Largest] = field(default_factory=dict)


def validate_output(z: Array, y: Array, noise: float | None = None) -> OutputValidation:
    """Compare one measured output with its prediction.

    z, y: (N,) measured and predicted, one unit; samples where either is NaN are left out. noise: sensor's sigma.
    Raises EstimationError for shapes that differ or fewer than 20 common samples.
    """
    z, y = np.asarray(z, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if z.shape != y.shape:
        raise EstimationError(f"validation: {z.shape[0]} measured and {y.shape[0]} predicted samples")
    both = np.isfinite(z) & np.isfinite(y)
    if np.count_nonzero(both) < 20:
        raise EstimationError(f"validation: {np.count_nonzero(both)} samples in common, 20 are the least")
    z, y = z[both], y[both]
    v = z - y
    square = float(np.mean(v**2))
    size = float(np.sqrt(np.mean(z**2)) + np.sqrt(np.mean(y**2)))
    spread = float(np.var(z))
    shares: tuple[float | None, float | None, float | None] = (None, None, None)
    if square > 0.0:
        covariance = float(np.mean((z - z.mean()) * (y - y.mean())))
        shares = (
            float((z.mean() - y.mean()) ** 2 / square),
            float((z.std() - y.std()) ** 2 / square),
            2.0 * (float(z.std() * y.std()) - covariance) / square,
        )
    lags = max(min(v.size // 5, 100), 1)
    rho = sample_autocorrelation(v, lags)[1:]
    std = float(v.std(ddof=1))
    independent = effective_count(v)
    return OutputValidation(
        float(np.sqrt(square)) / size if size > 0.0 else 0.0,
        *shares,
        1.0 - square / spread if spread > 0.0 else None,
        float(v.mean()),
        std,
        float(v.mean()) / (std / np.sqrt(independent)) if std > 0.0 else None,
        float(np.mean(np.abs(rho) <= 1.96 / np.sqrt(v.size))),
        gaussian_p(v),
        float(np.sqrt(square)) / noise if noise else None,
    )


def validate(
    measured: Mapping[str, Array],
    predicted: Mapping[str, Array],
    noise: Mapping[str, float] | None = None,
    limit: float = TIC_LIMIT,
) -> Validation:
    """Compare every predicted output with its measurement and judge the model.

    measured, predicted: output -> (N,). noise: output -> sensor's sigma. limit: largest TIC accepted.
    An output whose residual is no more than twice its sensor's noise passes whatever its TIC: one that hardly moves has
    a TIC near 1 from noise alone.
    Raises EstimationError where nothing can be compared.
    """
    names = [name for name in predicted if name in measured]
    if not names:
        raise EstimationError("validation: no predicted output is measured")
    noise = noise or {}
    outputs = {name: validate_output(measured[name], predicted[name], noise.get(name)) for name in names}
    worse = [
        f"{name} {out.tic:.2f}"
        for name, out in outputs.items()
        if out.tic > limit and not (out.rms_over_noise is not None and out.rms_over_noise <= 2.0)
    ]
    reason = (
        f"TIC above {limit:g}: {', '.join(worse)}; fly again"
        if worse
        else f"every TIC at most {limit:g}, or the residual near the noise"
    )
    return Validation(outputs, not worse, limit, reason)
