"""Effects, quantities and numbers as people say them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sim_vehicle.effects import EFFECTS

# Units of people: (factor from SI, what stands behind the number).
_UNITS = {
    "deg": (180.0 / math.pi, "°"), "deg/s": (180.0 / math.pi, " °/s"), "ms": (1e3, " ms"), "mm": (1e3, " mm"),
    "%": (1e2, " %"), "s": (1.0, " s"), "m/s": (1.0, " m/s"), "N": (1.0, " N"),
}  # fmt: skip
# Which of them a parameter is given in where no phrase says it.
_OF_SI = {"rad": "deg", "rad/s": "deg/s", "s": "ms", "m": "mm", "m/s": "m/s", "N": "N"}
_DIGITS = 3  # of a figure in a sentence
# Far below what double precision holds with all its digits: nearer to zero only the order of the zero is reported.
LEAST_EXPONENT = -300
_AXES = {
    "CL": "lift", "CD": "drag", "CY": "the side force", "Cl": "the rolling moment", "Cm": "the pitching moment",
    "Cn": "the yawing moment",
}  # fmt: skip
_VARIABLES = {
    "alpha": "angle of attack", "beta": "sideslip", "V": "airspeed", "phat": "roll rate", "qhat": "pitch rate",
    "rhat": "yaw rate", "alphadot": "the rate of angle of attack", "de": "elevator", "da": "aileron", "dr": "rudder",
    "thrust": "thrust",
}  # fmt: skip


def digits(value: float, std: float | None = None) -> str:
    """A number to three significant digits, or to the fewer that its standard error allows."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    places = _DIGITS - 1 - math.floor(math.log10(abs(value)))
    if std is not None and 0.0 < std < math.inf:
        places = min(places, -math.floor(math.log10(std)))
    if places > 6:
        return f"{value:.{_DIGITS}g}"
    shown = round(value, places)
    return f"{shown:.{max(places, 0)}f}" if shown else "0"


@dataclass(frozen=True)
class _Number:
    """An estimate that a phrase shows in a unit of people: `{tau:ms}`."""

    value: float
    std: float | None

    def __format__(self, unit: str) -> str:
        factor, sign = _UNITS[unit] if unit else (1.0, "")
        return digits(factor * self.value, None if self.std is None else factor * self.std) + sign


def effect_phrase(effect: Mapping[str, Any]) -> str:
    """What an entry of `effects` in a result says, with its parameters, without a full stop.

    A phrase needs all of its parameters; with fewer, and for an effect without a phrase, the title and what there is.
    """
    numbers = {
        name: _Number(float(entry["value"]), entry.get("std"))
        for name, entry in effect.get("parameters", {}).items()
        if entry.get("value") is not None
    }
    phrase = EFFECTS[effect["name"]].phrase if effect["name"] in EFFECTS else ""
    if phrase:
        try:
            return phrase.format_map(numbers)
        except KeyError:
            pass
    listed = ", ".join(f"{name} = {_in_units(effect['name'], name, number)}" for name, number in numbers.items())
    return f"{effect_title(effect['name'])} ({listed})" if listed else effect_title(effect["name"])


def effect_title(name: str) -> str:
    """The catalogue's noun phrase of an effect; of a name that is not in it the name."""
    return EFFECTS[name].title if name in EFFECTS else name


def axis_words(axis: str) -> str:
    """A coefficient of force or moment in words, with its name."""
    return f"{_AXES[axis]} ({axis})" if axis in _AXES else axis


def variable_words(name: str) -> str:
    """What a residual depends on, in words."""
    return _VARIABLES.get(name, name)


def _in_units(effect: str, name: str, number: _Number) -> str:
    """A number in a unit of people where it has one."""
    known = {p.name: p for p in EFFECTS[effect].parameters} if effect in EFFECTS else {}
    if name not in known:
        return f"{number}"
    unit = "s" if known[name].moment else _OF_SI.get(known[name].unit)
    if unit is not None:
        return format(number, unit)
    return f"{number}" if known[name].unit == "1" else f"{number} {known[name].unit}"


def too_small(p_value: float) -> bool:
    """Whether a p value is only known to be below 1e-300. No p value is zero: such a one is what underflow left."""
    return p_value < float(f"1e{LEAST_EXPONENT}")


def chance_text(p_value: float) -> str:
    """A p value within a sentence."""
    return f"chance below 1e{LEAST_EXPONENT}" if too_small(p_value) else f"chance {p_value:.1e}"


def moved_words(distance: float, count: int, p_value: float) -> str:
    """How far `count` parameters fitted again are from those given; distance: chi-squared of all together."""
    typical = math.sqrt(max(distance, 0.0) / max(count, 1))
    return (
        f"fitted again, the model's {count} parameters move by {typical:.1f} standard errors on average"
        f" (chi-squared {distance:.0f}, {chance_text(p_value)})"
    )
