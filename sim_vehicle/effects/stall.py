"""Stall: lift fades from the attached line to that of a flat plate.

Sigmoid blend of Beard & McLain, Small Unmanned Aircraft (2012), eq. (4.9) and (4.10); the separated flow's drag is
that of the same flat plate, 2 |sin alpha|^3, faded in by the same sigmoid.
"""

import math

from sim_vehicle.effects.base import Effect, Parameter, Stage
from sim_vehicle.jit import jit

STALL = Effect(
    "stall",
    "stall of the wing",
    Stage.AERODYNAMICS,
    (
        Parameter("alpha_stall", "rad", 0.08, 0.6, starts=(0.12, 0.17, 0.24)),
        Parameter("sharpness", "1/rad", 10.0, 200.0, default=50.0, fitted=False),
    ),
    "slow deceleration into the stall",
    phrase="above {alpha_stall:deg} the wing stalls",
)


@jit
def separated_share(alpha: float, alpha_stall: float, sharpness: float) -> float:
    """Share of separated flow, 0 (attached) to 1 (flat plate), eq. (4.10)."""
    above = math.exp(-sharpness * (alpha - alpha_stall))
    below = math.exp(sharpness * (alpha + alpha_stall))
    return (1.0 + above + below) / ((1.0 + above) * (1.0 + below))


@jit
def flat_plate_lift(alpha: float) -> float:
    """Lift coefficient of a flat plate at angle of attack `alpha` [rad]."""
    return math.copysign(2.0, alpha) * math.sin(alpha) ** 2 * math.cos(alpha)


@jit
def flat_plate_drag(alpha: float) -> float:
    """Drag coefficient of a flat plate at angle of attack `alpha` [rad]."""
    return 2.0 * abs(math.sin(alpha)) ** 3
