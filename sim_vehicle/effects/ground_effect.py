"""Ground effect: more lift and less induced drag close to the ground.

    CL = (1 + lift_gain (1 - phi)) CL_free     CD_induced = (1 - drag_reduction (1 - phi)) k CL^2
    phi = (16 h / b)^2 / (1 + (16 h / b)^2)

phi is that of McCormick, "Aerodynamics, Aeronautics, and Flight Mechanics", from a horseshoe vortex and its image; h is
the height of the centre of gravity above the ground, b the span. The gains are those at zero height.
"""

from sim_vehicle.effects.base import Effect, Need, Parameter, Stage
from sim_vehicle.jit import jit

GROUND_EFFECT = Effect(
    "ground_effect",
    "ground effect",
    Stage.AERODYNAMICS,
    (
        Parameter("lift_gain", "1", -0.5, 1.0, starts=(0.0,), default=0.0),
        Parameter("drag_reduction", "1", -1.0, 1.0, starts=(0.0,), default=0.0),
    ),
    "runway passes at 0.2 and at 2 spans of height",
    needs=(Need.NEAR_GROUND,),
    phrase="the ground changes lift by {lift_gain:%} and takes {drag_reduction:%} of the induced drag at no height",
)


@jit
def nearness(height: float, span: float) -> float:
    """1 - phi: 1 at the ground, 0 far above it; `height` and `span` in m."""
    ratio = 16.0 * max(height, 0.0) / span
    return 1.0 / (1.0 + ratio * ratio)
