"""Moments of inertia from what one measures with a watch, a ruler and a scale; each with its standard error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gcs.errors import VehicleError
from sim_vehicle.constants import STANDARD_GRAVITY
from sim_vehicle.vehicle.mass_properties import usual_inertia

#: Of a person with a stop watch, s, 1 sigma, for one start and stop (a reaction time scatters by 0.05 to 0.1 s).
WATCH_STD_S = 0.1
# Of what nobody gives an error for: a kitchen scale, a ruler along a fuselage.
_SCALE_SHARE, _RULER_M = 0.005, 0.002
# Times of the same swings that scatter by a larger share of their mean are not of the same swings.
_STEADY = 0.35
# Of a mass, a length, a time, SI: what is smaller, or larger than its inverse, nobody has measured.
_SMALLEST = 1e-6


@dataclass(frozen=True)
class Measured:
    """A measured quantity and its standard error, SI."""

    value: float
    std: float


def period(times_s: Sequence[float], swings: int, watch_std_s: float = WATCH_STD_S) -> Measured:
    """Period of a pendulum, s, from the times that `swings` whole swings took, each timed once.

    Its error is what the times scatter by, and no less than what a stop watch leaves. Raises VehicleError.
    """
    if not times_s or swings < 1 or any(not 0.0 < time < 1e4 for time in times_s):
        raise VehicleError("times of swings must be positive, s, and at least one swing is timed")
    mean = sum(times_s) / len(times_s)
    spread = math.sqrt(sum((time - mean) ** 2 for time in times_s) / max(len(times_s) - 1, 1))
    if spread > _STEADY * mean:
        shown = ", ".join(f"{time:g}" for time in times_s)
        raise VehicleError(f"the times ({shown} s) differ too much: swings miscounted?")
    return Measured(mean / swings, max(spread, watch_std_s) / math.sqrt(len(times_s)) / swings)


def by_bifilar(
    mass: Measured, length_m: Measured, spacing_m: Measured, swing: Measured, gravity: float = STANDARD_GRAVITY
) -> Measured:
    """Moment of inertia about the vertical through the centre of gravity, kg m^2, of an aircraft hung on two wires.

    length_m: of each wire; spacing_m: between the two, half on either side of the centre of gravity; swing: the period
    of its turning about the vertical, s. I = m g D^2 T^2 / (16 pi^2 L): M. Jardin and E. Mueller, "Optimized
    Measurements of Unmanned-Air-Vehicle Mass Moment of Inertia with a Bifilar Pendulum", Journal of Aircraft 46
    (2009), eq. 8 for small angles. Raises VehicleError.
    """
    _positive(mass=mass, length=length_m, spacing=spacing_m, period=swing)
    value = mass.value * gravity * (spacing_m.value * swing.value) ** 2 / (16.0 * math.pi**2 * length_m.value)
    shares = (_share(mass), _share(length_m), 2.0 * _share(spacing_m), 2.0 * _share(swing))
    return Measured(value, value * math.hypot(*shares))


def by_swing(mass: Measured, arm_m: Measured, swing: Measured, gravity: float = STANDARD_GRAVITY) -> Measured:
    """Moment of inertia about the centre of gravity, kg m^2, of an aircraft that swings about an axis above it.

    arm_m: from the axis to the centre of gravity; swing: its period, s. The axis is parallel to the one that the
    moment of inertia is about. I = m g l T^2 / (4 pi^2) - m l^2: M. Soule and M. Miller, NACA Report 467 (1933).
    Raises VehicleError, also where the difference is within two errors: the arm is then too long for the aircraft.
    """
    _positive(mass=mass, arm=arm_m, period=swing)
    whole = mass.value * gravity * arm_m.value * swing.value**2 / (4.0 * math.pi**2)
    shift = mass.value * arm_m.value**2
    value = whole - shift
    std = math.hypot(
        value * _share(mass), (whole - 2.0 * shift) * _share(arm_m), 2.0 * whole * _share(swing)
    )  # the same mass and arm are in both parts
    if value <= 2.0 * std:
        raise VehicleError(
            f"arm and period leave a moment of inertia of {value:.3g} +- {std:.2g} kg m^2, which says nothing: hang it"
            " closer to its centre of gravity, or use two wires"
        )
    return Measured(value, std)


def scale(mass_kg: float, std_kg: float | None = None) -> Measured:
    """A mass on a scale; half a per cent where nobody says how well it is known."""
    return Measured(mass_kg, _SCALE_SHARE * mass_kg if std_kg is None else std_kg)


def ruler(length_m: float, std_m: float | None = None) -> Measured:
    """A length by a ruler; 2 mm where nobody says how well it is known."""
    return Measured(length_m, _RULER_M if std_m is None else std_m)


def _share(measured: Measured) -> float:
    return measured.std / measured.value


def _positive(**measured: Measured) -> None:
    for name, one in measured.items():
        if not (_SMALLEST < one.value < 1.0 / _SMALLEST and 0.0 <= one.std < 1.0 / _SMALLEST):
            raise VehicleError(f"{name} is {one.value:g} +- {one.std:g}, which nobody has measured")


def usual(mass: Measured, span_m: float) -> dict[str, Measured]:
    """Moments of inertia, kg m^2, that are usual for an aircraft of that mass and span, by name; known to 70 %."""
    if not span_m > 0.0:
        raise VehicleError(f"a span of {span_m:g} m is none")
    return {key: Measured(value, std) for key, (value, std) in usual_inertia(mass.value, span_m).items()}
