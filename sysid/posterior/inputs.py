"""Inputs as functions of time: what a surface was commanded between two samples, and what its servo made of it.

A logged command is one of three things. A command that is really held steps at its stamps. One that is computed anew
for each sample of the log is a smooth function seen at points, and a straight line between them would be a low-pass
(5 % at 6 Hz of 50 Hz). So it would be for a position that was measured: a monotone curve goes through those.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.linalg import expm

from sim_vehicle.jit import jit_arrays
from sim_vehicle.vehicle.controls import Control
from sysid.arrays import Array
from sysid.numerics.statistics import white_noise_std
from sysid.signals.rounding import rounding_of, unrounded

SERVO_DAMPING = 0.8  # of a servo of second order
# Shorter lags than this make no difference to anything a log can show, s.
SHORTEST_LAG_S = 5e-4
# Longest interval at which a control loop sends its commands, s (50 Hz; a fifth for jitter).
LOOP_INTERVAL_S = 0.024
# Share of its travel that a command makes in steps, each between samples at rest, from which on it is one that steps.
_STEPPING = 0.5
# A change counts as rounding up to so many of the smallest, where that is smaller than this share of its range.
_ROUNDING, _FINE = 2.5, 0.05
# Share of its range below which a change is one of the last digit of a number.
_NO_CHANGE = 1e-9
# From so long before a grid on a servo runs, s.
_SERVO_LEAD_S = 0.5
# Step at which a vane's swinging is integrated, s.
_SWING_STEP_S = 2.5e-3


@dataclass(frozen=True)
class InputSignal:
    """A command or position as a function of time. time_s, values: (N,).

    kind: "held" from stamp to stamp; "splined", a cubic spline; "eased", a monotone one that does not overshoot at
    steps (Fritsch and Butland 1984); "joined" by straight lines. resolution: standard deviation that a measured
    position has where nothing moves, in the unit of `values`; 0 of a command. rounding: (N,) what was logged less
    `values`, or (0,) where that is nothing.
    """

    time_s: Array
    values: Array
    kind: str
    resolution: float = 0.0
    rounding: Array = field(default_factory=lambda: np.zeros(0))

    def at(self, time_s: Array, width: float = 0.0, rounded: float = 0.0) -> Array:
        """Values at any times; constant beyond the ends.

        width: s, over which a command that steps is averaged about each time: the moment of a step then moves what is
        read smoothly, though the times lie on a grid. rounded: share of what rounding changed that is in them.
        """
        if rounded and self.rounding.size:
            if self.kind == "eased":  # alone not linear in its values
                return replace(self, values=self.values + rounded * self.rounding).at(time_s, width)
            return self.at(time_s, width) + rounded * self._of_rounding.at(time_s, width)
        if self.kind == "held":
            if width > 0.0:
                after, before = (self._passed(time_s + side * width) for side in (0.5, -0.5))
                return np.asarray((after - before) / width)
            place = np.searchsorted(self.time_s, time_s + 1e-9, side="right") - 1
            return np.asarray(self.values[np.clip(place, 0, self.values.size - 1)])
        found = np.interp(time_s, self.time_s, self.values)
        if self.kind in ("splined", "eased"):
            for curve in self._curves:
                inside = (time_s >= curve.x[0]) & (time_s <= curve.x[-1])
                found[inside] = curve(time_s[inside])
        return np.asarray(found)

    @cached_property
    def _curves(self) -> list[CubicSpline] | list[PchipInterpolator]:
        parts = [slice(begin, end) for begin, end in unbroken(self.time_s) if end - begin >= 4]
        if self.kind == "eased":
            return [PchipInterpolator(self.time_s[part], self.values[part]) for part in parts]
        return [CubicSpline(self.time_s[part], self.values[part]) for part in parts]

    @cached_property
    def _of_rounding(self) -> InputSignal:
        return InputSignal(self.time_s, self.rounding, self.kind)

    @cached_property
    def _integral(self) -> Array:
        return np.concatenate(([0.0], np.cumsum(self.values[:-1] * np.diff(self.time_s))))

    def _passed(self, time_s: Array) -> Array:
        """Integral of a held command from its first stamp."""
        inside = np.interp(time_s, self.time_s, self._integral)
        early = np.minimum(time_s - self.time_s[0], 0.0) * self.values[0]
        late = np.maximum(time_s - self.time_s[-1], 0.0) * self.values[-1]
        return np.asarray(inside + early + late)


def unbroken(time_s: Array) -> list[tuple[int, int]]:
    """First sample and one past the last of each part of a message without samples lost."""
    steps = np.diff(time_s)
    if not steps.size:
        return [(0, time_s.size)]
    breaks = np.flatnonzero(steps > 2.2 * float(np.median(steps))) + 1
    edges = [0, *breaks.tolist(), time_s.size]
    return list(pairwise(edges))


def surface_signal(
    time_s: Array, values: Array, control: Control | None, *, position: bool, stepping: bool, held: bool = False
) -> InputSignal:
    """The function of time that logged samples of a surface stand for, in whole steps or not.

    control: what the vehicle file says of it. position: whether it was measured. stepping, held: as in `input_signal`.
    """
    smooth = unrounded(time_s, values, control)
    # A command has no noise: whatever is in it moves its servo.
    resolution = max(rounding_of(values, control).std, white_noise_std(smooth)) if position else 0.0
    signal = InputSignal(time_s, smooth, "eased") if position else input_signal(time_s, smooth, stepping, held)
    return replace(signal, resolution=resolution, rounding=np.zeros(0) if smooth is values else values - smooth)


def input_signal(time_s: Array, values: Array, stepping: bool, held: bool = False) -> InputSignal:
    """The function of time that logged commands stand for.

    stepping: whether its loop's commands stay until they step. held: whether each is known to stay until the next,
    where the log has every one.
    """
    slow = values.size > 1 and float(np.median(np.diff(time_s))) > LOOP_INTERVAL_S
    if not stepping:
        return InputSignal(time_s, values, "held" if held and not slow else "splined")
    # A slow log sees the steps of a faster loop somewhere between its own stamps.
    return InputSignal(time_s, values, "eased" if slow else "held")


def in_steps(commands: Iterable[Array]) -> bool:
    """Whether the commands of one loop, (N,) each in one unit, stay until they step.

    One answer for all of them: held and as a curve they differ by half a sample, and servos of one make would differ
    by it. What moves most says most.
    """
    alone, moves = np.sum([(0.0, 0.0), *(_travel_in_steps(values) for values in commands)], axis=0)
    return bool(alone > _STEPPING * moves)


def _travel_in_steps(values: Array) -> tuple[float, float]:
    """Of a command's travel what it makes in steps between samples at rest, and all of it.

    A stick that moves within some samples is none, though in whole microseconds most samples repeat the one before.
    """
    change = np.abs(np.diff(values))
    change[change < _NO_CHANGE * np.ptp(values)] = 0.0
    if not change.any():
        return 0.0, 0.0
    least = float(np.min(change[change > 0.0]))
    rounding = least if least < _FINE * float(np.ptp(values)) else 0.0
    beside = np.maximum(np.append(change[1:], 0.0), np.append(0.0, change[:-1]))
    moves = change > _ROUNDING * rounding
    alone = moves & (beside <= _ROUNDING * rounding)
    return float(change[alone].sum()), float(change[moves].sum())


def servo(
    commanded: InputSignal, grid: Array, delay: float, lag: float, backlash: float, rounded: float = 0.0
) -> Array:
    """(N,) positions behind a servo on an even grid: delay, second order with `lag` = 2 damping / omega, play.

    delay, lag: s. backlash: half width, in the signal's unit. rounded: as in `InputSignal.at`.
    """
    h = float(grid[1] - grid[0])
    behind = commanded.at(grid - delay, h, rounded)
    if lag > SHORTEST_LAG_S:
        omega = 2.0 * SERVO_DAMPING / lag
        # State, input and its rise over one step: exact for an input that goes in straight lines.
        A = np.zeros((4, 4))
        A[0, 1], A[1, :3] = h, (-omega * omega * h, -2.0 * SERVO_DAMPING * omega * h, omega * omega * h)
        A[2, 3] = 1.0
        behind = _second_order(behind, np.ascontiguousarray(expm(A)[:2]))
    return _play(behind, backlash) if backlash > 0.0 else behind


class SurfaceMotion(NamedTuple):
    """What a surface did along an even grid of N points.

    Attributes
    ----------
    means : Array, shape (N,)
        Its mean from each point to the next, rad: what the motion feels.
    seen : Array, shape (N,)
        Where it had come until each point, rad: what a sensor that reads there feels. A command that steps at the
        point itself has done nothing by then.
    """

    means: Array
    seen: Array


def surface_motion(
    commanded: InputSignal, begin: float, step: float, count: int, servos: Sequence[float]
) -> SurfaceMotion:
    """What a surface did along an even grid.

    Parameters
    ----------
    commanded : InputSignal
        What its servo was sent, in rad at the surface, on its own stamps.
    begin : float
        First point of the grid, s.
    step : float
        From each point to the next, s.
    count : int
        Intervals.
    servos : Sequence[float]
        Delay in s, lag in s, and backlash in rad of its servo, and the share of the rounding that it was sent.

    Returns
    -------
    SurfaceMotion
        At `count` points, rad.
    """
    # The servo has settled where the grid begins.
    lead = round(_SERVO_LEAD_S / step)
    half: Array = begin - lead * step + 0.5 * step * (np.arange(2 * (count + lead) + 2, dtype=np.float64) - 0.5)
    values = servo(commanded, half, *servos)
    held = commanded.kind == "held"
    before, last, next_, after = values[1:-4:2], values[2:-3:2], values[3:-2:2], values[4:-1:2]
    # At a point between two halves: of what steps by what came before it alone, else on a cubic.
    seen = last + 0.5 * (last - before) if held else (9.0 * (last + next_) - before - after) / 16.0
    return SurfaceMotion(interval_means(values, held)[lead:], seen[lead - 1 : lead - 1 + count])


def interval_means(values: Array, averaged: bool) -> Array:
    """(N,) means over intervals from (2 N + 2,) values at the middles of their halves, one more at each end.

    averaged: whether each value is the mean over its half already; else they are taken as points of a cubic.
    """
    inner = values[1:-1:2] + values[2:-1:2]
    if averaged:
        return np.asarray(0.5 * inner)
    return np.asarray((23.0 * inner + values[:-2:2] + values[3::2]) / 48.0)


@jit_arrays
def _second_order(u: Array, M: Array) -> Array:
    y = np.empty(u.size)
    x, v = u[0], 0.0
    y[0] = x
    for k in range(1, u.size):
        before, rise = u[k - 1], u[k] - u[k - 1]
        x, v = (
            M[0, 0] * x + M[0, 1] * v + M[0, 2] * before + M[0, 3] * rise,
            M[1, 0] * x + M[1, 1] * v + M[1, 2] * before + M[1, 3] * rise,
        )
        y[k] = x
    return y


@jit_arrays
def _play(u: Array, half: float) -> Array:
    y = np.empty(u.size)
    at = u[0]
    for k in range(u.size):
        at = min(max(at, u[k] - half), u[k] + half)
        y[k] = at
    return y


@jit_arrays
def swing(read: Array, period: Array, dt: float, damping: float) -> None:
    """Pass (N, K) in place through a vane of second order, at rest at the start, by the trapezoidal rule.

    period: (N,) of its undamped swing, s; it falls with airspeed (Wieringa 1967). With 0 the vane follows at once.
    """
    parts = max(1, round(dt / _SWING_STEP_S))
    columns = read.shape[1]
    # The angle, its rate times the period over 2 pi, and what is read.
    x, v, before = read[0].copy(), np.zeros(columns), read[0].copy()
    for k in range(1, read.shape[0]):
        slow = period[k] / np.pi * parts / dt
        back = slow * slow + 2.0 * damping * slow
        for i in range(parts):
            share = (2.0 * i + 1.0) / parts
            for j in range(columns):
                both = 2.0 * before[j] + (read[k, j] - before[j]) * share
                here = (both - x[j] + back * x[j] + 2.0 * slow * v[j]) / (1.0 + back)
                v[j] = slow * (here - x[j]) - v[j]
                x[j] = here
        for j in range(columns):
            before[j] = read[k, j]
            read[k, j] = x[j]
