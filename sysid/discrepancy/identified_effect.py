"""An effect that was named, and how a result reports it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sim_vehicle.effects import EFFECTS, Effect, Remembers
from sim_vehicle.model.model_file import Model
from sysid.discrepancy.candidates import Candidate
from sysid.discrepancy.significance import Significance
from sysid.discrepancy.wording import chance_text

# Standard errors beyond the catalogue's range of a parameter that are none of chance.
_BEYOND = 3.0
# A memory that is known only nearly leaves this share of what it gains for others to pick up.
_IMPRECISE = 0.03
# Share of an interval between samples to which it is known when something was so.
_STAMPS = 0.05


@dataclass(frozen=True)
class Named:
    """An effect that was added: its candidate, its significance, the alternatives, the estimates, among how many
    effects it was the likeliest, and what the likelihood gained (twice its logarithm) when it came in.
    """

    candidate: Candidate
    significance: Significance
    alternatives: tuple[tuple[str, float], ...]
    values: Mapping[str, tuple[float, float]]
    tried: int
    came_with: float

    @property
    def effect(self) -> str:
        """Name of its effect."""
        return self.candidate.effect.name

    @property
    def lags(self) -> bool:
        """Whether it has a memory that the filter knows only nearly."""
        return self.candidate.effect.memory not in (Remembers.NONE, Remembers.INPUT)


def impossible(named: Sequence[Named]) -> list[str]:
    """Effects whose size no aircraft has, beyond the catalogue's range: they stand for something else. A line each."""
    found = []
    for one in named:
        ranges = {parameter.name: parameter for parameter in one.candidate.effect.parameters}
        for name, (value, std) in one.values.items():
            low, high = ranges[name].low, ranges[name].high
            if max(low - value, value - high) > _BEYOND * std:
                found.append(
                    f"{one.effect}: {name} = {value:.3g} is beyond what an aircraft has ({low:g} to {high:g}): it"
                    " stands for something else"
                )
    return found


def unmodelled_memory_gain(named: Sequence[Named]) -> float:
    """Gain (twice the log likelihood) that memories known only nearly may leave to others.

    It is of what each came in with: beside others that explain the rest of the flight, noise is so small that a memory
    gains hundreds of times as much, and a share of that would hide every other effect.
    """
    return _IMPRECISE * max((one.came_with for one in named if one.lags), default=0.0)


def reason(named: Named) -> str:
    """What it was named for, in words."""
    significance = named.significance
    return (
        f"{named.candidate.effect.name}: the likelihood gains {significance.gain:.0f} "
        f"({chance_text(significance.p_value)}, {named.tried} effects looked at)"
    )


def nearly(effect: str, significance: Significance, tried: int) -> str:
    """That an effect is likely but not significant enough for a name, in words."""
    return (
        f"{effect}: the likelihood would gain {significance.gain:.0f} ({chance_text(significance.p_value)}, "
        f"{tried} effects looked at); not named below five standard errors"
    )


def beside_first(effect: str, gain: float, first: str) -> str:
    """That a further effect is no name beside the first, in words."""
    return f"{effect}: gains {gain:.0f}, no more than {first} may leave"


def within_stamps(candidate: Candidate, values: Mapping[str, tuple[float, float]], interval_s: float) -> str:
    """That what an effect comes late by is less than stamps are known to, in words; "" where it is not.

    values: value and standard error by parameter. interval_s: between samples. From a share of an interval on commands
    and readings are late for good; below it the moment of a sample is no better known.
    """
    times = [p.name for p in candidate.effect.parameters if p.unit == "s" and p.name in candidate.sizes]
    late = {name: values[name][0] for name in times}
    least = _STAMPS * interval_s
    if not late or max(late.values()) >= least:
        return ""
    words = ", ".join(f"{name} = {1e3 * value:.2g} ms" for name, value in late.items())
    return f"{candidate.effect.name}: {words} is within what stamps are known to ({1e3 * least:.2g} ms)"


def effect_json(named: Named, model: Model) -> dict[str, Any]:
    """It as an entry of `effects` in a result file (schema discrepancy/1). model: that has it, with whole errors."""
    effect = named.candidate.effect
    entries = {f"{one.name}.{key}": entry for one in model.effects for key, entry in one.parameters.items()}
    entries |= model.coefficients
    return {
        "name": effect.name,
        "title": effect.title,
        "probability": round(min(named.significance.probability, 0.9999), 4),
        "parameters": {
            name: {**entries[named.candidate.parameter(name)].to_json(), "unit": effect.parameter(name).unit}
            for name in named.values
        },
        "alternatives": [{"name": name, "probability": round(p, 4)} for name, p in named.alternatives],
        "separating_manoeuvre": _separating(effect, [name for name, _ in named.alternatives]),
    }


def _separating(effect: Effect, alternatives: Sequence[str]) -> str:
    """The manoeuvre that separates an effect from the likeliest of its alternatives; without any, a general one."""
    return effect.manoeuvre_against(EFFECTS[alternatives[0]]) if alternatives else effect.separated_by
