"""Elastic tail boom: elevator power falls with dynamic pressure, Cm_de (1 - k (qbar / qbar_0 - 1))."""

from sim_vehicle.effects.base import Effect, Parameter, Stage
from sim_vehicle.jit import jit

ELASTIC_TAIL = Effect(
    "elastic_tail",
    "elastic tail boom",
    Stage.AERODYNAMICS,
    (Parameter("k", "1", -1.0, 1.0, starts=(0.0,)),),
    "elevator multisine at two speeds and the same throttle",
    phrase="the tail boom bends and the elevator's power changes by {k:%} of itself with a doubled dynamic pressure",
)


@jit
def elastic_gain(qbar: float, qbar_reference: float, k: float) -> float:
    """Factor on the elevator's pitching moment; dynamic pressures [Pa], the reference at trim speed and sea level."""
    return 1.0 - k * (qbar / qbar_reference - 1.0)
