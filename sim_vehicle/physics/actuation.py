"""From the command to the surface: delay, dead band, lag, rate limit, free play, linkage, gain (compiled).

The command is held between ticks, or goes in a straight line about its mean where it has a rise. Every element is
advanced exactly over a sub-step under the command's mean there, and hands on both its mean over the sub-step (what the
motion feels) and its value at the end (what a sensor then sees).
"""

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.effects import slot
from sim_vehicle.effects.actuator import (
    after_backlash,
    lagged_mean,
    lagged_position,
    rate_limited,
    rate_limited_mean,
)
from sim_vehicle.effects.linkage import after_deadband, cubic_linkage
from sim_vehicle.jit import jit
from sim_vehicle.physics.layout import ACCEPTED_PLACE, MORE_COLUMN, THROTTLE_PLACE, WORK_SIZE, Par

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_DELAY, _DELAY_S = slot("actuator_delay"), slot("actuator_delay", "delay")
_LAG, _LAG_TAU = slot("actuator_lag"), slot("actuator_lag", "tau")
_RATE, _RATE_MAX = slot("actuator_rate_limit"), slot("actuator_rate_limit", "rate")
_PLAY, _PLAY_WIDTH = slot("actuator_backlash"), slot("actuator_backlash", "width")
_GAIN, _GAIN_SCALE = slot("elevator_gain"), slot("elevator_gain", "scale")
_CUBIC, _CUBIC_K = slot("linkage_nonlinearity"), slot("linkage_nonlinearity", "cubic")
_BAND, _BAND_WIDTH = slot("servo_deadband"), slot("servo_deadband", "width")
_MOTOR, _MOTOR_TAU = slot("motor_lag"), slot("motor_lag", "tau")
_MOTOR_TAU_PAR = int(Par.motor_tau)
# First column of the commands in which the rises of the surfaces may stand.
RISE_COLUMN = 6


@jit
def in_lines(commands: Array) -> bool:
    """Whether de, da and dr go in straight lines over each interval: their rises are given, and are numbers.

    Parameters
    ----------
    commands : Array, shape (N, 4), (N, 6), (N, 9) or (N, 9 + named)
        As of `DrivingInputs`.

    Returns
    -------
    bool
        False where they are held.
    """
    return commands.shape[1] > RISE_COLUMN and not np.isnan(commands[0, RISE_COLUMN])


@jit
def count_named(F: IntArray) -> int:
    """Controls of other names than de, da, dr and throttle of which a model has terms: so many at the end of the work
    array, and of each array of surfaces.

    Parameters
    ----------
    F : IntArray, shape (n, 4)
        Factor indices of the aerodynamic terms.

    Returns
    -------
    int
        Their number, 0 for most vehicles.
    """
    last = WORK_SIZE - 1
    for i in range(F.shape[0]):
        for j in range(F.shape[1]):
            last = max(last, F[i, j])
    return last + 1 - WORK_SIZE


@jit
def mix_seen(end: Array, share: float, now: Array) -> None:
    """What sensors at a tick see: a share of the way from the surfaces before it to those that its command makes.

    Parameters
    ----------
    end : Array, shape (4 + named,)
        Surfaces at the end of the tick before, rad, throttle (0 to 1), and controls of other names.
    share : float
        0 to 1, dimensionless.
    now : Array, shape (4 + named,)
        Those that the command of the tick makes at once; changed in place, same units.
    """
    for i in range(now.size):
        now[i] = end[i] + share * (now[i] - end[i])


@jit
def act_late(E: Array) -> bool:
    """Whether something delays, lags, limits or remembers between the commands and the surfaces.

    Parameters
    ----------
    E : Array, shape (slots,)
        Effect vector (`sim_vehicle.effects`), SI units.

    Returns
    -------
    bool
        False where a command acts at once and as it is, or in proportion.
    """
    lags, delays = E[_LAG] != 0.0 and E[_LAG_TAU] > 0.0, E[_DELAY] != 0.0 and E[_DELAY_S] > 0.0
    remembers = (E[_PLAY] != 0.0 and E[_PLAY_WIDTH] > 0.0) or (E[_BAND] != 0.0 and E[_BAND_WIDTH] > 0.0)
    return bool(lags or delays or E[_RATE] != 0.0 or remembers)


