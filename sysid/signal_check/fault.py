"""A mistake that was found in the signals of a flight."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mistake:
    """One mistake found.

    signal: its name, or that of a group of GROUPS. kind: unit, sign, axis, scale or delay.
    found: the factor to multiply by, the delay in s; NaN for axes.
    unit: what the readings seem to be in, that of a delay. signals: all signals concerned.
    """

    signal: str
    kind: str
    found: float
    unit: str
    sentence: str
    signals: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """As results hold it."""
        return {
            "signal": self.signal, "signals": list(self.signals), "kind": self.kind, "found": self.found,
            "unit": self.unit, "sentence": self.sentence,
        }  # fmt: skip
