"""The plain sentence of a discrepancy's result: what is missing, how much of the gap it closes, what is left.

Every number comes from the result. A share of a gap is counted above the noise floor: gap and noise add in quadrature,
so of a gap g over a floor f the part sqrt(g^2 - f^2) is the model's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sysid.discrepancy.wording import axis_words, digits, effect_phrase, effect_title, variable_words

Result = Mapping[str, Any]
#: Up to this many times the noise floor, which is itself drawn, a gap is called noise.
NOISE_TIMES = 1.25
_COUNTS = {2: "Two", 3: "Three"}


@dataclass(frozen=True)
class _Gap:
    """One output's gap at two stages in times of the noise floor. before: inf where the simulation was lost."""

    output: str
    before: float
    after: float

    @property
    def closed(self) -> float:
        """Share of the gap above the floor that is gone, at most 1; negative where it grew."""
        before, after = _above(self.before), _above(self.after)
        return 1.0 - after / before if before > 0.0 else 0.0


def sentence(result: Result) -> str:
    """What a result of schema discrepancy/1 says, in one or a few sentences."""
    text = {
        "none": _none,
        "parameter_error": _parameter_error,
        "missing_effect": _missing_effect,
        "unexplained": _unexplained,
    }[result["verdict"]](result)
    return text[0].upper() + text[1:]


def shrinking(gap: Mapping[str, Mapping[str, float | None]], before: str, after: str) -> list[str]:
    """Outputs of a gap table, that first whose gap above the noise floor shrinks most from one stage to another."""
    return [one.output for one in _compared(gap, before, after)]


def _none(result: Result) -> str:
    where, gap = _judged(result)
    outputs = _compared(gap, "given", "given")
    if not outputs:
        return "nothing is missing: no effect and no error of the coefficients is significant against noise and gusts."
    largest = max(outputs, key=lambda one: one.before)
    return (
        "nothing is missing: no effect and no error of the coefficients is significant against noise and gusts; the "
        f"largest gap {where}, that of {largest.output}, is {_times(largest.before)}."
    )


def _parameter_error(result: Result) -> str:
    closed = _closed(result, "given", "before", "fitting them again")
    return f"no effect is missing, but coefficients of the model are wrong: {closed}."


def _missing_effect(result: Result) -> str:
    effects = result["effects"]
    if len(effects) > 1:
        count, listed = _COUNTS.get(len(effects), str(len(effects))), "; ".join(map(effect_phrase, effects))
        others = "".join(f" {_instead(effect)}" for effect in effects if effect.get("alternatives"))
        closed = _closed(result, "before", "after", "adding them")
        return f"{count} effects are missing: {listed}. {_capital(closed)}.{others}"
    (effect,) = effects
    if not effect.get("alternatives"):
        return f"{effect_phrase(effect)}: {_closed(result, 'before', 'after', 'adding it')}."
    closed = _closed(result, "before", "after", "adding the first")
    return (
        f"{effect_phrase(effect)} (probability {_percent(effect['probability'])}), or it is {_others(effect)}: this "
        f"flight cannot distinguish them. What would: {effect['separating_manoeuvre']}. {_capital(closed)}."
    )


def _unexplained(result: Result) -> str:
    where, gap = _judged(result)
    text = "the model and the flight disagree, and no effect of the catalogue explains it"
    if result.get("where"):
        place = result["where"][0]
        share = f", which goes with {_percent(place['share'])} of it" if place.get("share") is not None else ""
        text += f": most in {axis_words(place['axis'])} over {variable_words(place['variable'])}{share}"
    outputs = _compared(gap, "before", "before")
    if not outputs:
        return f"{text}."
    largest = max(outputs, key=lambda one: one.before)
    lost = "is lost within its windows" if math.isinf(largest.before) else f"is {_times(largest.before)}"
    return f"{text}; fitted again, the largest gap {where}, that of {largest.output}, {lost}."


def _closed(result: Result, before: str, after: str, deed: str) -> str:
    """How much of which gap something closes, and what is left."""
    where, gap = _judged(result)
    outputs = _compared(gap, before, after)
    if not outputs:
        return f"{deed} is what the likelihood asks for; the gap {where} could not be compared"
    most = outputs[0]
    if math.isinf(most.before):
        left = f"{deed} leaves {_times(most.after)}{_rest(outputs)}"
        return f"without it the simulation of {most.output} {where} is lost; {left}"
    if _above(most.before) <= _above(most.after):
        return f"{deed} shows in the likelihood alone: no gap {where} shrinks by it{_rest(outputs)}"
    return (
        f"{deed} closes {_percent(most.closed)} of the gap of {most.output} {where} (from {most.before:.1f} to "
        f"{_times(most.after)}){_rest(outputs)}"
    )


def _rest(outputs: Sequence[_Gap]) -> str:
    """What is left with the last stage: noise, or the output furthest from it."""
    worst = max(outputs, key=lambda one: one.after)
    if worst.after <= NOISE_TIMES:
        return "; the rest is noise"
    return f"; most is left of {worst.output}, {_times(worst.after)}"


def _judged(result: Result) -> tuple[str, Mapping[str, Any]]:
    """The gap table that a sentence speaks of, and its flights in words: those not used, where there are any."""
    gaps, curves = result["gap"], result.get("series") or {}
    if gaps.get("validation"):
        return f"on the {_flights(len(curves.get('validation') or [0]))} not used", gaps["validation"]
    return f"on the {_flights(len(result.get('flights') or [0]))} used", gaps["estimation"]


def _flights(count: int) -> str:
    return "flight" if count == 1 else "flights"


def _compared(gap: Mapping[str, Mapping[str, float | None]], before: str, after: str) -> list[_Gap]:
    """Outputs with a gap after and a floor, that which shrinks most first; one lost before is inf."""
    found = []
    for output, floor in gap.get("noise_floor", {}).items():
        end, begin = gap.get(after, {}).get(output), gap.get(before, {}).get(output)
        if before == after and end is None and floor:
            end = math.inf
        if end is not None and floor:
            found.append(_Gap(output, math.inf if begin is None else begin / floor, end / floor))
    return sorted(found, key=lambda one: -_shrinks(one))


def _shrinks(gap: _Gap) -> float:
    return 0.0 if gap.before == gap.after else _above(gap.before) - _above(gap.after)


def _above(times: float) -> float:
    """The part of a gap above the noise floor, in times of the floor."""
    return math.sqrt(max(times**2 - 1.0, 0.0))


def _instead(effect: Result) -> str:
    instead = f"Instead of {effect_title(effect['name'])} it may be {_others(effect)}"
    return f"{instead}; what would distinguish them: {effect['separating_manoeuvre']}."


def _others(effect: Result) -> str:
    return " or ".join(f"{effect_title(o['name'])} ({_percent(o['probability'])})" for o in effect["alternatives"])


def _percent(share: float) -> str:
    """Whole per cent; what is not all of it is never called 100 %."""
    if share < 0.995 or share == 1.0:
        return f"{100.0 * share:.0f} %"
    return "more than 99 %"


def _times(ratio: float) -> str:
    """A multiple of the noise floor."""
    if math.isinf(ratio):
        return "beyond all bounds"
    return f"{ratio:.1f} times the noise floor" if ratio < 100.0 else f"{digits(ratio)} times the noise floor"


def _capital(words: str) -> str:
    return words[0].upper() + words[1:]
