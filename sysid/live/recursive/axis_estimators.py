"""The axes of the model, each with everything that estimates it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim_vehicle.model.aerodynamic_terms import Term
from sysid.live.recursive.change_detection import ChangeDetector
from sysid.live.recursive.decimation import Decimator
from sysid.live.recursive.equations import BIASES, Sides
from sysid.live.recursive.frequency_estimator import AxisEstimator, CoefficientEstimates


@dataclass
class Axis:
    """One axis of the model. failing: since when its arithmetic does, NaN where it does not."""

    names: tuple[str, ...]
    factors: tuple[tuple[str, ...], ...]
    estimator: AxisEstimator
    detector: ChangeDetector
    estimate: CoefficientEstimates | None = None
    failing: float = np.nan

    @classmethod
    def of(cls, axis: str, terms: Sequence[Term], noises: Sequence[str], interval_s: float) -> Axis:
        """An axis of which nothing is known. noises: the signals whose white noise is known."""
        names = tuple(term.name for term in terms)
        factors = tuple(term.factors for term in terms)
        noisy = [chosen[0] if len(chosen) == 1 and chosen[0] in noises else "" for chosen in factors]
        estimator = AxisEstimator(names, noisy, interval_s, BIASES.get(axis, ()))
        return cls(names, factors, estimator, ChangeDetector(axis, names))


class SlowSamples:
    """Equations at the lower rate at which changes are looked for.

    They wait until that is asked: filtering many takes hardly longer than a few. white_noise_left: the share of white
    noise's variance that passes.
    """

    def __init__(self, interval_s: float) -> None:
        self._interval_s = interval_s
        self._decimator = Decimator(interval_s)
        self.white_noise_left = self._decimator.white_noise_left
        self._waiting: list[Sides] = []

    def anew(self) -> SlowSamples:
        """The same with nothing waiting and nothing filtered."""
        return SlowSamples(self._interval_s)

    def add(self, sides: Sides) -> None:
        """Take equations that follow those before."""
        self._waiting.append(sides)

    def restart(self) -> None:
        """What comes next does not continue what has been handed on."""
        self._decimator.restart()

    def hand_on(self, axes: Mapping[str, Axis]) -> None:
        """Give what waits to these axes."""
        if not self._waiting:
            return
        time_s = np.concatenate([sides.time_s for sides in self._waiting])
        table = np.concatenate([sides.table for sides in self._waiting])
        places = self._waiting[0].places
        self._waiting = []
        filtered, chosen = self._decimator.take(table)
        at = time_s[chosen].tolist()
        for name, axis in axes.items():
            if name not in places:
                continue
            rows = filtered[:, places[name]]
            X = rows[:, : len(axis.names)].copy()
            for i, factors in enumerate(axis.factors):
                if not factors:  # the constant's column is the weight, which is filtered as the others are
                    X[:, i] = rows[:, -2]
            for when, row in zip(at, np.column_stack([X, rows[:, -2:]]), strict=True):
                axis.detector.add(when, row)
