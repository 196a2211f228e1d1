"""How far the commands follow what a model leaves: an autopilot, or a pilot, who answers gusts with the surfaces.

Direct estimates from a closed loop mix the aircraft with the inverse of what flies it, by the share of the commands
that answers noise (Soderstrom, Gustavsson & Ljung, Int. J. Control 21, 1975). Where noise may have any spectrum, only
the part of the commands that answers none of it informs (Forssell & Ljung, Automatica 35, 1999): bars come from that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.arrays import Array
from sysid.numerics.feedback_law import LAW_OF, is_feedback_law, law_share
from sysid.posterior.flight_part import FlightPart
from sysid.posterior.inputs import InputSignal
from sysid.posterior.observations import CommonGrid

# A shorter part cannot distinguish an answer from chance, s.
SHORTEST_LOOP_S = 15.0
# Share of a command's variance, beyond chance, below which it follows nothing.
LEAST_SHARE = 0.05
# What answers gusts never rests: half a second within such a share of its travel, in so much of a part, is no loop's.
_REST_S, _REST_SHARE, _RESTING = 0.5, 0.02, 0.04
# By so much more than it is of the motion a residual may be of a command: a loop that follows set points well has
# commands that are small beside what it would do to the whole motion.
_MOST_GAIN = 5.0
# So many other times show what chance explains, and so many of their standard deviations beyond is no chance.
_SURROGATES, _BEYOND_CHANCE = 12, 3.0
# Share of the time in which a law moves the rudder, from which on it is in a loop.
_OFTEN = 0.5
# The causal filter: steps and memory, s, and its ridge.
_STEP_S, _MEMORY_S, _RIDGE = 0.06, 0.9, 0.02
# The same of slopes: a loop about a small aircraft has settled by 2 s; samples for each of its weights, at least.
_SLOPES_MEMORY_S, _SLOPES_RIDGE, _SAMPLES = 2.0, 1e-3, 2


def most_answered(residual: Array, measured: Array, common: CommonGrid) -> float:
    """Largest share of a command that can answer residuals (m, K) of rates, which every loop feels, by those measured.

    Where residuals are next to nothing of the motion, it is they that follow the command (what the structure lacks),
    and not the other way round.
    """
    inner, felt = residual[:, common.taper > 0.5], measured[:, common.taper > 0.5]
    ratio = inner.var(axis=1) / np.maximum(felt.var(axis=1), 1e-30)
    return min(_MOST_GAIN**2 * float(np.max(ratio, initial=0.0)), 1.0)


def feedback_share(command: InputSignal, residual: Array, common: CommonGrid, most: float = 1.0) -> float:
    """Share of a command's variance that a causal filter of the residuals (m, K) explains, 0 to 1.

    Adjusted for chance, by which many lags explain a part of anything, the more the smoother it is: as much as the same
    residuals explain at other times. most: what it can be at most.
    """
    if most < LEAST_SHARE:
        return 0.0
    means, every = _normal_means(residual, common)
    lags = max(2, round(_MEMORY_S / (every * common.interval_s)))
    means = means[:, ::every]
    count = means.shape[1]
    u = command.at(common.points[::every])
    off = u - u.mean()
    power = float(off @ off)
    if count < 2 * residual.shape[0] * lags or power == 0.0:
        return 0.0

    def explained(shift: int) -> float:
        A = np.zeros((count, residual.shape[0] * lags))
        shifted = np.roll(means, shift, axis=1)
        for lag in range(lags):
            A[lag:, lag::lags] = shifted[:, : count - lag].T
        weights = np.linalg.solve(A.T @ A + _RIDGE * count * np.eye(A.shape[1]), A.T @ off)
        left = off - A @ weights
        return 1.0 - float(left @ left) / power

    # The same residuals at other times have the same spectra, and answer nothing.
    shifts = np.linspace(0.2, 0.8, _SURROGATES) * count
    chance = np.array([explained(round(float(shift))) for shift in shifts])
    middle, share = float(chance.mean()), explained(0)
    if share < middle + _BEYOND_CHANCE * float(chance.std()):
        return 0.0
    adjusted = min((share - middle) / (1.0 - middle), most)
    return adjusted if adjusted > LEAST_SHARE else 0.0


def rests(command: InputSignal, grid: Array) -> bool:
    """Whether a command lies still for a while, as between test inputs: in gusts no loop does."""
    u = command.at(grid)
    width = max(2, round(_REST_S / float(grid[1] - grid[0])))
    if u.size <= width:
        return False
    spans = np.ptp(np.lib.stride_tricks.sliding_window_view(u, width), axis=1)
    return bool(np.mean(spans < _REST_SHARE * np.ptp(u)) > _RESTING)


def external(slopes: Array, residual: Array, common: CommonGrid) -> Array:
    """(m, K, P) slopes of simulated outputs less what a causal filter of the residuals (m, K) explains of them: what
    set points and test inputs did, and nothing that a loop made of noise.
    """
    means, every = _normal_means(residual, common)
    m, K = means.shape
    lags = min(round(_SLOPES_MEMORY_S / (every * common.interval_s)), K // (every * m * _SAMPLES))
    if lags < 1:
        return slopes
    past = np.zeros((K, m * lags))
    for lag in range(lags):
        past[lag * every :, lag * m : (lag + 1) * m] = means[:, : K - lag * every].T
    A, series = past[::every], slopes.transpose(1, 0, 2).reshape(K, -1)
    off = series[::every] - series[::every].mean(axis=0)
    gram = A.T @ A
    held = gram + _SLOPES_RIDGE * A.shape[0] * np.eye(A.shape[1])
    answered = (past @ np.linalg.solve(held, A.T @ off)).reshape(K, m, -1).transpose(1, 0, 2)
    # So much of anything, on average, as there are weights for the samples is explained by chance.
    chance = float(np.trace(np.linalg.solve(held, gram))) / A.shape[0]
    return np.asarray((slopes - answered) / np.sqrt(1.0 - chance))


def _normal_means(residual: Array, common: CommonGrid) -> tuple[Array, int]:
    """(m, K) residuals of unit size, each the mean over the samples of a step up to it: causal, and no frequency folds
    down. Second: samples of a step.
    """
    every = max(1, round(_STEP_S / common.interval_s))
    inner = residual[:, common.taper > 0.5]
    scale = np.maximum(inner.std(axis=1, keepdims=True), 1e-12)
    normal = (residual - inner.mean(axis=1, keepdims=True)) / scale * common.taper
    kernel = np.ones(every) / every
    return np.stack([np.convolve(row, kernel)[: row.size] for row in normal]), every


def follow_laws(parts: Sequence[FlightPart], surfaces: Sequence[str]) -> tuple[str, ...]:
    """Which of some surfaces nothing moves but a law of the motion, in every part in which they move."""
    found = []
    for name in surfaces:
        held = [
            is_feedback_law(part.inputs[name].at, part.grid, [part.motion[one] for one in LAW_OF[name]])
            for part in parts
            if name in part.inputs and np.ptp(part.inputs[name].at(part.grid)) > 0.0
        ]
        if held and all(held):
            found.append(name)
    return tuple(found)


def damped_by_law(parts: Sequence[FlightPart]) -> list[int]:
    """Parts in which, of the time that the rudder moves, a law of the motion alone moves it for half or more.

    Ailerons are left out: an aircraft that rolls at once by them has a rate in proportion to them.
    """
    return [i for i, part in enumerate(parts) if not part.position and _damper_share(part) >= _OFTEN]


def _damper_share(part: FlightPart) -> float:
    """Share of the time that the rudder moves in which the gyro's readings, as a damper has them, move it."""
    if "dr" not in part.inputs or "r" not in part.channels:
        return 0.0
    gyro = part.channels["r"]
    felt = [np.interp(gyro.time_s, part.grid, part.motion[name]) for name in LAW_OF["dr"] if name != "r"]
    return law_share(part.inputs["dr"].at, gyro.time_s, [gyro.values, *felt])
