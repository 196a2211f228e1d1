"""Something that happens at one moment of the flight and takes a little while: a straight ramp from 0 to 1.

Times are seconds from the flight's first stamp on the vehicle's clock.
"""

from sim_vehicle.effects.base import Parameter
from sim_vehicle.jit import jit

TIME = Parameter("time", "s", 0.0, 36000.0, starts=(0.0,), moment=True)
# A flap, a bay's door or a catch moves in about a tenth of a second.
DURATION = Parameter("duration", "s", 0.01, 60.0, default=0.1, fitted=False)


@jit
def switched(time: float, begin: float, duration: float) -> float:
    """How much of it has happened, 0 to 1, at `time` [s] when it begins at `begin`."""
    share: float = min(max((time - begin) / duration, 0.0), 1.0)
    return share
