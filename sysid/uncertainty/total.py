"""The whole error of an estimate: what the flight leaves open, and what was taken as known and is not."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.model.model_file import Coefficient, Model
from sysid.arrays import Array
from sysid.numerics.gaussian import Gaussian, known_from

# Standard deviations on either side that hold 95 % of a normal distribution.
Z95 = 1.96


@dataclass(frozen=True)
class ErrorParts:
    """The errors of a model's estimates by where they come from.

    known: names (P), values (P,) and what the flight leaves open, (P, P). shifts: source -> (P,) change of the values
    under one standard deviation of it. Sources are independent of the flight and of each other.
    """

    known: Gaussian
    shifts: Mapping[str, Array]


def with_total_errors(model: Model, held: Callable[[str], bool]) -> Model:
    """The model with the whole error in each `std`, in the correlations and in a 95 % `interval`; `statistical_std`
    beside them is what the flight alone leaves open, and `systematic` the rest by its sources.

    Parameters
    ----------
    model : Model
        Estimates with `systematic` beside each: source -> change, in the coefficient's unit.
    held : callable
        Whether the errors of the estimates hold a source already, by its name.

    Returns
    -------
    Model
        The same estimates.
    """
    known, _ = known_from(model, flown=True)
    estimated = () if known is None else known.names
    if known is not None:
        added = [shift for source, shift in _shifts(model, known.names).items() if not held(source)]
        covariance = known.covariance + sum((np.outer(one, one) for one in added), np.zeros_like(known.covariance))
        model = replace(model, correlation=replace(known, covariance=covariance).correlation())

    def whole(name: str, entry: Coefficient) -> Coefficient:
        # What was not estimated stays as it was known.
        if name not in estimated or entry.flown_std is None:
            return entry
        moved: Mapping[str, float] = entry.extra.get("systematic", {})
        total = math.hypot(entry.flown_std, *(shift for source, shift in moved.items() if not held(source)))
        if entry.value is None:
            return replace(entry, mean_std=total)
        statistical = math.sqrt(max(total**2 - sum(shift**2 for shift in moved.values()), 0.0))
        parts = {"statistical_std": statistical, "interval": [entry.value - Z95 * total, entry.value + Z95 * total]}
        return replace(entry, std=total, extra={**entry.extra, **parts})

    return replace(
        model,
        coefficients={name: whole(name, entry) for name, entry in model.coefficients.items()},
        effects=tuple(
            replace(one, parameters={key: whole(f"{one.name}.{key}", entry) for key, entry in one.parameters.items()})
            for one in model.effects
        ),
    )


def error_parts(model: Model) -> ErrorParts | None:
    """The parts of a model's errors; None for a model without correlations of its estimates.

    Parameters
    ----------
    model : Model
        Of `with_total_errors`, or of a file that such a one was written to; of another one all error is the flight's.
    """
    known, _ = known_from(model, flown=True)
    if known is None:
        return None
    entries = [*model.coefficients.values(), *(p for one in model.effects for p in one.parameters.values())]
    # Of files from before `std` held it all the sources stand beside the errors.
    whole = any("statistical_std" in entry.extra for entry in entries)
    shifts = _shifts(model, known.names) if whole else {}
    flight = known.covariance - sum((np.outer(one, one) for one in shifts.values()), np.zeros_like(known.covariance))
    # Of a few decimals of the correlations a difference may become indefinite.
    std = np.sqrt(np.diag(known.covariance))
    values, vectors = np.linalg.eigh(flight / np.outer(std, std))
    kept = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return ErrorParts(replace(known, covariance=kept * np.outer(std, std)), shifts)


def _shifts(model: Model, names: tuple[str, ...]) -> dict[str, Array]:
    """Source -> (P,) change of the estimates called so."""
    effects = {f"{one.name}.{key}": entry for one in model.effects for key, entry in one.parameters.items()}
    every = {**model.coefficients, **effects}
    moved = [every[name].extra.get("systematic", {}) for name in names]
    sources = dict.fromkeys(source for one in moved for source in one)
    return {source: np.array([one.get(source, 0.0) for one in moved], dtype=np.float64) for source in sources}
