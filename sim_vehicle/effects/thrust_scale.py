"""Thrust scale: true thrust = (1 + scale) of the assumed (measured, or computed from throttle)."""

from sim_vehicle.effects.base import Effect, Parameter, Stage
from sim_vehicle.jit import jit

THRUST_SCALE = Effect(
    "thrust_scale",
    "error of the thrust scale",
    Stage.PROPULSION,
    (Parameter("scale", "1", -0.5, 0.5, starts=(0.0,), usual=0.07),),
    "power-off glide and throttle steps; weigh the aircraft",
    phrase="true thrust differs by {scale:%} from what is assumed",
)


@jit
def scaled_thrust(assumed: float, scale: float) -> float:
    """True thrust [N]."""
    return (1.0 + scale) * assumed
