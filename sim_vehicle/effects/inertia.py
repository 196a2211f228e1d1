"""Errors of the vehicle file: mass and moments of inertia; true = (1 + scale) assumed."""

from sim_vehicle.effects.base import Effect, Parameter, Stage

MASS_ERROR = Effect(
    "mass_error",
    "error of the mass",
    Stage.INERTIA,
    (Parameter("scale", "1", -0.4, 0.4, starts=(0.0,), usual=0.03),),
    "weigh the aircraft; throttle steps",
    phrase="the true mass differs by {scale:%} from the vehicle file's",
)
INERTIA_ERROR = Effect(
    "inertia_error",
    "error of the moments of inertia",
    Stage.INERTIA,
    (Parameter("scale", "1", -0.5, 0.5, starts=(0.0,), usual=0.1),),
    "bifilar swing test",
    alias="all moment coefficients together",
    phrase="the true moments of inertia differ by {scale:%} from the vehicle file's",
)
