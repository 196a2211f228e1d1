"""Hysteresis of the thrust sensor: play of full width `width` [N] between its load and the reading.

    reading = min(max(reading before, load - width / 2), load + width / 2)

the operator of free play (Krasnosel'skii & Pokrovskii, "Systems with Hysteresis", 1989). Going back is not unique:
while a reading stands still the load may be anywhere within the width. Chosen is

    load = reading + s width / 2

with s = 1 where the reading rises and -1 where it falls, which is exact, and a straight line from one to the other
while it stands between the two. s follows from the reading alone (`sysid.signals.thrust.denoising`), so the load is
linear in the width.
"""

from sim_vehicle.effects.base import Effect, Need, Parameter, Remembers, Stage
from sim_vehicle.jit import jit

THRUST_SENSOR_HYSTERESIS = Effect(
    "thrust_sensor_hysteresis",
    "hysteresis of the thrust sensor",
    Stage.SENSOR,
    (Parameter("width", "N", 0.0, 5.0, starts=(0.1,)),),
    "a ground run over the whole throttle, up and down",
    memory=Remembers.PLAY,
    needs=(Need.MEASURED_THRUST,),
    phrase="the thrust sensor has a hysteresis of {width:N}",
)


@jit
def load_behind(reading: float, way: float, width: float) -> float:
    """Load [N] behind a reading that moves the way s = `way`."""
    return reading + 0.5 * way * width
