"""Has the model changed? The last seconds' equations under the coefficients that were known before.

For each coefficient j of an axis the residuals e of the last seconds are explained by a step d of that coefficient
alone: d = sum(x_j e) / sum(x_j^2), and d^2 over its variance is the generalised likelihood ratio, twice its logarithm.
A change is reported where the likeliest one is beyond doubt, is a large share of the coefficient, and explains most of
the residuals, twice in a row. Its time is where the likelihood of "from here on" is largest (the CUSUM's own estimate).
Source: M. Basseville & I. V. Nikiforov, "Detection of Abrupt Changes", 1993, sections 2.2 and 2.4.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Array
from sysid.live.recursive.causes import AxisEquations, CauseFound, KnownAxis
from sysid.live.recursive.decimation import RATE_HZ

# Over which a change is looked for, s, and samples are kept.
WINDOW_S = 2.5
_MEMORY_S = 8.0
_BEFORE_S = 3.0  # what is known counts as it was this long ago
_LEARNED_S = 6.0  # of flight, before which standard errors are too young to call anything known
_RATIO = 60.0
_SHARE = 0.1
_EXPLAINED = 0.6
# From so many times the usual mean square of the residuals on the axis no longer follows its equation at all, whatever
# one coefficient explains of it; it has done so since residuals were so many times as large.
_BROKEN, _BREAKS = 40.0, 4.0
# So many times what the coefficient's term usually explains of the residuals, rms, a change must explain: in gusts, and
# where the model lacks something, coefficients seem to wander all the time. Windows that count for it, first and most;
# the newest do not, since a change may have begun in them.
_FAR, _FIRST, _WINDOWS, _NOT_YET = 6.0, 4, 200, 6
# s before a change for which the known coefficients must have held: where they do not, they are what is wrong.
_FITTED_S = 1.0
_KNOWN = 0.15  # relative standard error of a coefficient whose change can be detected
_NOISE_MEMORY = 100.0
# A term is informative on its coefficient where its power is so many times that of its noise, and of this rms.
_MOVED = 10.0
_STILL = 1e-4


# Of the constants that of drag is one that ice changes and no bias of a sensor does, and that of lift one that a mass
# changes that is dropped, while the sensors agree with one another. What counts is the share of the coefficient for
# drag, of all the lift for lift.
_DRAG, _DRAG_SHARE, _LIFT, _LIFT_SHARE = "CD_0", 0.2, "CL_0", 0.1
_SETTLES_S = 0.2  # s behind a change in which smoothed samples are of both


@dataclass(frozen=True)
class Change:
    """A coefficient that has changed. before, after: its values. time_s: since when. std: standard error of `after`.

    causes: what may have done it, the likeliest first.
    """

    time_s: float
    axis: str
    coefficient: str
    before: float
    after: float
    std: float
    causes: tuple[CauseFound, ...] = ()


class ChangeDetector:
    """Watches one axis. names: P coefficients, the constant's among them."""

    def __init__(self, axis: str, names: Sequence[str]) -> None:
        self._axis, self._names = axis, tuple(names)
        # Of what each term whose coefficient is known explains of the residuals, and last of all of them: windows, mean
        # and variance.
        self._usual = np.zeros((3, len(self._names) + 1))
        self._parts: deque[Mapping[int, float]] = deque()
        self.restart()

    def restart(self) -> None:
        """What is known begins anew."""
        self._samples: deque[tuple[float, Array]] = deque(maxlen=round(_MEMORY_S * RATE_HZ))
        self._known: deque[tuple[float, Array, Array]] = deque()
        self._variance = np.nan
        self._parts.clear()
        self._suspect = ""
        self._begun = np.inf

    def add(self, time_s: float, columns: Array) -> None:
        """Take one decimated sample: terms, weight, left side."""
        self._begun = min(self._begun, time_s)
        self._samples.append((time_s, columns))

    def check(self, time_s: float, values: Array, covariance: Array, noise: Array) -> Change | None:
        """What has changed by now, if anything; values, covariance: the coefficients as known now.

        noise: (P,) variance of the white noise in each term's samples.
        """
        self._known.append((time_s, values, covariance))
        while len(self._known) > 1 and self._known[1][0] <= time_s - _BEFORE_S:
            self._known.popleft()
        at, theta, P = self._known[0]
        if at < self._begun + _LEARNED_S or at > time_s - _BEFORE_S + 0.5 or len(self._samples) < RATE_HZ * WINDOW_S:
            return None
        times = np.array([entry[0] for entry in self._samples])
        columns = np.array([entry[1] for entry in self._samples])
        X, residuals = columns[:, :-2], columns[:, -1] - columns[:, :-2] @ theta
        recent = times > time_s - WINDOW_S
        if 2 * np.count_nonzero(recent) < RATE_HZ * WINDOW_S:  # behind a gap
            return None
        self._learn_noise(residuals[times < time_s - _BEFORE_S])
        if not np.isfinite(self._variance):
            return None
        found = self._likeliest(X[recent], residuals[recent], theta, P, noise)
        if found is None:
            self._suspect = ""
            return None
        j, step, std = found
        suspect, self._suspect = self._suspect, self._names[j]
        if suspect != self._names[j]:
            return None
        since = self._since(times, X[:, j], residuals, step)
        if since < times[0] + _FITTED_S:
            return None
        # The window has begun before, and the filter holds what was before for a while.
        x, e = _about_means(self._names[j], *(values[times > since + _SETTLES_S] for values in (X[:, j], residuals)))
        if float(x @ x) > 0.2 * float(X[recent, j] @ X[recent, j]):
            step = float(x @ e) / float(x @ x)
        return Change(since, self._axis, self._names[j], float(theta[j]), float(theta[j] + step), std)

    def known_before(self, time_s: float) -> KnownAxis | None:
        """What was known before a change, as it was some seconds ago: what is known since holds some of it; and what
        that left. None where nothing was.
        """
        if not self._known or not np.isfinite(self._variance) or self._begun > time_s - _LEARNED_S:
            return None
        at, values, _ = self._known[0]
        X, y = self._since_samples(-np.inf, at)
        left = y - X @ values
        return KnownAxis(self._names, values, self._variance, float(np.mean(left)) if left.size else 0.0)

    def equations(self, known: KnownAxis, after_s: float) -> AxisEquations:
        """What has come since a change."""
        return AxisEquations(known, *self._since_samples(after_s + _SETTLES_S, np.inf))

    def _since_samples(self, after_s: float, before_s: float) -> tuple[Array, Array]:
        rows = [columns for at, columns in self._samples if after_s < at <= before_s]
        table = np.array(rows).reshape(len(rows), len(self._names) + 2)
        return table[:, :-2], table[:, -1]

    def _learn_noise(self, residuals: Array) -> None:
        if residuals.size < RATE_HZ:
            return
        now = float(np.mean(residuals**2))
        self._variance = now if np.isnan(self._variance) else self._variance + (now - self._variance) / _NOISE_MEMORY

    def _likeliest(
        self, X: Array, residuals: Array, theta: Array, P: Array, noise: Array
    ) -> tuple[int, float, float] | None:
        total = float(residuals @ residuals)
        lift = abs(float(np.mean(X @ theta + residuals)))
        best: tuple[float, int, float, float] = (_RATIO, -1, 0.0, 0.0)
        parts: dict[int, float] = {}
        for j, name in enumerate(self._names):
            size = lift if name == _LIFT else abs(theta[j])
            if not np.sqrt(P[j, j]) < _KNOWN * size or (name.endswith("_0") and name not in (_DRAG, _LIFT)):
                continue
            x, e = _about_means(name, X[:, j], residuals)
            power = float(x @ x)
            # What hardly moves is noise, and the coefficient times it is the residual: a step to nothing.
            if power < _MOVED * x.size * max(noise[j], _STILL**2):
                continue
            step = float(x @ e) / power
            uncertain = X.T @ x / power
            ratio = step**2 / (self._variance / power + float(uncertain @ P @ uncertain))
            parts[j] = step * float(np.sqrt(power))
            if ratio > best[0]:
                best = (ratio, j, step, parts[j] ** 2 / max(float(e @ e), 1e-300))
        whole = len(self._names)
        if parts:  # something that is known has moved
            parts[whole] = float(np.sqrt(total))
        # The likeliest one is reported or none: beside a small change of one coefficient a large one of another whose
        # motion is alike explains nearly as much.
        ratio, j, step, explained = best
        if j >= 0 and total >= 4.0 * self._variance * residuals.size and self._is_unusual(j, parts[j]):
            name = self._names[j]
            least = _LIFT_SHARE * lift if name == _LIFT else (_DRAG_SHARE if name == _DRAG else _SHARE) * abs(theta[j])
            # What hands do comes with pauses, in which little is left: that is not what is usual.
            usual = self._usual[0, whole] >= _FIRST and self._is_unusual(whole, parts[whole])
            broken = usual and total > _BROKEN * self._variance * residuals.size
            if abs(step) > least and (explained > _EXPLAINED or broken):
                return j, step, abs(step) / float(np.sqrt(ratio))
        self._parts.append(parts)
        if len(self._parts) > _NOT_YET:
            self._learn_usual(self._parts.popleft())
        return None

    def _is_unusual(self, j: int, part: float) -> bool:
        windows, mean, variance = self._usual[:, j]
        return bool(windows < _FIRST or (part - mean) ** 2 > _FAR**2 * variance)

    def _learn_usual(self, parts: Mapping[int, float]) -> None:
        """What terms explained of the residuals where nothing has changed: the root of a sum of squares, signed."""
        for j, part in parts.items():
            windows, mean, variance = self._usual[:, j]
            share, off = 1.0 / min(windows + 1.0, _WINDOWS), part - mean
            self._usual[:, j] = windows + 1.0, mean + share * off, (1.0 - share) * (variance + share * off**2)

    def _since(self, times: Array, x: Array, residuals: Array, step: float) -> float:
        left = residuals - step * x
        gain = residuals**2 - left**2 - self._variance
        if float(left @ left) > (1.0 - _EXPLAINED) * float(residuals @ residuals):
            gain = residuals**2 - _BREAKS * self._variance
        return float(times[int(np.argmax(np.cumsum(gain[::-1])[::-1]))])


def _about_means(name: str, x: Array, e: Array) -> tuple[Array, Array]:
    """A term's samples and the residuals, each about its mean; those of a constant as they are."""
    return (x, e) if name in (_DRAG, _LIFT) or not x.size else (x - np.mean(x), e - np.mean(e))
