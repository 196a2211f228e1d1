"""The signs that a prior's surfaces have, and what contradicts them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

from gcs.errors import PriorError
from gcs.priors.estimate import Estimate
from sim_vehicle.model.aerodynamic_terms import parse_term

#: What a positive deflection is, by the control's name.
POSITIVE = {
    "elevator": "trailing edge down, which pitches the nose down",
    "aileron": "the right one's trailing edge down, which rolls to the left",
    "rudder": "trailing edge to the left, which yaws to the left",
}
SURFACES = {"elevator": "de", "aileron": "da", "rudder": "dr"}
# Moments that a positive deflection makes: all negative about body axes (x forward, y right, z down).
_MOMENT = {"elevator": "Cm_de", "aileron": "Cl_da", "rudder": "Cn_dr"}
# Derivatives whose sign every aircraft shares below the stall: where one has the other, the file has other axes.
_OF_EVERY_AIRCRAFT = {"CL_alpha": 1.0, "Cl_p": -1.0, "Cm_q": -1.0}


def require_signs(found: Mapping[str, Estimate], where: str) -> None:
    """Raise PriorError, one line, for the first derivative whose sign is not ours. where: the file's name."""
    for name, sign in _OF_EVERY_AIRCRAFT.items():
        if name in found and not sign * found[name].value > 0.0:
            expected = "positive" if sign > 0.0 else "negative"
            raise PriorError(
                f"{where}: {name} is {found[name].value:g}, and {expected} below the stall on every aircraft; write the"
                " file anew for a flight below the stall, in axes with x forward and z down"
            )
    for control, name in _MOMENT.items():
        if name in found and not found[name].value < 0.0:
            raise PriorError(
                f"{where}: {name} is {found[name].value:g} per rad, and must be negative: a positive {control} is"
                f" {POSITIVE[control]}; turn the control's sign there and write the file anew"
            )


def reversed_controls(found: Mapping[str, Estimate], controls: Collection[str]) -> dict[str, Estimate]:
    """The estimates for a vehicle file that counts the deflections of these controls the other way."""
    turned = {SURFACES[control] for control in controls}
    return {
        name: replace(one, value=-one.value + 0.0) if turned & set(parse_term(name).factors) else one
        for name, one in found.items()
    }


def sign_words(found: Mapping[str, Estimate], turned: Collection[str]) -> list[str]:
    """One line for each control that the model has: what its positive deflection is. turned: controls counted the
    other way.
    """
    there = {factor for name in found for factor in parse_term(name).factors}
    return [
        f"a {'negative' if control in turned else 'positive'} {control} is {words}"
        for control, words in POSITIVE.items()
        if SURFACES[control] in there
    ]
