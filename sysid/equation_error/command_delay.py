"""How late the aircraft follows its commands, by equation error: the delay with which they explain the moments best.

Kinematics say nothing of commands. The moments do: their residual over the delay is a profile of the likelihood,
coarse, but without local minima nearby, so that output error can start from there. Both sides of the equations have
passed the same smoother; a delay of commands that are held is then a shift of their smoothed columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.model.terms import Term, parse_term
from sysid.arrays import Array
from sysid.equation_error.coefficients import Body
from sysid.equation_error.equations import CONTROLS, MOMENTS, Equations, axes_of
from sysid.equation_error.time_domain import settled_equations
from sysid.errors import SysidError
from sysid.numerics.autoregression import pooled_autocorrelation
from sysid.numerics.fractional_delay import held_back, read_later
from sysid.signals.delay import COMMANDS, Delay
from sysid.signals.flight import FlightData

# Delays that are tried, s.
EARLIEST_S, LATEST_S, STEP_S = -0.25, 0.3, 0.02
_WIDTHS_S = tuple(STEP_S * share for share in (1.0, 0.25, 0.1, 0.04, 0.02))
# A delay counts from this gain in log likelihood, so many standard errors, and this size, s, on.
GAIN, SIGMAS, LEAST_S = 20.0, 4.0, 5e-3


@dataclass(frozen=True)
class Profile:
    """Likelihood over the delay. delay, std: its estimate, s. gain: log likelihood over no delay; explained: over no
    commands at all.
    """

    delay: float
    std: float
    gain: float
    explained: float

    def counts(self) -> bool:
        """Whether it is no accident."""
        return self.gain > GAIN and abs(self.delay) > max(SIGMAS * self.std, LEAST_S)

    def found(self) -> Delay:
        """As a delay of the commands."""
        return Delay(COMMANDS, self.delay, self.std)


class _MomentEquation:
    """One moment's equation with its commands at any time, on those rows that have a sample to shift to."""

    def __init__(self, equations: Equations, axis: str, terms: Sequence[Term]) -> None:
        self._interval_s, self._lengths = equations.interval_s, equations.lengths
        moved = [term for term in terms if set(term.factors) & set(CONTROLS)]
        fixed = [term for term in terms if term not in moved]
        self._edge = round(max(-EARLIEST_S, LATEST_S) / self._interval_s) + 2
        self._commands = self._parts(equations.matrix(moved))
        self._basis = np.linalg.qr(self._inner(self._parts(equations.matrix(fixed))))[0]
        self._target = self._free(self._inner(self._parts(equations.regressand(axis))))

    def _parts(self, values: Array) -> list[Array]:
        return np.split(values, np.cumsum(self._lengths[:-1]))

    def _inner(self, parts: Sequence[Array]) -> Array:
        """The rows that count, joined."""
        return np.concatenate([part[self._edge : -self._edge] for part in parts])

    def _free(self, values: Array) -> Array:
        """What the motion's own terms do not explain."""
        left: Array = values - self._basis @ (self._basis.T @ values)
        return left

    def residual(self, delay: float | None) -> Array:
        """(rows,) of the regression with the commands late by `delay`, or without commands."""
        if delay is None:
            return self._target
        late = [read_later(part, -delay, self._interval_s) for part in self._commands]
        columns = self._free(self._inner(late))
        basis, size = np.linalg.qr(columns)
        own = np.abs(np.diag(size))
        basis = basis[:, own > 1e-10 * own.max()]  # commands that move together count once
        left: Array = self._target - basis @ (basis.T @ self._target)
        return left


def command_delay(parts: Sequence[FlightData], body: Body, names: Sequence[str]) -> Profile | None:
    """Profile of the delay of the commands over corrected parts (see sysid.equation_error.equations); None where
    nothing can be told.

    names: coefficients that the flight excites, of which those of the moments count.
    """
    terms = [term for term in map(parse_term, names) if term.axis in MOMENTS]
    least_s = 2.0 * max(-EARLIEST_S, LATEST_S) + 2.0
    long = [part for part in parts if part.time_s.size * part.interval_s > least_s]
    if not _commanded(terms) or not long:
        return None
    try:
        found = _profile(long, body, terms, np.arange(EARLIEST_S, LATEST_S + 1e-9, STEP_S))
        if found is None or not found.counts():
            return found
        # Once more with the commands where they belong, which then bend the rates between samples as they did.
        near = _profile([_moved(part, found.delay) for part in long], body, terms, np.array([-STEP_S, 0.0, STEP_S]))
    except SysidError:
        return None
    return found if near is None else replace(found, delay=found.delay + near.delay, std=near.std)


def _profile(parts: Sequence[FlightData], body: Body, terms: Sequence[Term], grid: Array) -> Profile | None:
    """Profile over a grid of delays [s] and about its best one; None where that is at an end."""
    equations = settled_equations(parts, body, [term.name for term in terms])
    grouped = [(axis, own) for axis, own in axes_of(terms) if _commanded(own)]
    axes = [_MomentEquation(equations, axis, own) for axis, own in grouped]
    spread = [sum(r.size * np.log(np.mean(r**2)) for r in (axis.residual(delay) for axis in axes)) for delay in grid]
    coarse = int(np.argmin(spread))
    if not 0 < coarse < grid.size - 1:
        return None
    # How many samples of each moment are independent is decided once, where the commands fit best.
    counts = [_independent(axis.residual(grid[coarse])) for axis in axes]

    def cost(delay: float | None) -> float:
        residuals = [axis.residual(delay) for axis in axes]
        return float(sum(0.5 * n * np.log(np.mean(r**2)) for n, r in zip(counts, residuals, strict=True)))

    best = float(grid[coarse])
    # The profile of a likelihood is nearly a parabola; each one narrower than the last.
    for width in _WIDTHS_S:
        before, here, after = (cost(best + side * width) for side in (-1.0, 0.0, 1.0))
        bend = before - 2.0 * here + after
        best += width * float(np.clip(0.5 * (before - after) / bend, -1.0, 1.0)) if bend > 0.0 else 0.0
    low = cost(best)
    step = 0.5 * parts[0].interval_s
    curvature = (cost(best - step) - 2.0 * low + cost(best + step)) / step**2
    std = curvature**-0.5 if curvature > 0.0 else float("inf")
    return Profile(best, std, cost(0.0) - low, cost(None) - low)


def _moved(part: FlightData, delay: float) -> FlightData:
    """The part with its surfaces moving as they act, late by `delay`."""
    late = {n: held_back(part[n], delay, part.interval_s) for n in CONTROLS[:3] if n in part}
    return replace(part, columns={**part.columns, **late})


def _commanded(terms: Sequence[Term]) -> bool:
    return any(set(term.factors) & set(CONTROLS) for term in terms)


def _independent(residual: Array) -> float:
    """Number of independent samples among coloured ones."""
    return residual.size / max(float(np.sum(pooled_autocorrelation([residual]))), 1.0)
