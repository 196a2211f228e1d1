"""Noise of the outputs and turbulence that make a filtered flight likeliest, the parameters as they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.arrays import Array
from sysid.filter_error.kalman import variance_gradient, variance_pass
from sysid.filter_error.linearised_flight import FilteredFlight, LinearisedRecord
from sysid.numerics.dryden import DEFAULT_LENGTH_M, Turbulence

FAINT = 0.003  # m/s, below any sensor
SEARCH_S = 60.0  # of flight, from which noise and turbulence are estimated
_STEPS = 30
_NUDGE = 1e-5
_REACH = 1.5  # of a logarithm, the longest step
# What a step that loses is shortened by, and its share from which on there is no way up any more.
_SHORTER, _SHORTEST = 0.4, 1e-3
# Of log likelihood, and its share of all that was gained, below which a step is the last one.
_ENOUGH, _LITTLE = 0.05, 0.003


@dataclass(frozen=True)
class NoiseParameters:
    """Logarithms eta of m noise variances and of the turbulence's numbers `names`, with what is known of them.

    middle, weight: mean and information of a Gaussian prior. low, high: bounds.
    """

    names: tuple[str, ...]
    middle: Array
    weight: Array
    low: Array
    high: Array

    def eta(self, noise: Array, turbulence: Turbulence) -> Array:
        """Logarithms of given noise (m,) and turbulence, within the bounds."""
        rough = [max(getattr(turbulence, name), FAINT) for name in self.names]
        return np.asarray(np.clip(np.concatenate((np.log(noise), np.log(rough))), self.low, self.high))

    def values(self, eta: Array, turbulence: Turbulence) -> tuple[Array, Turbulence]:
        """Noise (m,) and turbulence at eta."""
        m = eta.size - len(self.names)
        return np.exp(eta[:m]), replace(turbulence, **dict(zip(self.names, np.exp(eta[m:]).tolist(), strict=True)))

    def cost(self, eta: Array) -> float:
        """Half the squared distance from what is known."""
        return 0.5 * float(np.sum(self.weight * (eta - self.middle) ** 2))


def surroundings(flight: FilteredFlight) -> NoiseParameters:
    """What is known before: noise as high frequencies show it, a scale length of gusts to a factor of three."""
    axes = set(np.concatenate(flight.axes).tolist())
    names = (*(("horizontal",) if axes & {0, 1} else ()), *(("vertical",) if 2 in axes else ()), "length")
    log_noise, rough = np.log(flight.noise), len(names) - 1
    return NoiseParameters(
        names,
        np.concatenate((log_noise, np.zeros(rough), [np.log(DEFAULT_LENGTH_M)])),
        np.concatenate((np.full(log_noise.size, 1.0 / 9.0), np.full(rough, 1e-4), [1.0])),
        np.concatenate((log_noise - 7.0, np.full(rough, np.log(FAINT)), [np.log(5.0)])),
        np.concatenate((log_noise + 9.0, np.full(rough, np.log(5.0)), [np.log(300.0)])),
    )


def likeliest_noise(
    flight: FilteredFlight,
    linear: Sequence[LinearisedRecord],
    noise: Array,
    turbulence: Turbulence,
    search_s: float = SEARCH_S,
) -> tuple[Array, Turbulence]:
    """Noise variances (m,) and turbulence of greatest likelihood about the same paths, by scoring.

    search_s: of flight to look at; whole records are.
    """
    known = surroundings(flight)
    chosen, total = 0, 0.0
    for record in flight.records:
        chosen, total = chosen + 1, total + record.length * record.interval_s
        if total >= search_s:
            break
    eta = known.eta(noise, turbulence)
    value, slope, curvature = _scores(flight, linear[:chosen], eta, known, turbulence)
    value, slope = value - known.cost(eta), slope - known.weight * (eta - known.middle)
    curvature += np.diag(known.weight + 1e-9)
    first, share = value, 1.0
    for _ in range(_STEPS):
        free = ~(((eta <= known.low) & (slope < 0.0)) | ((eta >= known.high) & (slope > 0.0)))
        step = np.zeros(eta.size)
        step[free] = share * np.linalg.solve(curvature[np.ix_(free, free)], slope[free])
        trial = np.clip(eta + np.clip(step, -_REACH, _REACH), known.low, known.high)
        there, downhill = _gradient(flight, linear[:chosen], trial, known, turbulence)
        gained, downhill = there - known.cost(trial) - value, downhill - known.weight * (trial - known.middle)
        if np.isfinite(gained):
            curvature = _curved(curvature, trial - eta, slope - downhill)
        if not gained > -1e-6:
            share *= _SHORTER
            if share < _SHORTEST:
                break
            continue
        eta, value, slope, share = trial, value + gained, downhill, 1.0
        if gained < max(_ENOUGH, _LITTLE * (value - first)):
            break
    return known.values(eta, turbulence)


def _curved(curvature: Array, step: Array, bent: Array) -> Array:
    """Curvature (n, n) corrected by how much the slope bent along a step: BFGS, damped so that it stays positive.

    The expected information is what a right model has; far from the top of a wrong one's likelihood it can be off by
    any factor. Source: Nocedal & Wright, "Numerical Optimization", procedure 18.2 (Powell's damping).
    """
    along = curvature @ step
    whole = float(step @ along)
    if not whole > 0.0:
        return curvature
    seen = float(step @ bent)
    share = 1.0 if seen >= 0.2 * whole else 0.8 * whole / (whole - seen)
    mixed = share * bent + (1.0 - share) * along
    return np.asarray(curvature - np.outer(along, along) / whole + np.outer(mixed, mixed) / float(step @ mixed))


def _gradient(
    flight: FilteredFlight,
    linear: Sequence[LinearisedRecord],
    eta: Array,
    known: NoiseParameters,
    turbulence: Turbulence,
) -> tuple[float, Array]:
    """Log likelihood and gradient of the logarithms of noise variances and turbulence."""
    likelihood, gradient = 0.0, np.zeros(eta.size)
    for arguments in _arguments(flight, linear, eta, known, turbulence):
        passed = variance_gradient(*arguments)
        likelihood, gradient = likelihood + passed[0], gradient + passed[1]
    return float(likelihood) if np.isfinite(likelihood) else -np.inf, gradient


def _scores(
    flight: FilteredFlight,
    linear: Sequence[LinearisedRecord],
    eta: Array,
    known: NoiseParameters,
    turbulence: Turbulence,
) -> tuple[float, Array, Array]:
    """Log likelihood, gradient and information of the logarithms of noise variances and turbulence."""
    likelihood, gradient, information = 0.0, np.zeros(eta.size), np.zeros((eta.size, eta.size))
    for arguments in _arguments(flight, linear, eta, known, turbulence):
        passed = variance_pass(*arguments)
        likelihood, gradient, information = likelihood + passed[0], gradient + passed[1], information + passed[2]
    return float(likelihood) if np.isfinite(likelihood) else -np.inf, gradient, information


def _arguments(
    flight: FilteredFlight,
    linear: Sequence[LinearisedRecord],
    eta: Array,
    known: NoiseParameters,
    turbulence: Turbulence,
) -> Iterator[tuple[Array, ...]]:
    """What the passes of `sysid.filter_error.kalman` take, record by record."""
    noise, here = known.values(eta, turbulence)
    for k, one in enumerate(linear):
        system = flight.system(k, one, here)
        moved = [
            flight.system(k, one, replace(here, **{name: getattr(here, name) * (1.0 + _NUDGE)})) for name in known.names
        ]
        change = [
            np.array([(getattr(other, part) - getattr(system, part)) / _NUDGE for other in moved])
            for part in ("transition", "process", "p_start")
        ]
        yield (
            system.transition, system.drift, system.left, system.observe, system.jump, noise, system.process,
            system.p_start, *change,
        )  # fmt: skip
