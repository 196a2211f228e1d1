"""Motor and speed controller as a first-order lag from throttle to thrust."""

from sim_vehicle.effects.base import Effect, Need, Parameter, Remembers, Stage

MOTOR_LAG = Effect(
    "motor_lag",
    "lag of the motor",
    Stage.PROPULSION,
    (Parameter("tau", "s", 0.01, 1.0, starts=(0.15,)),),
    "throttle steps",
    memory=Remembers.INPUT,
    needs=(Need.THRUST_BY_THROTTLE, Need.NO_ROTOR_SPEED),
    phrase="the motor lags the throttle by {tau:ms}",
)
