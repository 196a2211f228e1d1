"""When an effect is named: where it takes nearly all of what can be explained, whatever the noise model.

Models and sensors are never known to the per cent, and from a gain of millions anything still finds hundreds. So what
is left counts against the name by its share and not by its chance: where a right name was the first, it took 86 to
100 % of what names and smooth terms explain; the nearest names of effects that the catalogue does not have took 70 to
80 %, wrong ones less than 60 %, or several of them shared what one explains: beside anything left a name stands alone.

What is lost without an effect is never more than what all that was named explains: a fit without it that ends beyond
that has not found its end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

#: Twice the log likelihood that a candidate must promise for any to be fitted (3.5 standard errors of one size), and
#: the share of the best promise below which one is out of the race.
LEAST_PROMISE, PROMISE_SHARE = 12.0, 0.1
#: Times Wald's statistic of its sizes that a gain may be.
BORNE_OUT = 4.0
#: Log evidence that a name needs (150 to 1: "very strong", Kass & Raftery, J. Am. Stat. Assoc. 90, 1995).
EVIDENCE = 5.0
#: Share of what can be explained from which on the first name is the right one.
LEAST_SHARE = 0.85
#: Of what the first name gains, below which a further one is not tried beside it.
COMPANION_SHARE = 0.1
#: And below which one that was named may be what the first leaves of itself: a stall of another shape than the
#: catalogue's leaves a quarter to a polar.
OWN_SHARE = 0.3

#: Share of what an axis' own terms explain that surfaces known to a microsecond or two, their edges between samples and
#: the sensors' places leave to smooth terms: where nothing was missing it has been up to 1.0e-4.
KNOWN_TO = 2e-4
#: Chance of coefficients as far from those given, below which those are wrong.
CHANCE = 1e-4
#: Times as wide as without names the gap may be with them: right ones have been seen to widen it by 4 %.
WIDER = 1.1


@dataclass(frozen=True)
class LeftOver:
    """What is left on an axis, or in an output, without a name.

    words: how it shows. gain: twice the log likelihood that smooth terms of the axis still gain; 0 where it shows in
    noise alone.
    """

    words: str
    gain: float = 0.0


@dataclass(frozen=True)
class Explained:
    """What can be explained of a disagreement.

    gains: effect that was named -> twice the log likelihood that is lost without it. whole: what all names gain
    together, those that were taken back since included. left: by axis or output. taken_back: names that the first may
    have left of itself.
    """

    gains: Mapping[str, float]
    whole: float = 0.0
    left: Mapping[str, LeftOver] = field(default_factory=dict)
    taken_back: Sequence[str] = ()

    @property
    def total(self) -> float:
        """What all names gain together, and what is left."""
        return self.whole + sum(one.gain for one in self.left.values())

    @property
    def first(self) -> str:
        """Name of the effect that gains most, "" where none was named."""
        return max(self.gains, key=lambda name: self.gains[name], default="")

    @property
    def share(self) -> float:
        """Share of it that the first name takes."""
        return min(self.gains[self.first], self.whole) / self.total if self.gains else 0.0

    @property
    def complete(self) -> bool:
        """Whether nothing is left beyond chance, by the names that stay."""
        return not self.left and not self.taken_back

    @property
    def is_right(self) -> bool:
        """Whether the names are: they explain everything, or one alone nearly everything."""
        return bool(self.gains) and (not self.left or (len(self.gains) == 1 and self.share >= LEAST_SHARE))

    def reasons(self) -> list[str]:
        """What is left, and what the first name takes, in words."""
        if not self.left:
            return []
        found = ["left without a name: " + "; ".join(f"{axis} ({one.words})" for axis, one in self.left.items())]
        if self.gains:
            needed = ""
            if len(self.gains) > 1:
                needed = f", beside {', '.join(name for name in self.gains if name != self.first)}: none of them alone"
            elif not self.is_right:
                needed = f", too little for a name ({LEAST_SHARE:.0%})"
            found.append(f"{self.first} takes {self.share:.0%} of what can be explained{needed}")
        return found

    def nearest_json(self) -> dict[str, object] | None:
        """The first name, where it takes too little for one: `nearest` in a result file (schema discrepancy/1)."""
        return {"name": self.first, "share": self.share} if self.gains else None

    def left_json(self) -> list[dict[str, object]]:
        """Entries of `left` in a result file (schema discrepancy/1)."""
        total = self.total
        return [
            {"axis": axis, "share": one.gain / total if total else 0.0, "words": one.words}
            for axis, one in self.left.items()
        ]


@dataclass(frozen=True)
class Judgement:
    """Judgement of a comparison (schema discrepancy/1), the tests it rests on in words, and what can be explained."""

    name: str
    reasons: Sequence[str]
    explained: Explained


def is_too_little_beside(first: float, gain: float) -> bool:
    """Whether an effect gains too little to be tried beside the first one, by what that gains."""
    return gain < COMPANION_SHARE * first


def left_of_the_first(gains: Mapping[str, float], whole: float) -> list[str]:
    """Names that gain no more than the first one may leave of itself. gains, whole: as of `Explained`."""
    first = min(max(gains.values(), default=0.0), whole)
    return [name for name, gain in gains.items() if gain < OWN_SHARE * first]
