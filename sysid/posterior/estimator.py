"""The maximum of the likelihood over coefficients, nuisances and initial states of a group, and its uncertainty.

The spectrum of the residuals is estimated anew after every step. Gauss-Newton steps with Levenberg's damping and an
active set of bounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.numerics.normal_equations import inverse
from sysid.posterior.closed_loop import (
    LEAST_SHARE,
    SHORTEST_LOOP_S,
    external,
    feedback_share,
    follow_laws,
    most_answered,
    rests,
)
from sysid.posterior.considered_errors import PARTS, ConsiderParameter
from sysid.posterior.likelihood import Point, WhittleLikelihood
from sysid.posterior.nuisance_priors import SURFACES_OF
from sysid.posterior.residual_spectrum import ResidualSpectrum
from sysid.signals.record import STATES

MAX_PASSES = 12  # of Gauss-Newton
# A step below this share of every coefficient's standard error ends the search.
_SETTLED = 0.1
# Steps of the likelihood's own slopes, standard errors, and the gain that they promise at its maximum.
_DIFFERENCE, _FLAT = 0.2, 0.05
# Blocks of time of the sandwich, s, and the fewest of them.
_BLOCK_S, _LEAST_BLOCKS = 2.5, 6
# Lower ends of the octaves in each of which the structure may miss another share of each output, Hz.
_STRUCTURE_BANDS_HZ = 0.125 * 2.0 ** np.arange(8)


@dataclass(frozen=True)
class PosteriorResult:
    """The maximum, with its uncertainty.

    names: of the unknowns without the initial states, (P,). theta: (P,). states: initial ones. covariance: (P, P),
    the larger of Fisher's and the sandwich over blocks of time. fisher: (P, P). noise_std: (P,) what noise alone leaves
    open, by the larger of the two. prior_std: (P,). misfit: share of
    the motion that the structure may not hold. spectra: by flight. outputs: names. residuals: by part, (m, K).
    passes: steps made. feedback_of: surface -> share of its command's variance that follows the residuals: a closed
    loop. laws: surfaces that nothing moves but a law of the motion. unclear: whether parts are too short to see a loop
    in gusts; bars count what one would do. zeros: output -> what its sensor reads at zero, and its standard deviation,
    SI.
    systematic: (P,) by which an error of what was taken as known moves the
    estimate; the covariance holds those that were stated.
    """

    names: tuple[str, ...]
    theta: Array
    states: Array
    covariance: Array
    fisher: Array
    noise_std: Array
    prior_std: Array
    misfit: float
    spectra: Mapping[str, ResidualSpectrum]
    outputs: tuple[str, ...]
    residuals: tuple[Array, ...] = field(repr=False)
    passes: int
    converged: bool
    cost: float
    feedback_of: Mapping[str, float]
    laws: tuple[str, ...]
    unclear: bool
    systematic: Mapping[str, Array]
    zeros: Mapping[str, tuple[float, float]]

    @property
    def feedback(self) -> float:
        """Largest share of a command that follows the residuals, of those that are more than a law of the motion."""
        return max(self.feedback_of.values(), default=0.0)


class Posterior(WhittleLikelihood):
    """The likelihood with what searches its maximum and says how uncertain that is."""

    def search(self, start: Array, max_passes: int) -> Array:
        """(P,) where some steps from `start` lead."""
        return self._search(start, max_passes, least=2)[0].theta

    def solve(
        self, start: Array, doubts: Sequence[ConsiderParameter] = (), max_passes: int = MAX_PASSES
    ) -> PosteriorResult:
        """Search from `start` (P,), where another search of much the same ended. doubts: what was taken as known.

        Raises EstimationError where even the start diverges.
        """
        at, passes, converged = self._search(start, max_passes, least=1)
        if self._feedback(at, self._laws()):
            at, converged = self._likeliest(at, max_passes)
        return self._result(at, doubts, passes, converged)

    def _search(self, start: Array, max_passes: int, least: int) -> tuple[Point, int, bool]:
        """Where the steps end, how many there were, and whether the last was small.

        least: steps before which a small one is no end.
        """
        at = self.point(np.clip(start, self.low, self.high))
        self.weigh(at)
        damping, converged, passes = 1e-3, False, 0
        for passes in range(1, max_passes + 1):
            H, g = self.normal(at)
            std = np.sqrt(np.diag(inverse(H)))
            cost, accepted = self.cost(at), None
            for _ in range(8):
                theta = self._step(at.theta, H, g, damping)
                try:
                    other = self.point(theta)
                except EstimationError:
                    other = None
                if other is not None and self.cost(other) <= cost + 1e-9:
                    accepted = other
                    break
                damping = max(8.0 * damping, 1e-3)
            if accepted is None:
                break
            count = len(self.model.parameters)
            moved = float(np.max((np.abs(accepted.theta - at.theta) / std)[:count]))
            damping, at = max(damping / 10.0, 1e-7), accepted
            self.weigh(at)
            if moved < _SETTLED and passes >= least:
                converged = True
                break
        return at, passes, converged

    def _likeliest(self, at: Point, max_passes: int) -> tuple[Point, bool]:
        """From where a search ended to where the likelihood's own slopes vanish, and whether they do: where commands
        answer the noise, a search that holds the weights at each step ends beside it.

        Slopes by a flow that is imposed are an instrument's: they decide, no cost would fall with them.
        """
        damping = 1e-3
        try:
            H, g, size = self._likelihood_slopes(at)
        except EstimationError:
            self.weigh(at)
            return at, False
        for _ in range(max_passes):
            if size < _FLAT:
                break
            accepted = False
            for _ in range(4):
                try:
                    with np.errstate(over="ignore", invalid="ignore"):  # a trial that runs away is refused
                        other = self.point(self._step(at.theta, H, g, damping))
                        slopes = self._likelihood_slopes(other)
                except EstimationError:
                    slopes = H, g, np.inf
                damping = max(10.0 * damping, 1e-2)
                if accepted := slopes[2] < size:
                    at, (H, g, size), damping = other, slopes, damping / 100.0
                    break
            if not accepted:
                break
        self.weigh(at)
        return at, size < _FLAT

    def _likelihood_slopes(self, at: Point) -> tuple[Array, Array, float]:
        """Information (P, P), gradient downhill (P,) of `profile_at`, and how far off its maximum is: twice the log
        likelihood that is promised by what is free to move.
        """
        self.weigh(at)
        H, _ = self.normal(at)
        g = self.profile_gradient(at, _DIFFERENCE * np.sqrt(np.diag(inverse(H))))
        return H, g, float(g @ (self._step(at.theta, H, g, 1e-7) - at.theta))

    def feedback(self, theta: Array) -> float:
        """Largest share of a command that follows what is left at a point, as in PosteriorResult."""
        return max(self._feedback(self.point(theta), self._laws()).values(), default=0.0)

    def _unclear(self, at: Point) -> list[int]:
        """Parts that are too short to see whether something answers what is left, where that is much of the motion, no
        other part is long enough, and a surface never rests.
        """
        if any(one.duration_s >= SHORTEST_LOOP_S for one in self.parts):
            return []
        surfaces = SURFACES_OF[self.model.group]
        short = [
            i
            for i, part in enumerate(self.parts)
            if not part.position
            and any(part.travel(n) > 0.0 and not rests(part.inputs[n], part.grid) for n in surfaces if n in part.inputs)
        ]
        most = self.most_answered(at.residuals, short)
        return [i for i, share in zip(short, most, strict=True) if share > LEAST_SHARE]

    def _laws(self) -> tuple[str, ...]:
        """Surfaces that nothing moves but a law of the motion."""
        return follow_laws(self.parts, SURFACES_OF[self.model.group])

    def _feedback(self, at: Point, laws: Sequence[str]) -> dict[str, float]:
        """Share of each surface's command that follows the residuals; surfaces that follow none, or are moved by a law
        alone, are left out.
        """
        found = {}
        for name in SURFACES_OF[self.model.group]:
            places = [
                i for i, part in enumerate(self.parts)
                if name in part.inputs and part.duration_s >= SHORTEST_LOOP_S and not part.position
            ]  # fmt: skip
            if name not in laws and places and (share := self._followed(at, name, places)) > LEAST_SHARE:
                found[name] = share
        return found

    def _followed(self, at: Point, surface: str, places: Sequence[int]) -> float:
        """Share of a surface's command that follows the residuals, the mean over parts by their length."""
        length = [self.parts[i].duration_s for i in places]
        shares = [
            feedback_share(self.parts[i].inputs[surface], at.residuals[i], self.parts[i].common, most)
            for i, most in zip(places, self.most_answered(at.residuals, places), strict=True)
        ]
        return float(np.average(shares, weights=length))

    def most_answered(self, residuals: Sequence[Array], places: Sequence[int]) -> list[float]:
        """Largest share of a command that can answer the residuals (m, K) of some parts."""
        felt = [j for j, name in enumerate(self.model.outputs) if name in STATES]
        return [most_answered(residuals[i][felt], self.model.measured(i)[felt], self.parts[i].common) for i in places]

    def _step(self, theta: Array, H: Array, g: Array, damping: float) -> Array:
        """Damped Gauss-Newton step within the bounds: what would leave them stays there, the rest steps without it."""
        free = np.ones(theta.size, dtype=bool)
        target = theta.copy()
        for _ in range(4):
            keep = np.flatnonzero(free)
            A = H[np.ix_(keep, keep)]
            scale = 1.0 / np.sqrt(np.maximum(np.diag(A), 1e-30))
            A = A * np.outer(scale, scale)
            A[np.diag_indices_from(A)] += damping
            # What is held at a bound has moved there already: its pull on the others counts.
            right = g[keep] - H[np.ix_(keep, np.flatnonzero(~free))] @ (target - theta)[~free]
            target[keep] = theta[keep] + np.linalg.solve(A, right * scale) * scale
            out = free & ((target < self.low) | (target > self.high))
            target = np.clip(target, self.low, self.high)
            if not out.any():
                break
            free &= ~out
        return target

    def _result(self, at: Point, doubts: Sequence[ConsiderParameter], passes: int, converged: bool) -> PosteriorResult:
        H = self.prior.information.copy()
        laws = self._laws()
        feedback_of = self._feedback(at, laws)
        unclear = self._unclear(at)
        answering: Sequence[int] = range(len(self.parts)) if feedback_of or laws else unclear
        # What answers noise is not informative where the noise has any spectrum: in a loop the rest alone informs.
        rest_information, pull_of_rest = H.copy(), -H @ (at.theta - self.prior.mean)
        scores = []
        altered = [self.model.altered(doubt.changed(self.model.vehicle)) for doubt in doubts]
        pulls = np.zeros((len(doubts), H.shape[0]))
        gains = np.zeros((2 * _STRUCTURE_BANDS_HZ.size * len(self.model.outputs), H.shape[0]))
        means = []
        for i, residual in enumerate(at.residuals):
            slopes = self.model.slopes(i, at.theta)
            J = self.whitened(i, slopes)
            e = self.whitened(i, residual[:, :, None])[:, 0]
            H += J.T @ J
            if answering:
                rest = J
                if i in answering:
                    rest = self.whitened(i, external(slopes, residual, self.parts[i].common))
                rest_information += rest.T @ rest
                pull_of_rest += rest.T @ e
            means.append(np.column_stack((e, J))[-len(self.model.outputs) :] / self._zero[i][:, None])
            scores.append(self._block_scores(i, J, e))
            gains += self._gain_errors(i, J, at.simulated[i])
            for pull, other in zip(pulls, altered, strict=True):
                moved = other.measured(i) - other.simulated(i, at.theta) - residual
                pull += J.T @ self.whitened(i, moved[:, :, None])[:, 0]
        fisher = inverse(H)
        B = np.concatenate(scores)
        count = B.shape[0]
        middle = B.T @ B * (count / max(count - 1, 1)) + self.prior.information
        sandwich = fisher @ middle @ fisher
        # A bar never below Fisher's, correlations as the wider of the two has them.
        growth = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(fisher), 1.0))
        # The estimate weighs everything, and by that it follows what was taken as known, whatever its bars count.
        follows = fisher
        if answering:
            fisher = inverse(rest_information)
        covariance = fisher * np.outer(growth, growth)
        if answering:
            # Where the rest alone would have led: the two agree but for what the loop does to the estimate.
            apart = fisher @ pull_of_rest
            covariance += np.outer(apart, apart)
        # What the structure does not hold is wrong in the same way for as long as one flies: no time averages it.
        structure = self.misfit * gains @ fisher
        covariance += structure.T @ structure
        if answering:
            # What is left of the sensitivities never informs more than all of them.
            structure = self.misfit * gains @ follows
            least = np.diag(follows) * growth**2 + np.sum(structure**2, axis=0)
            wider = np.sqrt(np.maximum(least / np.diag(covariance), 1.0))
            covariance *= np.outer(wider, wider)
        shifts = PARTS * pulls @ follows
        for doubt, shift in zip(doubts, shifts, strict=True):
            covariance += doubt.stated * np.outer(shift, shift)
        P = len(self.model.names)
        weight = np.diag(self.prior.information)[:P]
        prior_std = 1.0 / np.sqrt(np.maximum(weight, 1e-300))
        return PosteriorResult(
            self.model.names, at.theta[:P], at.theta[P:], covariance[:P, :P], fisher[:P, :P],
            (np.sqrt(np.diag(fisher)) * growth)[:P], prior_std, self.misfit,
            dict(self.spectra), self.model.outputs, tuple(at.residuals), passes, converged,
            self.cost(at) + self._logdet, feedback_of, laws, bool(unclear) and not feedback_of,
            {doubt.name: shift[:P] for doubt, shift in zip(doubts, shifts, strict=True)},
            self._zeros(means, covariance),
        )  # fmt: skip

    def _zeros(self, means: Sequence[Array], covariance: Array) -> dict[str, tuple[float, float]]:
        """What sensors read at zero by the means that are left. means: by part (m, 1 + P), of the residual and the
        slopes.
        """
        share = np.array([(self._zero_std * weight) ** 2 for weight in self._zero])
        pulled = np.mean(share[:, :, None] * np.array(means), axis=0)
        left = self._zero_std**2 * (1.0 - share.mean(axis=0))
        std = np.sqrt(np.maximum(left, 0.0) + np.einsum("jp,pq,jq->j", pulled[:, 1:], covariance, pulled[:, 1:]))
        return {
            name: (float(value), float(one))
            for name, value, one in zip(self.model.outputs, pulled[:, 0], std, strict=True)
        }

    def _gain_errors(self, index: int, J: Array, simulated: Array) -> Array:
        """(G, P) pulls of a gain error of 1, in phase and in quadrature, of each output in each octave of frequency."""
        common, band, m = self.parts[index].common, self._bands[index], len(self.model.outputs)
        f = np.fft.rfftfreq(common.points.size, common.interval_s)[band]
        alone = np.zeros((m, common.points.size, m))
        alone[np.arange(m), :, np.arange(m)] = simulated - simulated.mean(axis=1, keepdims=True)
        stacked = np.column_stack((J, self.whitened(index, alone)))[: 2 * f.size * m]
        W = (stacked[: f.size * m] + 1j * stacked[f.size * m :]).reshape(f.size, m, -1)
        place = np.clip(np.searchsorted(_STRUCTURE_BANDS_HZ, f, side="right") - 1, 0, None)
        found = []
        for octave in range(_STRUCTURE_BANDS_HZ.size):
            part = W[place == octave].reshape(-1, W.shape[2])
            both = part[:, : J.shape[1]].conj().T @ part[:, J.shape[1] :]
            found += [both.real.T, both.imag.T]
        return np.concatenate(found)

    def _block_scores(self, index: int, J: Array, e: Array) -> Array:
        """(B, P) gradients of blocks of time, by which the sandwich sees what colour the whitened residuals keep."""
        common, band, m = self.parts[index].common, self._bands[index], len(self.model.outputs)
        n, bins = common.points.size, int(np.count_nonzero(band))
        # A window shorter than a block is one, where there are others.
        least = -(-_LEAST_BLOCKS // len(self.parts))
        blocks = int(np.clip(round(common.duration_s / _BLOCK_S), least, 300))
        edges = np.linspace(0, n, blocks + 1).astype(int)
        stacked = np.column_stack((J, e))[: 2 * bins * m]
        W = (stacked[: bins * m] + 1j * stacked[bins * m :]).reshape(bins, m, -1)
        Z = np.zeros((n // 2 + 1, m, stacked.shape[1]), dtype=complex)
        Z[band] = W
        # Sums over time of the products are those over the band.
        series = np.fft.irfft(Z, n=n, axis=0) * np.sqrt(n / 2.0)
        products = (series[:, :, :-1] * series[:, :, -1:]).sum(axis=1)
        found = np.add.reduceat(products, edges[:-1], axis=0)
        means = J[2 * bins * m :] * e[2 * bins * m :, None]
        return np.concatenate((found, means))
