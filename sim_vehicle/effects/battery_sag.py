"""Thrust at a given throttle that falls as the battery empties: T = T_throttle exp(-rate t).

The propeller's speed goes with the battery's voltage, thrust with its square, so the voltage falls by rate / 2 in a
second. t: s from the flight's first stamp. Thrust that is measured holds the loss already.
"""

import math

from sim_vehicle.effects.base import Effect, Need, Parameter, Stage
from sim_vehicle.jit import jit

BATTERY_SAG = Effect(
    "battery_sag",
    "thrust that falls as the battery empties",
    Stage.PROPULSION,
    (Parameter("rate", "1/s", -0.02, 0.02, starts=(0.0,)),),
    "the same throttle step early and late in the flight",
    needs=(Need.THRUST_BY_THROTTLE, Need.NO_ROTOR_SPEED),
    phrase="thrust falls by {rate:%} of itself a second as the battery empties",
)


@jit
def sagged_share(time: float, rate: float) -> float:
    """What is left of the thrust, 1 at the flight's first stamp."""
    return math.exp(-rate * time)
