"""Noise of the outputs and turbulence that make a filtered flight likeliest, the parameters as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.dryden import DEFAULT_LENGTH_M, Turbulence
from sysid.filter_path import FilteredFlight, Linear
from sysid.filter_variances import variance_pass
from sysid.flight import Array

FAINT = 0.003  # m/s, below any sensor
SEARCH_S = 60.0  # of flight, from which noise and turbulence are estimated
_STEPS = 15
_NUDGE = 1e-5


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
    for _ in range(_STEPS):
        curvature = information + np.diag(known.weight + damping * np.diag(information) + 1e-9)
        step = np.linalg.solve(curvature, downhill - known.weight * (eta - known.middle))
        trial = np.clip(eta + np.clip(step, -1.5, 1.5), known.low, known.high)
        tried = _scores(flight, linear[:chosen], trial, known, turbulence)
        gained = tried[0] - known.cost(trial) - value
        if not gained > -1e-6:
            damping = max(10.0 * damping, 1e-2)
            if damping > 1e6:
                break
            continue
        eta, value, downhill, information = trial, value + gained, tried[1], tried[2]
        damping *= 0.1
        if gained < 0.05:
            break
    return known.values(eta, turbulence)


def _scores(
    flight: FilteredFlight, linear: Sequence[Linear], eta: Array, known: Surroundings, turbulence: Turbulence
) -> tuple[float, Array, Array]:
    """Log likelihood, gradient and information of the logarithms of noise variances and turbulence."""
    noise, here = known.values(eta, turbulence)
    likelihood, gradient, information = 0.0, np.zeros(eta.size), np.zeros((eta.size, eta.size))
    for k, one in enumerate(linear):
        system = flight.system(k, one, here)
        moved = [
            flight.system(k, one, replace(here, **{name: getattr(here, name) * (1.0 + _NUDGE)})) for name in known.names
        ]
        change = [
            np.array([(getattr(other, part) - getattr(system, part)) / _NUDGE for other in moved])
            for part in ("transition", "process", "p_start")
        ]
        passed = variance_pass(
            system.transition, system.drift, system.left, system.observe, system.jump, noise, system.process,
            system.p_start, *change,
        )  # fmt: skip
        likelihood, gradient, information = likelihood + passed[0], gradient + passed[1], information + passed[2]
    return float(likelihood) if np.isfinite(likelihood) else -np.inf, gradient, information