@jit
def take_seen(seen: Array, E: Array, now: Array) -> None:
    """Surfaces that a sensor sees at a tick where these are known by themselves, beside what the motion feels.

    Parameters
    ----------
    seen : Array, shape (4 + named,) or longer
        de, da, dr [rad], throttle (0 to 1) and controls of other names at the tick.
    E : Array, shape (slots,)
        Effect vector (`sim_vehicle.effects`), SI units.
    now : Array, shape (4 + named,)
        Result, written over, same units.
    """
    for i in range(now.size):
        now[i] = deflection(i, seen[i], E) if i < 3 else seen[i]


@jit
def take_named(command: Array, surfaces: Array) -> None:
    """Put the commands of controls of other names where they act: at once, as they are; 0 where there is none.

    Parameters
    ----------
    command : Array, shape (4,), (6,), (9,) or (9 + named,)
        A row of the commands of `DrivingInputs`, rad or the control's own unit.
    surfaces : Array, shape (4 + named,)
        Those behind de, da, dr and throttle are written over, in the same units.
    """
    for j in range(surfaces.size - 4):
        surfaces[4 + j] = command[MORE_COLUMN + j] if command.size > MORE_COLUMN + j else 0.0


@jit
def commanded(commands: Array, tick: int, channel: int, share: float) -> float:
    """Command of a surface, rad, a share of the way from a tick to the next.

    commands: (N, 4) or (N, 6) held, or (N, 9) and more, columns 6 to 8 what de, da and dr rise by over each interval,
    about means in the first three.
    """
    command: float = commands[tick, channel]
    if in_lines(commands):
        command += commands[tick, RISE_COLUMN + channel] * (share - 0.5)
    return command


@jit
def delayed_mean(commands: Array, tick: int, channel: int, begin: float, end: float, delay: float, dt: float) -> float:
    """Mean over [begin, end] after `tick` of a command that is `commanded` and delayed by `delay`; times in s."""
    low, high = begin - delay, end - delay
    total = 0.0
    index = int(np.floor(low / dt))
    while index * dt < high:
        left, right = max(low, index * dt), min(high, (index + 1) * dt)
        row = min(max(tick + index, 0), tick)
        share = 0.5 * (left + right) / dt - index
        total += commanded(commands, row, channel, share) * max(right - left, 0.0)
        index += 1
    return total / (high - low)


@jit
def start_actuators(command: Array, actuators: Array) -> None:
    """Put the actuators at rest at a command.

    Parameters
    ----------
    command : Array, shape (4,) or longer
        de, da, dr [rad] and throttle (0 to 1); what follows does not count.
    actuators : Array, shape (ACTUATOR_SIZE,)
        Result, written over: state of the actuators, rad and throttle (0 to 1).
    """
    for channel in range(3):
        actuators[2 * channel] = command[channel]
        actuators[2 * channel + 1] = command[channel]
        actuators[ACCEPTED_PLACE + channel] = command[channel]
    actuators[THROTTLE_PLACE] = command[3]


@jit
def deflection(channel: int, position: float, E: Array) -> float:
    """Surface [rad] that the position of a servo behind its free play gives."""
    if E[_CUBIC] != 0.0:
        position = cubic_linkage(position, E[_CUBIC_K])
    if channel == 0 and E[_GAIN] != 0.0:
        position *= 1.0 + E[_GAIN_SCALE]
    return position


@jit
def surfaces_at_rest(command: Array, E: Array, end: Array) -> None:
    """Surfaces of actuators that have been at rest at a command for long.

    Parameters
    ----------
    command : Array, shape (4,) or longer
        de, da, dr [rad] and throttle (0 to 1); what follows does not count.
    E : Array, shape (slots,)
        Effect vector (`sim_vehicle.effects`), SI units.
    end : Array, shape (4 + named,)
        Result, written over: de, da, dr [rad], throttle (0 to 1) and controls of other names.
    """
    for channel in range(3):
        end[channel] = deflection(channel, command[channel], E)
    end[3] = command[3]
    take_named(command, end)


