"""What the sensors' errors, as they are known now, make of an axis' coefficients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.live.recursive.frequency_estimator import VANES, CoefficientEstimates
from sysid.live.signals.air_data_ekf import AirDataError

# Least share of a variance that is left where the noise that two estimates share is taken off.
_LEAST_OWN = 0.25


def corrected(
    axis: str,
    factors: Sequence[tuple[str, ...]],
    estimate: CoefficientEstimates,
    errors: Mapping[str, AirDataError],
    shared: Mapping[str, float],
) -> list[tuple[float, float]]:
    """Each coefficient and its standard error.

    factors: those of each term. shared: by vane, the variance, relative, of what the noise of its samples adds to its
    scale and takes off its derivatives. Noise e of an angle x adds sum(e x) / sum(x^2) to the scale by which the vane
    seems to read x, and takes as much off any coefficient of x, whatever else is fitted: in the product of both it is
    not there.
    """
    values, variances = estimate.values.tolist(), np.diag(estimate.covariance).tolist()
    found = []
    for value, variance, chosen in zip(values, variances, factors, strict=True):
        for vane in VANES:
            error = errors.get(f"{vane}_scale")
            if chosen == (vane,) and error is not None and error.observed:
                own = [max(one - shared[vane], _LEAST_OWN * one) for one in (variance / value**2, error.std**2)]
                value *= 1.0 + error.value
                variance = sum(own) * value**2
        if not chosen and errors:
            shift, doubt = _bias_in_constant(axis, estimate, errors)
            value, variance = value + shift, variance + doubt
        found.append((value, float(np.sqrt(max(variance, 0.0)))))
    return found


def _bias_in_constant(
    axis: str, estimate: CoefficientEstimates, errors: Mapping[str, AirDataError]
) -> tuple[float, float]:
    """What takes the vanes' biases off a constant, and the variance that their errors leave."""
    gains: dict[str, float] = {}
    for vane in VANES:
        if f"{axis}_{vane}" in estimate.names:
            gains[f"{vane}_bias"] = float(estimate.values[estimate.names.index(f"{axis}_{vane}")])
    shift = sum(gain * errors[name].value for name, gain in gains.items())
    doubt = sum((gain * errors[name].std) ** 2 for name, gain in gains.items())
    return shift, doubt
