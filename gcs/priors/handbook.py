"""A whole aircraft from its sizes, by the formulas of handbooks.

Wing: lifting-line theory of the elliptic wing (Glauert, The Elements of Aerofoil and Airscrew Theory, ch. 11). Tail and
fin: their lift slope times area and arm (Etkin & Reid, Dynamics of Flight, ch. 2, 3 and 5; McCormick, Aerodynamics,
Aeronautics and Flight Mechanics, ch. 8 and 9; Roskam, Airplane Design VI, ch. 10). What the sizes say nothing of is
what is usual, with a doubt as large (judgement).
"""

from __future__ import annotations

import math

from gcs.priors.estimate import Estimate, Estimates, least
from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.vehicle_file import Vehicle

# Aspect ratios that tails usually have; the fin's is the effective one, above a fuselage and a tail.
_TAIL_ASPECT, _FIN_ASPECT = 4.0, 3.0
# Dynamic pressure at the tail over that of the flight, and with it the sidewash at the fin.
_TAIL_EFFICIENCY = 0.9
# Of a surface's lift by incidence, what its flap gives: a third of tail and fin, a quarter of the wing.
_TAIL_FLAP, _AILERON_FLAP = 0.5, 0.4
# The ailerons' ends, half spans from the middle.
_AILERON = (0.5, 0.9)
# Of the tail's damping: wing and fuselage add a tenth (Roskam).
_WHOLE_DAMPING = 1.1
# Centre of gravity before the neutral point, chords, and how differently aircraft have it.
_MARGIN, _MARGIN_STD = 0.2, 0.15
# What a fuselage takes of the fin's directional stability.
_FUSELAGE_YAW = -0.03
_OSWALD = 0.8
_DAMPING, _CONTROL, _FIN = 0.3, 0.5, 0.5


def estimate(vehicle: Vehicle) -> Estimates:
    """Coefficients of an aircraft by its sizes, for the controls that it has, with their doubts."""
    left_out: list[str] = []
    found = _wing(vehicle)
    if vehicle.geometry.tail_area is None:
        left_out.append("CL_q, Cm_q, CL_de, Cm_de: give tail_area and tail_arm under [geometry] of the vehicle file")
    else:
        found |= _tail(vehicle)
    if vehicle.geometry.fin_area is None:
        left_out.append("what a fin gives (CY_beta, Cn_beta, CY_r, Cn_r, CY_dr, Cn_dr): give fin_area and fin_arm under"
            " [geometry] of the vehicle file")  # fmt: skip
    else:
        found |= _fin(vehicle)
    return Estimates(found, tuple(left_out))


def _slope(aspect_ratio: float) -> float:
    """Lift slope of an elliptic wing, per rad."""
    return 2.0 * math.pi * aspect_ratio / (aspect_ratio + 2.0)


def _level_lift(vehicle: Vehicle) -> float:
    """Lift coefficient of level flight."""
    density = vehicle.environment.air_density or SEA_LEVEL_DENSITY
    weight = vehicle.mass.mass * vehicle.environment.gravity
    return 2.0 * weight / (density * vehicle.flight.airspeed**2 * vehicle.geometry.S)


def _wing(vehicle: Vehicle) -> dict[str, Estimate]:
    aspect = vehicle.geometry.b**2 / vehicle.geometry.S
    lift, slope = _level_lift(vehicle), _slope(aspect)
    if vehicle.geometry.tail_area is not None:
        # The wing's downwash, 2 CL / (pi A) far behind it, takes a part of the tail's.
        left = 1.0 - 4.0 / (aspect + 2.0)
        slope += _TAIL_EFFICIENCY * _slope(_TAIL_ASPECT) * vehicle.geometry.tail_area / vehicle.geometry.S * left
    found = {
        "CL_alpha": Estimate(slope, 0.2, least("CL_alpha")),
        "CD_0": Estimate(0.05, 0.5, least("CD_0")),
        "CD_k": Estimate(1.0 / (math.pi * _OSWALD * aspect), 0.4, least("CD_k")),
        "Cm_alpha": Estimate(-_MARGIN * slope, _MARGIN_STD / _MARGIN, least("Cm_alpha")),
        "CY_p": Estimate(0.0, 0.0, 0.15),
        "Cl_beta": Estimate(-0.07, 0.0, 0.05),
        "Cl_p": Estimate(-math.pi * aspect / (4.0 * (aspect + 4.0)), _DAMPING, least("Cl_p")),
        "Cl_r": Estimate(lift / 4.0, 0.5, 0.08),
        "Cn_p": Estimate(-lift / 8.0, 0.5, 0.1),
    }
    if "aileron" in vehicle.controls:
        inner, outer = ((1.0 - end**2) ** 1.5 for end in _AILERON)
        rolling = 4.0 / 3.0 * aspect / (aspect + 4.0) * _AILERON_FLAP * (inner - outer)
        found |= {
            "Cl_da": Estimate(-rolling, _CONTROL, least("Cl_da")),
            "CY_da": Estimate(0.0, 0.0, 0.05),
            "Cn_da": Estimate(0.0, 0.0, 0.05),
        }
    return found


def _tail(vehicle: Vehicle) -> dict[str, Estimate]:
    area, arm = vehicle.geometry.tail_area or 0.0, vehicle.geometry.tail_arm or 0.0
    by_area = _TAIL_EFFICIENCY * _slope(_TAIL_ASPECT) * area / vehicle.geometry.S
    chords = arm / vehicle.geometry.c
    found = {
        "CL_q": Estimate(2.0 * by_area * chords, 0.5, 2.0),
        "Cm_q": Estimate(-2.0 * _WHOLE_DAMPING * by_area * chords**2, 0.4, least("Cm_q")),
    }
    if "elevator" in vehicle.controls:
        found |= {
            "CL_de": Estimate(_TAIL_FLAP * by_area, _CONTROL, 0.15),
            "Cm_de": Estimate(-_TAIL_FLAP * by_area * chords, _CONTROL, least("Cm_de")),
        }
    return found


def _fin(vehicle: Vehicle) -> dict[str, Estimate]:
    area, arm = vehicle.geometry.fin_area or 0.0, vehicle.geometry.fin_arm or 0.0
    by_area = _TAIL_EFFICIENCY * _slope(_FIN_ASPECT) * area / vehicle.geometry.S
    spans = arm / vehicle.geometry.b
    found = {
        "CY_beta": Estimate(-by_area, _FIN, 0.15),
        "CY_r": Estimate(2.0 * by_area * spans, _FIN, 0.15),
        "Cn_beta": Estimate(by_area * spans + _FUSELAGE_YAW, _FIN, 0.04),
        "Cn_r": Estimate(-2.0 * by_area * spans**2, 0.4, least("Cn_r")),
    }
    if "rudder" in vehicle.controls:
        found |= {
            "CY_dr": Estimate(_TAIL_FLAP * by_area, _CONTROL, 0.08),
            "Cl_dr": Estimate(0.0, 0.0, 0.03),
            "Cn_dr": Estimate(-_TAIL_FLAP * by_area * spans, _CONTROL, 0.03),
        }
    return found
