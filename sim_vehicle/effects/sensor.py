"""Sensor effects: lags, scale and position errors that a baseline model takes for granted."""

import math

from sim_vehicle.effects.base import Effect, Parameter, Remembers, Stage
from sim_vehicle.jit import jit

VANE_LAG = Effect(
    "vane_lag",
    "lag of the flow vanes",
    Stage.SENSOR,
    (Parameter("tau", "s", 0.001, 0.3, starts=(0.03,)),),
    "the same manoeuvre at two speeds",
    memory=Remembers.LAG,
    outputs=("alpha", "beta"),
    phrase="the flow vanes lag by {tau:ms}",
)
VANE_UPWASH = Effect(
    "vane_upwash",
    "upwash at the alpha vane",
    Stage.SENSOR,
    (
        Parameter("scale", "1", -0.5, 0.5, starts=(0.0,), default=0.0),
        Parameter("bias", "rad", -0.2, 0.2, starts=(0.0,), default=0.0),
    ),
    "GPS and inertial reconstruction in calm air",
    alias="the scale factor and bias of the alpha vane",
    phrase="upwash at the alpha vane (scale {scale:%}, bias {bias:deg})",
)
VANE_RATE_ERROR = Effect(
    "vane_rate_error",
    "wrong position of the vanes",
    Stage.SENSOR,
    (
        Parameter("x", "m", -2.0, 2.0, starts=(0.0,), default=0.0),
        Parameter("y", "m", -2.0, 2.0, starts=(0.0,), default=0.0),
    ),
    "roll oscillation and two speeds",
    phrase="the flow vanes are off the assumed place by {x:mm} forward and {y:mm} to the right",
)
AIRSPEED_ERROR = Effect(
    "airspeed_error",
    "error of the airspeed reading",
    Stage.SENSOR,
    (
        Parameter("scale", "1", -0.4, 0.4, starts=(0.0,), default=0.0, usual=0.05),
        Parameter("bias", "m/s", -5.0, 5.0, starts=(0.0,), default=0.0, usual=1.0),
    ),
    "a GPS triangle or orbit",
    phrase="the airspeed reading errs by {scale:%} and {bias:m/s}",
)
PITOT_LAG = Effect(
    "pitot_lag",
    "lag of the pitot tubing",
    Stage.SENSOR,
    (Parameter("tau", "s", 0.005, 1.0, starts=(0.1,)),),
    "a fast zoom",
    memory=Remembers.LAG,
    outputs=("airspeed",),
    phrase="the pitot tubing lags by {tau:ms}",
)
ACCELEROMETER_MISALIGNMENT = Effect(
    "accelerometer_misalignment",
    "misaligned accelerometers",
    Stage.SENSOR,
    (
        Parameter("pitch", "rad", -0.2, 0.2, starts=(0.0,), default=0.0),
        Parameter("roll", "rad", -0.2, 0.2, starts=(0.0,), default=0.0),
    ),
    "a bench cube, rolls",
    phrase="the accelerometers are turned by {pitch:deg} in pitch and {roll:deg} in roll",
)
ACCELEROMETER_OFFSET = Effect(
    "accelerometer_offset",
    "accelerometers off the assumed place",
    Stage.SENSOR,
    (
        Parameter("x", "m", -0.5, 0.5, starts=(0.0,), default=0.0),
        Parameter("y", "m", -0.5, 0.5, starts=(0.0,), default=0.0),
        Parameter("z", "m", -0.5, 0.5, starts=(0.0,), default=0.0),
    ),
    "elevator excitation from 2 to 6 Hz",
    phrase="the accelerometers are off the assumed place by {x:mm} forward, {y:mm} to the right and {z:mm} down",
)
IMU_SCALE = Effect(
    "imu_scale",
    "scale error of the rate gyros",
    Stage.SENSOR,
    (
        Parameter("scale", "1", -0.2, 0.2, starts=(0.0,), default=0.0),
        Parameter("bias", "rad/s", -0.1, 0.1, starts=(0.0,), default=0.0),
    ),
    "a rate table",
    phrase="the rate gyros err by {scale:%} and {bias:deg/s}",
)
ATTITUDE_LAG = Effect(
    "attitude_lag",
    "lag of the attitude estimate",
    Stage.SENSOR,
    (Parameter("tau", "s", 0.002, 0.5, starts=(0.04,)),),
    "level accelerations",
    memory=Remembers.LAG,
    outputs=("phi", "theta"),
    phrase="the attitude estimate lags by {tau:ms}",
)


@jit
def ramp_lag(old_input: float, new_input: float, old_output: float, interval: float, tau: float) -> float:
    """First-order lag after `interval` [s] for an input that moved on a straight line (exact)."""
    lead = (new_input - old_input) / interval * tau
    return new_input - lead + (old_output - old_input + lead) * math.exp(-interval / tau)