@jit
def advance_actuators(
    commands: Array, tick: int, begin: float, step: float, dt: float, P: Array, E: Array,
    actuators: Array, mean: Array, end: Array,
) -> None:  # fmt: skip
    """Advance the actuators by one step, `begin` seconds after a tick.

    Parameters
    ----------
    commands : Array, shape (N, 4), (N, 6), (N, 9) or (N, 9 + named)
        de, da, dr [rad] and throttle (0 to 1), as of `DrivingInputs`.
    tick : int
        Row of `commands` that acts.
    begin : float
        Time from the tick to the step's begin, s.
    step : float
        Length of the step, s.
    dt : float
        Interval of the ticks, s.
    P, E : Array, shapes (PAR_SIZE,) and (slots,)
        Vehicle constants and effect vector (`sim_vehicle.physics.layout`, `sim_vehicle.effects`), SI units.
    actuators : Array, shape (10,)
        State of the actuators, rad and throttle (0 to 1); changed in place.
    mean, end : Array, shape (4 + named,)
        Results, written over: de, da, dr [rad], throttle (0 to 1) and controls of other names, mean over the step and
        value at its end.
    """
    delay = E[_DELAY_S] if E[_DELAY] != 0.0 else 0.0
    rises = in_lines(commands)
    for channel in range(3):
        command = commanded(commands, tick, channel, (begin + 0.5 * step) / dt)
        if delay > 0.0:
            command = delayed_mean(commands, tick, channel, begin, begin + step, delay, dt)
        if E[_BAND] != 0.0:
            command = after_deadband(actuators[ACCEPTED_PLACE + channel], command, E[_BAND_WIDTH])
            actuators[ACCEPTED_PLACE + channel] = command
        position = actuators[2 * channel]
        target, middle = command, command
        if rises and delay == 0.0 and E[_BAND] == 0.0:
            target = commanded(commands, tick, channel, (begin + step) / dt)
        lags = E[_LAG] != 0.0 and E[_LAG_TAU] > 0.0
        if lags:
            target = lagged_position(position, command, step, E[_LAG_TAU])
            middle = lagged_mean(position, command, step, E[_LAG_TAU])
        if E[_RATE] != 0.0:
            limited = rate_limited(position, target, step, E[_RATE_MAX])
            if limited != target or not lags:
                middle = rate_limited_mean(position, target, step, E[_RATE_MAX])
            target = limited
        actuators[2 * channel] = target
        if E[_PLAY] != 0.0:
            before = actuators[2 * channel + 1]
            target = after_backlash(before, target, E[_PLAY_WIDTH])
            # Exact where the linkage is in contact over the whole step, and where the drive moves at once.
            middle = after_backlash(before, middle, E[_PLAY_WIDTH])
        actuators[2 * channel + 1] = target
        mean[channel], end[channel] = deflection(channel, middle, E), deflection(channel, target, E)
    take_named(commands[tick], mean)
    take_named(commands[tick], end)
    throttle = commands[tick, 3]
    tau = E[_MOTOR_TAU] if E[_MOTOR] != 0.0 else P[_MOTOR_TAU_PAR]
    mean[3], end[3] = throttle, throttle
    if tau > 0.0:
        mean[3] = lagged_mean(actuators[THROTTLE_PLACE], throttle, step, tau)
        end[3] = lagged_position(actuators[THROTTLE_PLACE], throttle, step, tau)
    actuators[THROTTLE_PLACE] = end[3]


@jit
def surfaces_after_command(commands: Array, tick: int, dt: float, E: Array, end: Array) -> None:
    """Let a command act at once on the surfaces a sensor sees at its own tick, where nothing delays or lags it.

    Parameters
    ----------
    commands : Array, shape (N, 4), (N, 6), (N, 9) or (N, 9 + named)
        de, da, dr [rad] and throttle (0 to 1), as of `DrivingInputs`.
    tick : int
        Row of `commands` that acts.
    dt : float
        Interval of the ticks, s.
    E : Array, shape (slots,)
        Effect vector (`sim_vehicle.effects`), SI units.
    end : Array, shape (4 + named,)
        Surfaces de, da, dr [rad], throttle (0 to 1) and controls of other names; all but the throttle are changed in
        place.
    """
    take_named(commands[tick], end)
    if act_late(E):
        return
    for channel in range(3):
        end[channel] = deflection(channel, commanded(commands, tick, channel, 0.0), E)
