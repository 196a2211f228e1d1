"""A flap, a gear or the door of a bay that moves once: CL, CD and Cm change by dCL, dCD, dCm at one moment.

CL = CL_terms + dCL s(t), and likewise CD, Cm; s is the ramp of `sim_vehicle.effects.ramp`. The part of lift fades
with the stall as the rest of it does.
"""

from sim_vehicle.effects.base import Effect, Parameter, Stage
from sim_vehicle.effects.ramp import DURATION, TIME

CONFIGURATION_STEP = Effect(
    "configuration_step",
    "change of configuration in flight",
    Stage.AERODYNAMICS,
    (
        Parameter("dCL", "1", -1.0, 1.0, starts=(0.0,), default=0.0),
        Parameter("dCD", "1", -0.2, 0.2, starts=(0.0,), default=0.0),
        Parameter("dCm", "1", -0.5, 0.5, starts=(0.0,), default=0.0),
        TIME,
        DURATION,
    ),
    "the same change of configuration three times",
    phrase="the configuration changes {time:s} into the flight",
)
