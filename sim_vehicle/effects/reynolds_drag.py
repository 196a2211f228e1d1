"""Drag that falls with Reynolds number: CD_0 (V / V_0)^-n."""

from sim_vehicle.effects.base import Effect, Parameter, Stage
from sim_vehicle.jit import jit

REYNOLDS_DRAG = Effect(
    "reynolds_drag",
    "drag that depends on Reynolds number",
    Stage.AERODYNAMICS,
    (Parameter("n", "1", -2.0, 3.0, starts=(0.0,)),),
    "level flight over the whole range of speed",
    phrase="drag depends on Reynolds number (n = {n})",
)


@jit
def reynolds_factor(airspeed: float, reference: float, n: float) -> float:
    """Factor on CD_0 at `airspeed` [m/s]."""
    return float((airspeed / reference) ** (-n))
