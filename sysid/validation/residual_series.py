"""What a report draws of a flight: measured and predicted coefficients, and statistics of residuals, in few numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import fft

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array, IntArray
from sysid.errors import SysidError
from sysid.problem.coefficient_residuals import CoefficientPath, coefficient_path
from sysid.problem.free_run import Fixed
from sysid.signals.preparation import Prepared
from sysid.signals.record import OUTPUTS

#: Points per signal, of all flights together; digits of each number.
POINTS, DIGITS = 300, 5
_BINS = 31
_LAGS_S, _LAGS = 1.0, 50
# Below this share of samples (GPS beside an IMU) a lag in samples means nothing.
_DENSE = 0.5


@dataclass(frozen=True)
class ModelComparison:
    """Flights and the model they are compared with. axes: coefficients of which the model holds a value."""

    flights: tuple[Prepared, ...]
    vehicle: Vehicle
    model: Fixed
    axes: tuple[str, ...]

    @cached_property
    def paths(self) -> tuple[tuple[CoefficientPath, ...], ...]:
        """Per flight and stretch, the coefficients along it. Raises SysidError."""
        return tuple(
            tuple(coefficient_path(s.record, flight.layout, self.vehicle, self.model) for s in flight.stretches)
            for flight in self.flights
        )


def series_json(compared: ModelComparison, use: str) -> dict[str, Any]:
    """The block `series` of a result, without the residuals of the outputs (`output_residuals`).

    use: "validation" or "estimation", what the flights of `compared` were for.
    """
    found: dict[str, Any] = {"use": use}
    try:
        found["flights"] = _flights(compared)
        found["residuals"] = {axis: _coefficient_residual(compared, axis) for axis in compared.axes}
    except SysidError as error:
        found |= {"flights": [], "residuals": {}, "refused": str(error)}
    return found


def _flights(compared: ModelComparison) -> list[dict[str, Any]]:
    share = max(POINTS // len(compared.flights), 8)
    found = []
    for flight, paths in zip(compared.flights, compared.paths, strict=True):
        time = np.concatenate([path.time_s for path in paths])
        alpha = np.concatenate([path.variables["alpha"] for path in paths])
        axes = {}
        for axis in compared.axes:
            measured = np.concatenate([path.measured[axis] for path in paths])
            predicted = np.concatenate([path.predicted[axis] for path in paths])
            kept = extremes(measured, predicted, share)
            columns = {"time_s": time, "alpha": alpha, "measured": measured, "predicted": predicted}
            axes[axis] = {name: rounded(column[kept]) for name, column in columns.items()}
        found.append({"flight": flight.data.name, "axes": axes})
    return found


def extremes(first: Array, second: Array, points: int) -> IntArray:
    """Indices, in order, of the smallest and largest of each of two signals in each of points / 4 stretches.

    first, second: (N,). Both are kept at the same instants, so that their difference is that of the flight. All indices
    where N <= points.
    """
    if first.size <= points:
        return np.arange(first.size)
    edges = np.linspace(0, first.size, points // 4 + 1).astype(np.int64)
    kept: set[int] = set()
    for start, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        for part in (first[start:stop], second[start:stop]):
            kept |= {start + int(np.argmin(part)), start + int(np.argmax(part))}
    return np.array(sorted(kept), dtype=np.int64)


def rounded(values: Array) -> list[float]:
    """Numbers of DIGITS significant digits.

    Parameters
    ----------
    values : Array, shape (N,)
        Numbers, in any unit.

    Returns
    -------
    list[float], length N
        The same numbers rounded, in the same unit.
    """
    return [float(f"{value:.{DIGITS}g}") for value in values.tolist()]


def _coefficient_residual(compared: ModelComparison, axis: str) -> dict[str, Any]:
    """Autocorrelation and histogram of one coefficient's residual over all stretches, at the full rate."""
    paths = [path for flight in compared.paths for path in flight]
    residuals = [path.measured[axis] - path.predicted[axis] for path in paths]
    values = np.concatenate(residuals)
    values = values[np.isfinite(values)]
    counts, edges = np.histogram(values, _BINS)
    return {
        **_autocorrelation(residuals, compared.flights[0].data.interval_s),
        "mean": float(values.mean()),
        "std": float(values.std(ddof=1)),
        "histogram": {"low": float(edges[0]), "high": float(edges[-1]), "counts": counts.tolist()},
    }


def output_residuals(residuals: Sequence[Array], interval_s: float) -> dict[str, dict[str, Any]]:
    """Per measured output the autocorrelation of its residuals, pooled over runs.

    An output that is measured at too few of the samples (GPS beside an IMU) is left out.

    Parameters
    ----------
    residuals : Sequence[Array], each of shape (N, 15)
        For each run the residuals in the order of OUTPUTS, SI units and rad, NaN where missing.
    interval_s : float
        Sampling interval, s.

    Returns
    -------
    dict[str, dict[str, Any]]
        Name of OUTPUTS -> step of the lags [s], normalised autocorrelation (dimensionless), its limit for a white
        series (dimensionless), and the count of samples.
    """
    found = {}
    for j, name in enumerate(OUTPUTS):
        columns = [run[:, j] for run in residuals]
        if np.mean(np.concatenate([np.isfinite(column) for column in columns])) >= _DENSE:
            found[name] = _autocorrelation(columns, interval_s)
    return found


def _autocorrelation(parts: Sequence[Array], interval_s: float) -> dict[str, Any]:
    """Normalised autocorrelation about the common mean, lags 0 to 1 s within each part; missing samples left out.

    limit: 1.96 / sqrt(N), within which 95 % of the values of a white series of N samples lie (Klein & Morelli, ch. 5).
    """
    longest = min(round(_LAGS_S / interval_s), max(part.size for part in parts) - 1)
    samples = sum(int(np.count_nonzero(np.isfinite(part))) for part in parts)
    mean = sum(float(np.nansum(part)) for part in parts) / max(samples, 1)
    products, pairs = np.zeros(longest + 1), np.zeros(longest + 1)
    for part in parts:
        there = np.isfinite(part)
        products += _lagged(np.where(there, part - mean, 0.0), longest)
        pairs += np.round(_lagged(there.astype(np.float64), longest))
    covariance = products / np.maximum(pairs, 1.0)
    stride = max(-(-longest // _LAGS), 1)
    rho = covariance / covariance[0] if covariance[0] > 0.0 else np.eye(1, longest + 1)[0]
    return {
        "lag_step_s": stride * interval_s,
        "autocorrelation": rounded(rho[::stride]),
        "limit": float(1.96 / np.sqrt(max(samples, 1))),
        "samples": samples,
    }


def _lagged(values: Array, lags: int) -> Array:
    """Sums of products (lags + 1,) of a series (N,) with itself shifted."""
    size = fft.next_fast_len(values.size + lags, real=True)
    return np.asarray(fft.irfft(np.abs(fft.rfft(values, size)) ** 2, size)[: lags + 1], dtype=np.float64)
