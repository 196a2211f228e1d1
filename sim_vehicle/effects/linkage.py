"""Between the servo and the surface: a servo that ignores small changes, and a linkage that is not straight."""

from sim_vehicle.effects.base import Effect, Parameter, Remembers, Stage
from sim_vehicle.jit import jit

SERVO_DEADBAND = Effect(
    "servo_deadband",
    "dead band of the servos",
    Stage.ACTUATOR,
    (Parameter("width", "rad", 0.0, 0.1, starts=(0.003, 0.007, 0.015), step=1e-3),),
    "an amplitude sweep at one frequency, down to single steps of the servo",
    memory=Remembers.PLAY,
    phrase="the servos ignore changes within a dead band of {width:deg}",
)
LINKAGE_NONLINEARITY = Effect(
    "linkage_nonlinearity",
    "linkage that is not straight",
    Stage.ACTUATOR,
    (Parameter("cubic", "1/rad2", -10.0, 10.0, starts=(0.0,)),),
    "bench protractor over the whole travel",
    phrase="the linkage is not straight (cubic term {cubic} per rad2)",
)


@jit
def after_deadband(accepted: float, command: float, width: float) -> float:
    """The command a servo obeys: the new one if it is more than half of `width` off the one `accepted` before.

    This is the dead band of a servo's data sheet, the least change of pulse that it answers; all in rad at the surface.
    """
    return command if abs(command - accepted) > 0.5 * width else accepted


@jit
def cubic_linkage(position: float, cubic: float) -> float:
    """Deflection [rad] that a servo's position [rad, by the straight calibration] gives."""
    return position + cubic * position * position * position
