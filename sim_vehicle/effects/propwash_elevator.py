"""Propwash on the tail: elevator power grows with thrust, Cm_de (1 + k T / (qbar S))."""

from sim_vehicle.effects.base import Effect, Parameter, Stage
from sim_vehicle.jit import jit

PROPWASH_ELEVATOR = Effect(
    "propwash_elevator",
    "propeller wash over the elevator",
    Stage.AERODYNAMICS,
    (Parameter("k", "1", -1.0, 5.0, starts=(0.0,)),),
    "elevator multisine at idle and at full power",
    phrase="the propeller's wash strengthens the elevator (k = {k})",
)


@jit
def propwash_gain(thrust: float, qbar_S: float, k: float) -> float:
    """Factor on the elevator's pitching moment; thrust [N], qbar S [N]."""
    return 1.0 + k * thrust / qbar_S
