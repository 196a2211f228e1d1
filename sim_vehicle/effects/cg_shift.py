"""Centre of gravity ahead of (x > 0) where the vehicle file has it: all forces but gravity then have an arm.

    M += x m az     N -= x m ay     so that Cm_alpha changes by -CL_alpha x / c

ay, az are specific forces [m/s2] at the centre of gravity. Sensors that are then off their assumed places are
another effect, accelerometer_offset.
"""

from sim_vehicle.effects.base import Effect, Parameter, Stage
from sim_vehicle.jit import jit

CG_SHIFT = Effect(
    "cg_shift",
    "centre of gravity off the assumed place",
    Stage.INERTIA,
    (Parameter("x", "m", -0.2, 0.2, starts=(0.0,)),),
    "a balance jig",
    alias="the derivatives of the pitching and the yawing moment",
    by_curvature=True,
    phrase="the centre of gravity is {x:mm} ahead of where the vehicle file has it (behind where negative)",
)


@jit
def shift_moment(x: float, mass: float, specific_force: float) -> float:
    """Moment [N m] of a specific force [m/s2] across the arm `x` [m]."""
    return x * mass * specific_force
