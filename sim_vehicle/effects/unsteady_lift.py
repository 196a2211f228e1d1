"""Unsteady lift: the wing feels an angle of attack that lags, tau x' = alpha - x (Goman & Khrabrov 1994, one state)."""

from sim_vehicle.effects.base import Effect, Parameter, Remembers, Stage
from sim_vehicle.jit import jit

UNSTEADY_LIFT = Effect(
    "unsteady_lift",
    "lift that lags the angle of attack",
    Stage.AERODYNAMICS,
    (Parameter("tau", "s", 0.005, 0.3, starts=(0.03,)),),
    "elevator sweep from 2 to 6 Hz",
    memory=Remembers.LAG,
    phrase="lift lags the angle of attack by {tau:ms}",
)


@jit
def lag_rate(value: float, lagged: float, tau: float) -> float:
    """Rate of a first-order lag [unit/s]."""
    return (value - lagged) / tau
