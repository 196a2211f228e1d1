"""The air around the aircraft: steady wind, turbulence, density."""

from sim_vehicle.effects.base import Effect, Need, Parameter, Stage

STEADY_WIND = Effect(
    "steady_wind",
    "steady wind",
    Stage.ENVIRONMENT,
    tuple(Parameter(name, "m/s", -20.0, 20.0, starts=(0.0,), default=0.0) for name in ("north", "east", "down")),
    "an orbit with GPS",
    phrase="a steady wind blows ({north:m/s} to the north, {east:m/s} to the east, {down:m/s} down)",
)
TURBULENCE = Effect(
    "turbulence",
    "turbulence (Dryden)",
    Stage.ENVIRONMENT,
    (
        Parameter("sigma", "m/s", 0.0, 10.0, starts=(0.3,)),
        Parameter("length", "m", 1.0, 1000.0, default=20.0, fitted=False),
    ),
    "the same run with reversed heading",
    phrase="the air is turbulent ({sigma:m/s})",
)
DENSITY_ERROR = Effect(
    "density_error",
    "error of the air density",
    Stage.ENVIRONMENT,
    (Parameter("scale", "1", -0.3, 0.3, starts=(0.0,), usual=0.05),),
    "barometer and thermometer",
    alias="all coefficients together",
    needs=(Need.CALIBRATED_AIRSPEED,),
    phrase="the air's density differs by {scale:%} from what is assumed",
)
