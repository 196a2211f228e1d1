"""Actuators between the command and the surface: delay, lag, rate limit, backlash, gain."""

import math

from sim_vehicle.effects.base import Effect, Parameter, Remembers, Stage
from sim_vehicle.jit import jit

ACTUATOR_LAG = Effect(
    "actuator_lag",
    "lag of the servos",
    Stage.ACTUATOR,
    (Parameter("tau", "s", 0.001, 0.3, starts=(0.03,)),),
    "two amplitudes with content from 3 to 6 Hz",
    memory=Remembers.INPUT,
    phrase="the servos lag by {tau:ms}",
)
ACTUATOR_RATE_LIMIT = Effect(
    "actuator_rate_limit",
    "rate limit of the servos",
    Stage.ACTUATOR,
    (Parameter("rate", "rad/s", 0.05, 20.0, starts=(0.3, 1.2)),),
    "small and large steps",
    memory=Remembers.INPUT,
    phrase="the servos turn the surfaces at no more than {rate:deg/s}",
)
ACTUATOR_DELAY = Effect(
    "actuator_delay",
    "delay of the commands",
    Stage.ACTUATOR,
    (Parameter("delay", "s", 0.0, 0.2, starts=(0.02,)),),
    "bench test of the servo delay",
    memory=Remembers.INPUT,
    phrase="the commands are delayed by {delay:ms}",
)
ACTUATOR_BACKLASH = Effect(
    "actuator_backlash",
    "free play of the linkage",
    Stage.ACTUATOR,
    (Parameter("width", "rad", 0.0, 0.1, starts=(0.01,)),),
    "amplitude sweep at one frequency",
    memory=Remembers.PLAY,
    phrase="the linkage has {width:deg} of free play",
)
ELEVATOR_GAIN = Effect(
    "elevator_gain",
    "gain of the elevator linkage",
    Stage.ACTUATOR,
    (Parameter("scale", "1", -0.5, 0.5, starts=(0.0,)),),
    "bench protractor",
    alias="the elevator's own derivatives",
    phrase="the elevator moves by {scale:%} more than the linkage's gain says",
)


@jit
def lagged_position(position: float, command: float, step: float, tau: float) -> float:
    """Position after `step` [s] of a first-order lag under a held command (exact)."""
    return command + (position - command) * math.exp(-step / tau)


@jit
def lagged_mean(position: float, command: float, step: float, tau: float) -> float:
    """Mean position over that step (exact)."""
    share = -math.expm1(-step / tau) * tau / step
    return command + (position - command) * share


@jit
def rate_limited(position: float, target: float, step: float, rate: float) -> float:
    """Position after `step` when it may move by at most rate * step."""
    travel = rate * step
    return min(max(target, position - travel), position + travel)


@jit
def rate_limited_mean(position: float, target: float, step: float, rate: float) -> float:
    """Mean position over `step` of a move to `target` at `rate` (exact)."""
    move = abs(target - position)
    time = move / rate
    if time >= step:
        return 0.5 * (position + rate_limited(position, target, step, rate))
    return target - 0.5 * (target - position) * time / step


@jit
def after_backlash(output: float, drive: float, width: float) -> float:
    """Output of free play of full width `width` after the drive has moved to `drive`."""
    return min(max(output, drive - 0.5 * width), drive + 0.5 * width)
