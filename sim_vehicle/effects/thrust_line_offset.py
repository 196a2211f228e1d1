"""Thrust line below (z_T > 0) the centre of gravity: nose-up moment z_T T."""

from sim_vehicle.effects.base import Effect, Parameter, Stage
from sim_vehicle.jit import jit

THRUST_LINE_OFFSET = Effect(
    "thrust_line_offset",
    "thrust line off the centre of gravity",
    Stage.PROPULSION,
    (Parameter("z_T", "m", -0.3, 0.3, starts=(0.0,)),),
    "throttle steps or multisine at fixed elevator",
    phrase="the thrust line passes {z_T:mm} below the centre of gravity (above where negative)",
)


@jit
def thrust_line_moment(thrust: float, z_T: float) -> float:
    """Pitching moment [N m]."""
    return z_T * thrust
