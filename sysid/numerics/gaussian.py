"""What is known of coefficients before a flight: a Gaussian with its correlations, from an earlier identification.

Estimates of one flight are strongly correlated (CL_0 with CL_alpha, Cm_0 with CL_0: -0.95 and more). Standard errors
alone would claim knowledge of combinations that no flight determined, so a prior without correlations is no prior here.
Source: H. Theil, A. S. Goldberger, "On pure and mixed statistical estimation in economics", International Economic
Review 2, 1961 (the flight and the prior as two sets of observations); Klein & Morelli, chapter 5.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim_vehicle.model.model_file import Coefficient, Correlation, Model
from sysid.arrays import Array

# Correlations are written with this many decimals: a guessed inertia is a hundred times what the flight leaves open,
# and what remains without it is a difference. Files of before have fewer.
_DECIMALS, _FEW_DECIMALS = 12, 6


@dataclass(frozen=True)
class Gaussian:
    """Names (P), means (P,) and covariance (P, P) of what is known."""

    names: tuple[str, ...]
    mean: Array
    covariance: Array

    def information(self) -> Array:
        """(P, P) inverse of the covariance."""
        std = np.sqrt(np.diag(self.covariance))
        inverse = np.linalg.inv(self.covariance / np.outer(std, std)) / np.outer(std, std)
        return np.asarray(0.5 * (inverse + inverse.T), dtype=np.float64)

    def of(self, names: Sequence[str]) -> Gaussian | None:
        """The marginal of those of `names` that are known; None if none is."""
        place = [i for i, name in enumerate(self.names) if name in names]
        if not place:
            return None
        kept = tuple(self.names[i] for i in place)
        return Gaussian(kept, self.mean[place], self.covariance[np.ix_(place, place)])

    def combined(self, other: Gaussian) -> Gaussian:
        """Both together, as independent observations of the same numbers.

        What only one of them names follows from its correlations with what both name.
        """
        names = (*self.names, *(name for name in other.names if name not in self.names))
        # Scaled by the smaller standard error: coefficients differ by orders of magnitude.
        unit = np.full(len(names), np.inf)
        pairs = [(each, np.array([names.index(name) for name in each.names])) for each in (self, other)]
        for each, place in pairs:
            unit[place] = np.minimum(unit[place], np.sqrt(np.diag(each.covariance)))
        information, moment = np.zeros((len(names), len(names))), np.zeros(len(names))
        for each, place in pairs:
            own = each.information() * np.outer(unit[place], unit[place])
            information[np.ix_(place, place)] += own
            moment[place] += own @ (each.mean / unit[place])
        covariance = np.linalg.inv(information)
        mean = np.asarray(covariance @ moment * unit, dtype=np.float64)
        return Gaussian(names, mean, np.asarray(covariance * np.outer(unit, unit), dtype=np.float64))

    def updated(self, estimate: Gaussian) -> Gaussian:
        """What is known after `estimate`, which contains this knowledge already, of all names of both.

        Names that were not estimated follow those that were, by their correlations.
        """
        rest = [i for i, name in enumerate(self.names) if name not in estimate.names]
        both = [i for i, name in enumerate(self.names) if name in estimate.names]
        if not rest:
            return estimate
        place = [estimate.names.index(self.names[i]) for i in both]
        cross = self.covariance[np.ix_(rest, both)]
        gain = np.linalg.solve(self.covariance[np.ix_(both, both)], cross.T).T if both else cross
        moved = estimate.mean[place] - self.mean[both]
        shrunk = self.covariance[np.ix_(both, both)] - estimate.covariance[np.ix_(place, place)]
        with_all = gain @ estimate.covariance[place]
        names = (*estimate.names, *(self.names[i] for i in rest))
        covariance = np.block(
            [
                [estimate.covariance, with_all.T],
                [with_all, self.covariance[np.ix_(rest, rest)] - gain @ shrunk @ gain.T],
            ]
        )
        return Gaussian(names, np.concatenate((estimate.mean, self.mean[rest] + gain @ moved)), covariance)

    def correlation(self) -> Correlation:
        """The correlations as a model file holds them."""
        std = np.sqrt(np.diag(self.covariance))
        matrix = np.clip(np.round(self.covariance / np.outer(std, std), _DECIMALS), -1.0, 1.0) + 0.0
        matrix = np.tril(matrix, -1) + np.tril(matrix, -1).T + np.eye(std.size)
        return Correlation(self.names, tuple(tuple(map(float, row)) for row in matrix))

    def entries(self) -> dict[str, tuple[float, float]]:
        """Name -> (mean, standard error)."""
        std = np.sqrt(np.diag(self.covariance))
        return {name: (float(m), float(s)) for name, m, s in zip(self.names, self.mean, std, strict=True)}


def known_from(model: Model, *, flown: bool = False) -> tuple[Gaussian | None, str]:
    """What a model file says as a prior, and a warning where it says less than it seems to.

    Only entries with a standard error that stand in the model's correlation block count. flown: whether estimates that
    are refused count too, by which the model flies.
    """
    entries = _entries(model)
    block = model.correlation
    estimated = [name for name, entry in entries.items() if (entry.flown_std if flown else entry.std)]
    if block is None or not set(block.names) & set(estimated):
        return None, (
            f"the prior {model.name} has no correlations of its estimates, without which its standard errors claim too "
            "much; it gives start values only (write the prior with identify --write-model)"
        )
    place = [i for i, name in enumerate(block.names) if name in estimated]
    names = tuple(block.names[i] for i in place)
    written = np.array(block.matrix)[np.ix_(place, place)]
    decimals = _FEW_DECIMALS if np.array_equal(written, written.round(_FEW_DECIMALS)) else _DECIMALS
    values, vectors = np.linalg.eigh(written)
    # Rounding may have made a nearly singular matrix indefinite; what lies below its error is not known.
    matrix = (vectors * np.maximum(values, len(names) * 10.0**-decimals)) @ vectors.T
    std = np.array([entries[name].flown_std for name in names], dtype=np.float64)
    mean = np.array([entries[name].flown for name in names], dtype=np.float64)
    left_out = sorted(set(estimated) - set(names))
    warning = f"the prior's correlations lack {', '.join(left_out)}: start values only" if left_out else ""
    return Gaussian(names, mean, matrix * np.outer(std, std)), warning


def _entries(model: Model) -> Mapping[str, Coefficient]:
    effects = {f"{effect.name}.{key}": entry for effect in model.effects for key, entry in effect.parameters.items()}
    return {**model.coefficients, **effects}
