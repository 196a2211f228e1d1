"""The verdict of a flight: good, usable with care, or too poor, because of reasons that one can read and mend."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from sim_vehicle.model.aerodynamic_terms import AXES
from sysid.problem.model_structure import LONGITUDINAL_AXES

GOOD, CARE, POOR = "good", "care", "poor"
LONGITUDINAL, LATERAL = LONGITUDINAL_AXES, tuple(axis for axis in AXES if axis not in LONGITUDINAL_AXES)


@dataclass(frozen=True)
class Reason:
    """One thing that speaks against a flight.

    verdict: "care" or "poor". text: what is so. advice: what to do better next time. axes: those that it concerns,
    empty for all of them. no_numbers: whether no bar says how wrong the coefficients of these axes are, so that none is
    reported.
    """

    verdict: str
    text: str
    advice: str = ""
    axes: tuple[str, ...] = ()
    no_numbers: bool = False

    @property
    def cure(self) -> str:
        """Text and advice in one line."""
        return f"{self.text}{f'; {self.advice}' if self.advice else ''}"

    @property
    def sentence(self) -> str:
        """Axes, text and advice in one line."""
        return f"{', '.join(self.axes)}: {self.cure}" if self.axes else self.cure


@dataclass(frozen=True)
class Quality:
    """All reasons. axes: of AXES that were asked for. not_flown: those of them that no surface excited, and why."""

    reasons: tuple[Reason, ...]
    axes: tuple[str, ...]
    not_flown: tuple[Reason, ...] = ()

    def of_axis(self, axis: str) -> str:
        """Verdict of one axis, by what concerns it."""
        if any(axis in one.axes for one in self.not_flown):
            return POOR
        return _worst(one.verdict for one in self.reasons if not one.axes or axis in one.axes)

    def refusal(self, axis: str) -> str:
        """Why no number of that axis is reported, and what to do; "" where they are."""
        against = (*self.reasons, *self.not_flown)
        return next((one.cure for one in against if one.no_numbers and (not one.axes or axis in one.axes)), "")

    @property
    def verdict(self) -> str:
        """Of the flight: poor where something concerns all axes or no axis that was flown is better than poor; good
        where nothing is wrong and every axis was flown.
        """
        lost = {axis for one in self.not_flown for axis in one.axes}
        flown = [axis for axis in self.axes if axis not in lost]
        whole = _worst(one.verdict for one in self.reasons if not one.axes)
        if whole == POOR or not flown or all(self.of_axis(axis) == POOR for axis in flown):
            return POOR
        return CARE if self.reasons or self.not_flown else GOOD

    def to_json(self) -> dict[str, Any]:
        """The block `quality` of a result."""
        return {
            "verdict": self.verdict,
            "reasons": [one.sentence for one in (*self.reasons, *self.not_flown)],
            "axes": {
                axis: {
                    "verdict": self.of_axis(axis),
                    "reasons": [one.cure for one in (*self.reasons, *self.not_flown) if axis in one.axes],
                }
                for axis in self.axes
            },
        }


NOTHING_SEEN = Quality((), ())


def once(reasons: Iterable[Reason]) -> tuple[Reason, ...]:
    """The reasons in order, the poor ones first, each sentence once."""
    every = {one.sentence: one for one in reasons}.values()
    return (*(one for one in every if one.verdict == POOR), *(one for one in every if one.verdict != POOR))


def _worst(verdicts: Iterable[str]) -> str:
    found = set(verdicts)
    return POOR if POOR in found else CARE if CARE in found else GOOD
