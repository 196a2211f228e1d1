"""The likelihood of a flight with priors: Whittle's, residuals being independent from frequency to frequency.

half of  sum over f of e(f)* S(f)^-1 e(f)  +  sum over nuisances ((theta - mean) / std)^2,   e: Fourier transform of
measured less simulated, S: their spectrum matrix, as it was estimated last from the residuals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.posterior.flight_part import FlightPart
from sysid.posterior.group_model import GroupModel
from sysid.posterior.residual_spectrum import (
    LEAST_MISFIT,
    LEAST_OF_KNOWN,
    LOWEST_HZ,
    ResidualSpectrum,
    residual_spectrum,
)

# Flight that is at least so long shows the spectrum of its own noise, s: five of Welch's windows.
_OWN_NOISE_S = 8.0
# Intervals that are one, a ratio.
_ALIKE = 1.1


@dataclass(frozen=True)
class Prior:
    """Gaussian prior of all unknowns. mean: (P,). information: (P, P)."""

    mean: Array
    information: Array


@dataclass
class Point:
    """A place of the search: residuals and simulated outputs of every part."""

    theta: Array
    residuals: list[Array]
    simulated: list[Array]


class WhittleLikelihood:
    """Parts of flights under one model. low, high: (P,) bounds of all unknowns. zeros: output -> std of its zero.

    whole: whether all of the band counts, to half of each message's rate, as where commands answer the noise.
    """

    def __init__(
        self, model: GroupModel, prior: Prior, low: Array, high: Array, zeros: Mapping[str, float], whole: bool = False
    ) -> None:
        self.model, self.prior, self.low, self.high = model, prior, low, high
        self.zeros, self.whole = zeros, whole
        self._zero_std = np.array([zeros[name] for name in model.outputs])
        self.parts = model.parts
        self._alike = of_one_noise(self.parts)
        self._bands, self._deaf = [], []
        for part in self.parts:
            f = np.fft.rfftfreq(part.common.points.size, part.common.interval_s)
            lowest = max(LOWEST_HZ, 1.0 / part.common.duration_s)
            limits = np.array([part.highest_hz(name, whole) for name in model.outputs])
            # The last bin of an even number of samples is one number, not two.
            below = f < (0.5 - 1e-9) / part.common.interval_s
            self._bands.append((f >= lowest) & (f <= limits.max()) & below)
            self._deaf.append(f[self._bands[-1], None] > limits)
        self._factors: list[Array] = []
        self._zero: list[Array] = []
        self.spectra: dict[str, ResidualSpectrum] = {}
        self.misfit = 0.0
        self._logdet = 0.0

    def of(self, model: GroupModel) -> Self:
        """The same prior and bounds about another model of as many parts."""
        return type(self)(model, self.prior, self.low, self.high, self.zeros, self.whole)

    def point(self, theta: Array) -> Point:
        """Simulate all parts. Raises EstimationError where the motion diverges."""
        simulated = [self.model.simulated(i, theta) for i in range(len(self.parts))]
        if not all(np.isfinite(one).all() for one in simulated):
            raise EstimationError("the simulated motion diverges")
        return Point(theta, [self.model.measured(i) - one for i, one in enumerate(simulated)], simulated)

    def weigh(self, at: Point) -> None:
        """Estimate the spectrum matrices from what is left at a point."""
        factors: list[Array | None] = [None] * len(self.parts)
        zero: list[Array | None] = [None] * len(self.parts)
        self._logdet, shares = 0.0, []
        for places in self._alike:
            grids = [self.parts[i].common for i in places]
            spectrum, share = residual_spectrum(
                [at.residuals[i] for i in places], [at.simulated[i] for i in places], grids,
                least=LEAST_OF_KNOWN if all(self.model.steps_at_stamps(i) for i in places) else LEAST_MISFIT,
            )  # fmt: skip
            shares.append(share)
            for i in places:
                self.spectra[self.parts[i].flight] = spectrum
                common = self.parts[i].common
                f = np.asarray(np.fft.rfftfreq(common.points.size, common.interval_s)[self._bands[i]], dtype=np.float64)
                # An output counts to its own limit: beyond, what it says is marginalised.
                deaf, S = self._deaf[i], spectrum.at(f)
                S = np.where(deaf[:, :, None] | deaf[:, None, :], np.eye(deaf.shape[1]), S)
                try:
                    L = np.linalg.cholesky(S)
                except np.linalg.LinAlgError:
                    raise EstimationError(
                        f"{self.parts[i].flight}: what is left of the outputs has no spectrum: one of them is dead"
                    ) from None
                factors[i] = np.where(deaf[:, :, None], 0.0, np.linalg.inv(L)) * np.sqrt(
                    4.0 * common.interval_s / common.points.size
                )
                # Log determinant of the noise at two numbers a bin, as the squares count them.
                diagonal = np.abs(np.diagonal(L, axis1=1, axis2=2))
                self._logdet += 2.0 * float(np.sum(np.log(diagonal)))
                slow = spectrum.matrices[1].diagonal().real / (2.0 * common.duration_s)
                zero[i] = 1.0 / np.sqrt(slow + self._zero_std**2)
        self._factors = [one for one in factors if one is not None]
        self._zero = [one for one in zero if one is not None]
        self.misfit = max(shares)

    def whitened(self, index: int, series: Array) -> Array:
        """(2 F m + m, C) real, of series (m, K, C) of a part: every frequency, then the mean."""
        common, band = self.parts[index].common, self._bands[index]
        # A mean that went through the taper's edges would be determined by frequencies that no zero error may reach.
        mean = common.taper @ series / common.taper.sum()
        Z = np.fft.rfft((series - mean[:, None, :]) * common.taper[None, :, None], axis=1)[:, band, :]
        W = self._factors[index] @ np.ascontiguousarray(Z.transpose(1, 0, 2))
        flat = W.reshape(-1, series.shape[2])
        # A bin's real and imaginary part have unit variance each.
        return np.concatenate((flat.real, flat.imag, mean * self._zero[index][:, None]))

    def cost(self, at: Point) -> float:
        """Half the sum of squares, prior included, with the noise held as it was estimated last."""
        off = at.theta - self.prior.mean
        total = 0.5 * float(off @ self.prior.information @ off)
        with np.errstate(over="ignore", invalid="ignore"):  # a motion that runs away has no finite cost
            for i, residual in enumerate(at.residuals):
                e = self.whitened(i, residual[:, :, None])[:, 0]
                total += 0.5 * float(e @ e)
        return total if np.isfinite(total) else np.inf

    def normal(self, at: Point) -> tuple[Array, Array]:
        """Information (P, P) and gradient downhill (P,), prior included.

        Raises EstimationError where a neighbour of the point diverges: the slopes are differences.
        """
        H, g = self._equations(at, range(len(at.residuals)))
        if not (np.isfinite(H).all() and np.isfinite(g).all()):
            raise EstimationError("the simulated motion diverges beside the estimate")
        return H, g

    def _equations(self, at: Point, places: Sequence[int]) -> tuple[Array, Array]:
        off = at.theta - self.prior.mean
        H, g = self.prior.information.copy(), -(self.prior.information @ off)
        for i in places:
            J = self.whitened(i, self.model.slopes(i, at.theta))
            e = self.whitened(i, at.residuals[i][:, :, None])[:, 0]
            H += J.T @ J
            g += J.T @ e
        return H, g

    def equations_by_flight(self, theta: Array) -> dict[str, tuple[Array, Array]]:
        """Information (P, P) and gradient downhill (P,) of each flight, prior included, at a point (P,) of all."""
        at = self.point(theta)
        self.weigh(at)
        flights = dict.fromkeys(part.flight for part in self.parts)
        return {
            flight: self._equations(at, [i for i, part in enumerate(self.parts) if part.flight == flight])
            for flight in flights
        }

    def profile_cost(self, theta: Array) -> float:
        """Half the deviance at a point (P,), its noise estimated there; infinite where the motion diverges."""
        try:
            return self.profile_at(self.point(np.clip(theta, self.low, self.high)))
        except EstimationError:
            return np.inf

    def profile_at(self, at: Point) -> float:
        """Half the deviance at a point, its noise estimated there. Raises EstimationError where a spectrum is none."""
        self.weigh(at)
        return self.cost(at) + self._logdet

    def profile_gradient(self, at: Point, step: Array) -> Array:
        """(P,) downhill, of `profile_at`, by differences of these steps (P,) along the slopes at the point.

        Where nothing answers the noise, `normal` has as good a gradient: its mean is zero whatever the weights. What an
        autopilot commands goes with the noise, and there the mean is zero only where weights move with the estimate.
        """
        slopes = [self.model.slopes(i, at.theta) for i in range(len(self.parts))]
        gradient = np.zeros(step.size)
        for k, size in enumerate(step):
            costs = []
            for off in (size, -size):
                theta = at.theta.copy()
                theta[k] += off
                moved = [off * one[:, :, k] for one in slopes]
                residuals = [one - change for one, change in zip(at.residuals, moved, strict=True)]
                simulated = [one + change for one, change in zip(at.simulated, moved, strict=True)]
                costs.append(self.profile_at(Point(theta, residuals, simulated)))
            gradient[k] = (costs[1] - costs[0]) / (2.0 * size)
        self.weigh(at)
        return gradient

    def linear(self, at: Point) -> tuple[Array, Array]:
        """Whitened slopes (K, P) and residuals (K,) of all parts at a point, the noise as it was estimated last."""
        slopes = [self.whitened(i, self.model.slopes(i, at.theta)) for i in range(len(self.parts))]
        return np.concatenate(slopes), self._stacked(at.residuals)

    def difference(self, at: Point, other: GroupModel) -> Array:
        """(K,) whitened change of all outputs by another model of the same unknowns; NaN where that diverges."""
        with np.errstate(over="ignore", invalid="ignore"):
            moved = [other.simulated(i, at.theta) - one for i, one in enumerate(at.simulated)]
            return self._stacked(moved)

    def _stacked(self, series: Sequence[Array]) -> Array:
        return np.concatenate([self.whitened(i, one[:, :, None])[:, 0] for i, one in enumerate(series)])

    def evidence(self, theta: Array) -> float:
        """Log of the probability of the measurement under this model, by Laplace's method about its maximum (P,); of
        use beside that of another model of the same parts.
        """
        at = self.point(theta)
        self.weigh(at)
        H, _ = self.normal(at)
        volume = np.linalg.slogdet(self.prior.information)[1] - np.linalg.slogdet(H)[1]
        return -(self.cost(at) + self._logdet) + 0.5 * float(volume)


def of_one_noise(parts: Sequence[FlightPart]) -> list[list[int]]:
    """Places of parts whose noise has one spectrum: those of a flight, and all that are too short to show their own."""
    seconds: dict[str, float] = {}
    for part in parts:
        seconds[part.flight] = seconds.get(part.flight, 0.0) + part.common.duration_s
    found: dict[str | float, list[int]] = {}
    shortest = 0.0
    # Spectra of windows whose grids are alike are of the same frequencies.
    for i, part in sorted(enumerate(parts), key=lambda one: one[1].common.interval_s):
        key: str | float = part.flight
        if seconds[part.flight] < _OWN_NOISE_S:
            shortest = shortest if part.common.interval_s < _ALIKE * shortest else part.common.interval_s
            key = shortest
        found.setdefault(key, []).append(i)
    return list(found.values())
