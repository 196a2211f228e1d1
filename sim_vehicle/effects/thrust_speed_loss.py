"""Thrust that falls with airspeed: throttle times dT/dV (V - V_0), V_0 the vehicle's trim speed."""

from sim_vehicle.effects.base import Effect, Need, Parameter, Stage
from sim_vehicle.jit import jit

THRUST_SPEED_LOSS = Effect(
    "thrust_speed_loss",
    "thrust that falls with airspeed",
    Stage.PROPULSION,
    (Parameter("dT_dV", "N s/m", -2.0, 1.0, starts=(0.0,)),),
    "dive and climb at fixed throttle",
    needs=(Need.THRUST_BY_THROTTLE,),
    phrase="thrust changes with airspeed by {dT_dV} N per m/s at full throttle",
)


@jit
def speed_thrust(throttle: float, airspeed: float, reference: float, dT_dV: float) -> float:
    """Change of thrust [N] away from the trim speed."""
    return throttle * dT_dV * (airspeed - reference)
