"""Something that falls off, or out of a bay: mass m (1 - fraction s(t)), s the ramp of `sim_vehicle.effects.ramp`.

What falls hung at the centre of gravity and turned nothing: moments of inertia stay.
"""

from sim_vehicle.effects.base import Effect, Parameter, Stage
from sim_vehicle.effects.ramp import DURATION, TIME
from sim_vehicle.jit import jit

MASS_DROP = Effect(
    "mass_drop",
    "mass lost in flight",
    Stage.INERTIA,
    (Parameter("fraction", "1", 0.0, 0.9, starts=(0.02,)), TIME, DURATION),
    "weigh the aircraft before and after the flight; the same drop again",
    phrase="the aircraft loses {fraction:%} of its mass {time:s} into the flight",
)


@jit
def remaining_mass(mass: float, fraction: float, share: float) -> float:
    """Mass [kg] when `share` (0 to 1) of the fall is over."""
    return mass * (1.0 - fraction * share)
