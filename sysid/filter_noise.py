"""Noise of the outputs and turbulence that make a filtered flight likeliest, the parameters as they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.dryden import DEFAULT_LENGTH_M, Turbulence
from sysid.filter_path import FilteredFlight, Linear
from sysid.filter_variances import variance_gradient, variance_pass
from sysid.flight import Array

FAINT = 0.003  # m/s, below any sensor
SEARCH_S = 60.0  # of flight, from which noise and turbulence are estimated
_STEPS = 15
_NUDGE = 1e-5
# Change of a logarithm beyond which the information of another place leads astray.
_STALE = 2.0
# Of log likelihood, and its share of all that was gained, below which a step is the last one.
_ENOUGH, _LITTLE = 0.05, 0.003


@dataclass(frozen=True)
class Surroundings:
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


def surroundings(flight: FilteredFlight) -> Surroundings:
    """What is known before: noise as high frequencies show it, a scale length of gusts to a factor of three."""
    axes = set(np.concatenate(flight.axes).tolist())
    names = (*(("horizontal",) if axes & {0, 1} else ()), *(("vertical",) if 2 in axes else ()), "length")
    log_noise, rough = np.log(flight.noise), len(names) - 1
    return Surroundings(
        names,
        np.concatenate((log_noise, np.zeros(rough), [np.log(DEFAULT_LENGTH_M)])),
        np.concatenate((np.full(log_noise.size, 1.0 / 9.0), np.full(rough, 1e-4), [1.0])),
        np.concatenate((log_noise - 7.0, np.full(rough, np.log(FAINT)), [np.log(5.0)])),
        np.concatenate((log_noise + 9.0, np.full(rough, np.log(5.0)), [np.log(300.0)])),
    )


def likeliest_noise(
    flight: FilteredFlight, linear: Sequence[Linear], noise: Array, turbulence: Turbulence, search_s: float = SEARCH_S
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
    eta, damping = known.eta(noise, turbulence), 1e-3
    value, downhill, information = _scores(flight, linear[:chosen], eta, known, turbulence)
    value -= known.cost(eta)
    scored, first = eta, value
    for _ in range(_STEPS):
        slope = downhill - known.weight * (eta - known.middle)
        curvature = information + np.diag(known.weight + damping * np.diag(information) + 1e-9)
        trial = np.clip(eta + np.clip(np.linalg.solve(curvature, slope), -1.5, 1.5), known.low, known.high)
        tried = _gradient(flight, linear[:chosen], trial, known, turbulence)
        gained = tried[0] - known.cost(trial) - value
        step = trial - eta
        promised = float(slope @ step - 0.5 * step @ (information + np.diag(known.weight)) @ step)
        kept = gained > -1e-6
        if kept:
            eta, value, downhill = trial, value + gained, tried[1]
            if gained < max(_ENOUGH, _LITTLE * (value - first)):
                break
        if gained > 0.5 * promised:
            damping *= 0.3
        elif not kept and np.array_equal(eta, scored):
            damping = max(10.0 * damping, 1e-2)
            if damping > 1e6:
                break
        elif not kept:
            damping = max(damping, 1e-2)
        # Information of another place leads astray far from it.
        if np.max(np.abs(eta - scored)) > _STALE or (not kept and not np.array_equal(eta, scored)):
            _, downhill, information = _scores(flight, linear[:chosen], eta, known, turbulence)
            scored = eta
    return known.values(eta, turbulence)


def _gradient(
    flight: FilteredFlight, linear: Sequence[Linear], eta: Array, known: Surroundings, turbulence: Turbulence
) -> tuple[float, Array]:
    """Log likelihood and gradient of the logarithms of noise variances and turbulence."""
    likelihood, gradient = 0.0, np.zeros(eta.size)
    for arguments in _arguments(flight, linear, eta, known, turbulence):
        passed = variance_gradient(*arguments)
        likelihood, gradient = likelihood + passed[0], gradient + passed[1]
    return float(likelihood) if np.isfinite(likelihood) else -np.inf, gradient


def _scores(
    flight: FilteredFlight, linear: Sequence[Linear], eta: Array, known: Surroundings, turbulence: Turbulence
) -> tuple[float, Array, Array]:
    """Log likelihood, gradient and information of the logarithms of noise variances and turbulence."""
    likelihood, gradient, information = 0.0, np.zeros(eta.size), np.zeros((eta.size, eta.size))
    for arguments in _arguments(flight, linear, eta, known, turbulence):
        passed = variance_pass(*arguments)
        likelihood, gradient, information = likelihood + passed[0], gradient + passed[1], information + passed[2]
    return float(likelihood) if np.isfinite(likelihood) else -np.inf, gradient, information


def _arguments(
    flight: FilteredFlight, linear: Sequence[Linear], eta: Array, known: Surroundings, turbulence: Turbulence
) -> Iterator[tuple[Array, ...]]:
    """What the passes of `sysid.filter_variances` take, record by record."""
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
