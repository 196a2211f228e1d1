"""Surfaces that stand still in the recording while the aircraft moves as if they did not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.arrays import Array
from sysid.equation_error.coefficients import Body
from sysid.equation_error.time_domain import equation_error
from sysid.errors import SysidError
from sysid.signals.flight import FlightData

# Surface -> its control in the vehicle file, the moment that it makes, and what else makes that moment.
_MADE_BY = {
    "de": ("elevator", "Cm", ("0", "alpha", "q")),
    "da": ("aileron", "Cl", ("0", "beta", "p", "r")),
    "dr": ("rudder", "Cn", ("0", "beta", "p", "r")),
}
_SURFACES = tuple(_MADE_BY)
_STILL = 1e-4  # rad
# A moment is unexplained if motion and the other surfaces leave this share of its variance and so many times its noise.
_SHARE, _NOISES = 0.15, 20.0


def frozen_commands(
    parts: Sequence[FlightData], body: Body, noise: Sequence[Mapping[str, float]], recorded: Sequence[str]
) -> dict[str, str]:
    """Every surface whose value never changes though its moment does: what to say of it, with the cure.

    parts: corrected parts for equation error, of flights in calm air: gusts make moments too. noise: per part, axis ->
    noise of its moment coefficient. recorded: the surfaces that the flights have at all.
    """
    known = [name for name in _SURFACES if name in recorded and all(name in part for part in parts)]
    still = [name for name in known if max(float(np.ptp(part[name])) for part in parts) < _STILL]
    sentences = {}
    for name in still:
        control, axis, motion = _MADE_BY[name]
        others = [other for other in known if other not in still and (axis == "Cm") == (other == "de")]
        others += [other for other in body.named_controls if max(float(np.ptp(part[other])) for part in parts) > _STILL]
        try:
            found = equation_error(parts, body, [f"{axis}_{term}" for term in (*motion, *others)])[axis]
        except SysidError:
            continue
        level = float(np.median([one[axis] for one in noise]))
        if found.r2 < 1.0 - _SHARE and _rms(found.residual) > _NOISES * level:
            sentences[name] = (
                f"{name}: repeats one value, yet {1.0 - found.r2:.0%} of the moment {axis} comes from nothing else that"
                f" is recorded: its channel is dead. Check controls.{control} of the vehicle file, its servo number"
                f" and what records it; the {part_of(name)} coefficients are refused"
            )
    return sentences


def part_of(surface: str) -> str:
    """Which part of the motion a surface steers."""
    return "longitudinal" if surface == "de" else "lateral"


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
