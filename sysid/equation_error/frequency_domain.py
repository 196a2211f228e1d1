"""Equation error in the frequency domain: finite Fourier transforms over the band of the manoeuvre.

Biases and drifts lie outside the band, and so does most of the noise. Each part is transformed at the multiples of the
inverse of its own length, at which a constant has no transform, by the chirp-z transform; the derivative of angular
momentum h becomes j w H plus its end terms, which a record that does not end where it began needs.
Sources: E. A. Morelli, "Real-time parameter estimation in the frequency domain", Journal of Guidance, Control, and
Dynamics 23(5), 2000; Klein & Morelli, chapter 7; H. White, Econometrica 48, 1980 (errors for a spectrum not flat).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.model.aerodynamic_terms import Term
from sysid.arrays import Array
from sysid.equation_error.equations import CONTROLS, MOMENTS, Equations, PartEquations
from sysid.errors import EstimationError
from sysid.numerics.smoothing import fourier_smooth

Complex = NDArray[np.complex128]

# Shares of the commands' power below and above the band.
_BELOW, _ABOVE = 0.01, 0.03
_COHERENCE_LINES = 7


@dataclass(frozen=True)
class FrequencyResult:
    """Complex least squares of one axis.

    names: P terms, constants left out. values, std: (P,), errors for residuals whose spectrum is not flat.
    covariance: (P, P). r2: share of the power in the band that the model explains. frequencies_hz: (M,) lines of all
    parts; coherence: (M,) between measured and modelled coefficient, averaged over neighbouring lines.
    band_hz: the band.
    """

    names: tuple[str, ...]
    values: Array
    std: Array
    covariance: Array
    r2: float
    frequencies_hz: Array
    coherence: Array
    band_hz: tuple[float, float]


def band_of(equations: Equations) -> tuple[float, float]:
    """The band in which the commands have their power, Hz. Raises EstimationError where none moved."""
    edges: list[tuple[float, float]] = []
    for part in equations.parts:
        commands = [part.factor(name) for name in CONTROLS if part.has(name)]
        moving = [u - u.mean() for u in commands if np.ptp(u) > 0.0]
        if not moving:
            continue
        dt, size = equations.interval_s, moving[0].size
        power = np.sum([np.abs(np.fft.rfft(u * np.hanning(size))) ** 2 for u in moving], axis=0)
        frequency = np.fft.rfftfreq(size, dt)
        share = np.cumsum(power[1:]) / np.sum(power[1:])
        low, high = (float(np.interp(level, share, frequency[1:])) for level in (_BELOW, 1.0 - _ABOVE))
        edges.append((low, high))
    if not edges:
        raise EstimationError("frequency domain: no command moved; fly a multisine or a 3-2-1-1")
    highest = min(max(high for _, high in edges), equations.cutoff_hz)
    return min(low for low, _ in edges), highest


def frequency_regression(
    equations: Equations, axis: str, terms: Sequence[Term], band_hz: tuple[float, float] | None = None
) -> FrequencyResult:
    """Regress one axis in the frequency domain.

    equations: of corrected parts. terms: of this axis; constants are of no account in the band. band_hz: None takes
    `band_of`. Raises EstimationError for too few lines or terms that cannot be distinguished.
    """
    low, high = band_of(equations) if band_hz is None else band_hz
    chosen = [term for term in terms if term.factors]
    constants = [term for term in terms if not term.factors]
    sides = [
        _transformed(part, axis, [*chosen, *constants], equations.interval_s, low, high) for part in equations.parts
    ]
    y = np.concatenate([side[1] for side in sides])
    # A drift has a transform in the band; each part has its own.
    width = len(chosen) + len(constants)
    X = np.zeros((y.size, width + len(sides)), dtype=np.complex128)
    row = 0
    for i, (_, _, columns, drift) in enumerate(sides):
        X[row : row + columns.shape[0], :width] = columns
        X[row : row + columns.shape[0], width + i] = drift
        row += columns.shape[0]
    names = [term.name for term in chosen]
    if 2 * y.size < 2 * X.shape[1] + 2 or not names:
        raise EstimationError(
            f"frequency domain: {y.size} lines between {low:.2f} and {high:.2f} Hz are too few for {X.shape[1]} numbers"
        )
    size = np.sqrt(np.sum(np.abs(X) ** 2, axis=0))
    moving = size > 1e-9 * np.max(size)
    if not moving[: len(chosen)].all():
        still = names[int(np.argmin(size[: len(chosen)]))]
        raise EstimationError(f"frequency domain: {still} does not move between {low:.2f} and {high:.2f} Hz")
    values, covariance, residual = _complex_least_squares(y, X[:, moving], names)
    frequencies = np.concatenate([side[0] for side in sides])
    return FrequencyResult(
        tuple(names),
        values,
        np.sqrt(np.diag(covariance)),
        covariance,
        1.0 - float(np.sum(np.abs(residual) ** 2) / np.sum(np.abs(y) ** 2)),
        frequencies,
        np.concatenate([_coherence(a, b) for a, b in _by_part(sides, y, y - residual)]),
        (low, high),
    )


def _transformed(
    part: PartEquations, axis: str, terms: Sequence[Term], interval_s: float, low: float, high: float
) -> tuple[Array, Complex, Complex, Complex]:
    """Frequencies (M,), regressand (M,), columns (M, P) and drift (M,) of one part."""
    columns = np.column_stack([part.column(term) for term in terms])
    count = columns.shape[0]
    duration = (count - 1) * interval_s
    lines = np.arange(max(int(np.ceil(low * duration)), 1), min(int(high * duration), (count - 1) // 2) + 1)
    omega = 2.0 * np.pi * lines / duration

    def transform(values: Array) -> Complex:
        """Trapezoidal rule of the finite Fourier integral at the lines, where both ends have the same phase."""
        periodic = np.array(values[:-1], dtype=np.float64)
        periodic[0] = 0.5 * (values[0] + values[-1])
        return np.asarray(interval_s * np.fft.rfft(periodic, axis=0)[lines], dtype=np.complex128)

    if axis in MOMENTS:
        momentum = part.momentum[axis]
        ends = fourier_smooth(momentum, interval_s, part.cutoff_hz).values
        # At the lines exp(-j w t) is 1 at either end.
        y = 1j * omega * transform(momentum) + (ends[-1] - ends[0]) + transform(part.rest[axis])
    else:
        y = transform(part.force[axis])
    drift = transform(np.linspace(-1.0, 1.0, count))
    return lines / duration, y, transform(columns), drift


def _complex_least_squares(y: Complex, X: Complex, names: Sequence[str]) -> tuple[Array, Array, Complex]:
    """Values (P,), covariance (P, P) of the first P columns, residual (M,)."""
    scale = np.sqrt(np.sum(np.abs(X) ** 2, axis=0))
    design = np.vstack([X.real, X.imag]) / scale
    target = np.concatenate([y.real, y.imag])
    singular = np.linalg.svd(design, compute_uv=False)
    if singular[-1] < 1e-8 * singular[0]:
        raise EstimationError(
            f"frequency domain: {', '.join(names)} cannot be distinguished in the band; leave some out"
        )
    inverse = np.linalg.inv(design.T @ design)
    solution = inverse @ (design.T @ target)
    residual = target - design @ solution
    free = target.size - design.shape[1]
    # White's estimate, with the residuals of each line taking its leverage into account (HC2).
    leverage = np.minimum(np.einsum("ij,jk,ik->i", design, inverse, design), 1.0 - 1e-9)
    middle = (design * (residual**2 / (1.0 - leverage))[:, None]).T @ design
    robust = inverse @ middle @ inverse
    flat = float(residual @ residual) / max(free, 1) * inverse
    # Neither may be far off: the larger of both, since few lines make either too small by chance.
    growth = np.sqrt(np.maximum(np.diag(robust) / np.diag(flat), 1.0))
    covariance = flat * np.outer(growth, growth) / np.outer(scale, scale)
    count = len(names)
    half = y.size
    return (solution / scale)[:count], covariance[:count, :count], residual[:half] + 1j * residual[half:]


def _by_part(
    sides: Sequence[tuple[Array, Complex, Complex, Complex]], y: Complex, fitted: Complex
) -> list[tuple[Complex, Complex]]:
    edges = np.cumsum([0, *(side[1].size for side in sides)])
    return [(y[a:b], fitted[a:b]) for a, b in pairwise(edges)]


def _coherence(measured: Complex, modelled: Complex) -> Array:
    window = np.ones(min(_COHERENCE_LINES, measured.size))

    def mean(values: Complex) -> Complex:
        return np.convolve(values, window, mode="same") if values.size else values

    cross = np.abs(mean(measured * np.conj(modelled))) ** 2
    powers = mean(np.abs(measured) ** 2 + 0j).real * mean(np.abs(modelled) ** 2 + 0j).real
    return np.asarray(cross / np.maximum(powers, 1e-300), dtype=np.float64)
