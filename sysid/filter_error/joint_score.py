"""Scores of the whole likelihood of filter error: parameters, noise and turbulence together.

Innovations and their variances both depend on every parameter: a derivative that scales the answer to gusts changes
what the filter expects of them. Leaving that out gives estimating equations that are unbiased but weak where two axes
answer the same gust (measured: standard errors of Cl_beta and Cn_beta two to three times too small). The derivatives
are difference quotients of whole filter passes, the path moving along with what is changed: about a fixed one a shift
of the sideslip or a stretch of the airspeed that changes nothing in the motion seems to change the gains, which
looks like three times the information there is. Source: Maine & Iliff, NASA RP-1168, section 5.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.arrays import Array
from sysid.filter_error.linearisation_path import Path
from sysid.filter_error.linearised_flight import FilteredFlight, Pass
from sysid.numerics.autocorrelation import pooled_autocorrelation
from sysid.numerics.dryden import Turbulence
from sysid.numerics.filters import convolved
from sysid.numerics.normal_equations import solve
from sysid.numerics.parallel import side_by_side

_SHARE = 3e-3  # of a standard error, by which a parameter is moved
_NUDGE = 1e-4  # by which a logarithm is


@dataclass(frozen=True)
class Scores:
    """Of P parameters and of the logarithms of m noise variances and T turbulence numbers, n in all.

    information: (n, n) expected. rows: per record (N, m, n) slopes of the predictions in units of the innovations'
    standard deviations, widths: those of the variances, relative to them. spread: the part of the information that
    variances carry.
    """

    information: Array
    rows: list[Array]
    widths: list[Array]
    spread: Array

    def gradient(self, found: Pass) -> Array:
        """Slope (n,) of the log likelihood where a pass was made, with the slopes of these scores."""
        downhill = np.zeros(self.information.shape[0])
        for rows, widths, nu, variance in zip(self.rows, self.widths, found.innovations, found.variances, strict=True):
            good = np.isfinite(nu)
            white = np.where(good, nu, 0.0) / np.sqrt(np.where(good, variance, 1.0))
            downhill += np.einsum("kji,kj->i", rows, white) - 0.5 * np.einsum(
                "kji,kj->i", widths, good * (1.0 - white**2)
            )
        return downhill


@dataclass(frozen=True)
class TrialPoint:
    """Parameters theta (P,), surroundings eta, the filter's own paths there, its pass over them.

    cost: negative log likelihood and prior.
    """

    theta: Array
    eta: Array
    paths: list[Path]
    found: Pass
    cost: float


@dataclass(frozen=True)
class ScoredPoint(TrialPoint):
    """A place with its scores, the prior's information (n, n) and mean (n,), and the covariance (n, n) of both."""

    scores: Scores
    prior: Array
    middle: Array
    covariance: Array

    def step(self, there: TrialPoint) -> Array:
        """Scoring step (n,) from another place, with the slopes of this one."""
        away = np.concatenate((there.theta, there.eta)) - self.middle
        return solve(self.scores.information + self.prior, self.scores.gradient(there.found) - self.prior @ away)

    def coloured(self) -> Array:
        """Covariance for what colour the innovations keep (Morelli & Klein), never below the white one."""
        white, middle = self.covariance, self.prior + self.scores.spread
        pairs = list(zip(self.found.innovations, self.found.variances, strict=True))
        for j in range(pairs[0][0].shape[1]):
            kernel = pooled_autocorrelation([nu[:, j] / np.sqrt(variance[:, j]) for nu, variance in pairs])
            for rows in self.scores.rows:
                here = rows[:, j]
                wide = here if kernel.size == 1 else convolved(here, kernel)
                middle = middle + here.T @ wide
        covariance = white @ (0.5 * (middle + middle.T)) @ white
        growth = np.sqrt(np.maximum(np.diag(covariance) / np.maximum(np.diag(white), 1e-300), 1.0))
        return np.asarray(white * np.outer(growth, growth))


def joint_scores(
    flight: FilteredFlight, theta: Array, std: Array, noise: Array, turbulence: Turbulence, names: Sequence[str]
) -> tuple[Scores, Pass]:
    """Scores at parameters theta (P,) with standard errors std (P,), noise (m,) and the turbulence's `names`."""
    linear = flight.all_linearised(theta)
    base = flight.filtered(linear, noise, turbulence)

    def settled(at: Array, loud: Array, air: Turbulence, paths: list[Path]) -> Pass:
        other = flight.along(paths)
        # A thread does not inherit what the caller ignores; what is not finite is refused where the scores are used.
        with np.errstate(all="ignore"):
            there = other.all_linearised(at, slopes=False)
            return other.filtered(there, loud, air, wanted=False)

    def moved(place: int) -> tuple[Pass, float]:
        if place < theta.size:
            step = np.zeros(theta.size)
            step[place] = _SHARE * float(std[place])
            return settled(theta + step, noise, turbulence, flight.moved(base, step)), float(step[place])
        loud, air = noise.copy(), turbulence
        if place < theta.size + noise.size:
            loud[place - theta.size] *= np.exp(_NUDGE)
        else:
            name = names[place - theta.size - noise.size]
            air = replace(turbulence, **{name: getattr(turbulence, name) * float(np.exp(_NUDGE))})
        near = flight.filtered(linear, loud, air, wanted=False)
        return settled(theta, loud, air, flight.moved(near)), _NUDGE

    count = theta.size + noise.size + len(names)
    finite = [np.isfinite(nu) for nu in base.innovations]
    scales = [
        np.where(good, 1.0 / np.sqrt(np.where(good, v, 1.0)), 0.0)
        for good, v in zip(finite, base.variances, strict=True)
    ]
    rows = [np.empty((*nu.shape, count)) for nu in base.innovations]
    widths = [np.empty_like(slopes) for slopes in rows]

    def fill(place: int) -> None:
        # Into place at once: of a long flight the passes together would be as large as the scores.
        found, h = moved(place)
        for k, (good, scale) in enumerate(zip(finite, scales, strict=True)):
            nu, variance = base.innovations[k] - found.innovations[k], found.variances[k] - base.variances[k]
            rows[k][:, :, place] = np.where(good, nu / h, 0.0) * scale
            widths[k][:, :, place] = np.where(good, variance / h, 0.0) * scale**2

    side_by_side(fill, range(count))
    information, spread = np.zeros((count, count)), np.zeros((count, count))
    for slopes, wider in zip(rows, widths, strict=True):
        flat, wide = slopes.reshape(-1, count), wider.reshape(-1, count)
        spread += 0.5 * wide.T @ wide
        information += flat.T @ flat
    # The slopes that led the paths are as large again, and have served.
    return Scores(information + spread, rows, widths, spread), replace(base, slopes=[], deviation_slopes=[])
