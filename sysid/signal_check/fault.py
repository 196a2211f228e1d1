"""A mistake that was found in the signals of a flight."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.signals.delay import Delay, delay_sentence


@dataclass(frozen=True)
class Mistake:
    """One mistake found.

    signal: its name, or that of a group of GROUPS. kind: unit, sign, axis, scale or delay.
    found: the factor to multiply by, or the delay in s; NaN for axes. std: its standard error where it is an estimate.
    unit: what the readings seem to be in, or the unit of `found`. signals: all signals concerned.
    usable: whether the flight can be used, corrected (delays) or with care.
    """

    signal: str
    kind: str
    found: float
    std: float
    unit: str
    sentence: str
    signals: tuple[str, ...]
    usable: bool

    def to_json(self) -> dict[str, object]:
        """As results hold it."""
        return {
            "signal": self.signal, "signals": list(self.signals), "kind": self.kind, "found": self.found,
            "std": self.std, "unit": self.unit, "sentence": self.sentence,
        }  # fmt: skip


def delay_mistake(delay: Delay) -> Mistake:
    """A delay as a finding."""
    return Mistake(delay.name, "delay", delay.value, delay.std, "s", delay_sentence(delay), delay.signals, True)
