"""One clock against another from one-way messages: offset, drift and delays, with standard errors.

Reception = stamp + offset + drift (stamp - origin) + delay. A delay on the way only ever adds, so where messages do
reach the smallest delay the line is the one below all of them (Moon, Skelly, Towsley, INFOCOM 1999): its error falls
with the number of messages, not with its root, and late messages do not touch it. Where the jitter has no sharp lower
edge (Gaussian about a base delay, say), few come near the smallest delay and the line through the core of the delays
is the better one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs.clock.lower_bound import lowest, support_lines

Times = NDArray[np.int64]
Array = NDArray[np.float64]

NS_PER_S = 1_000_000_000
BINS = 60  # stretches of the first, outlier-proof line
BLOCKS = 300  # stretches of the line below all
SHORTEST_BLOCK_S = 0.2
REPLICATES = 200
FEWEST = 20  # messages without which there is no standard error
RESOLUTION_S = 1e-9
OUTLIER = 6.0
SHARPEST, BLUNTEST = 0.3, 8.0
SHARP = 3.0  # see _has_edge; 1.8 for normal delays, 5 for Erlang's of two, 10 and more for uniform and exponential ones
CORE_MESSAGES = 60_000
CORE_BINS = 40
CORE_CLUSTERS = 50
CORE_ROUNDS = 8
SHAPE_UNCERTAINTY = 1.1  # the edge's shape is itself estimated from some 300 delays


@dataclass(frozen=True)
class Delays:
    """Delays beyond the line of a ClockFit, s: the smallest, the median, the one that 95 % do not exceed."""

    smallest_s: float
    median_s: float
    q95_s: float


@dataclass(frozen=True)
class ClockFit:
    """Reception = stamp + offset + drift (stamp - origin) for a message that arrives without further delay.

    drift: by how much the receiver's clock gains on the sender's. offset_std_s: of the offset at `origin_ns`.
    Standard errors are infinite where the messages are too few. anchor: the delay that the offset contains,
    the smallest one or the "typical" one (the centre of the core of two-sided jitter); one-way messages do not show
    how long that is.
    """

    origin_ns: int
    offset_ns: int
    drift: float
    offset_std_s: float = float("inf")
    drift_std: float = float("inf")
    anchor: Literal["smallest", "typical"] = "smallest"
    delays: Delays = Delays(0.0, 0.0, 0.0)

    def to_vehicle(self, log_ns: Times) -> Times:
        """Vehicle's time, ns, at which a message received at `log_ns` left, at the anchor's delay."""
        since = (log_ns - self.offset_ns - self.origin_ns).astype(np.float64) / (1.0 + self.drift)
        return np.rint(since).astype(np.int64) + self.origin_ns

    def delay(self, log_ns: Times, stamp_ns: Times) -> Times:
        """Delay, ns, beyond the anchor's one."""
        slope = np.rint(self.drift * (stamp_ns - self.origin_ns).astype(np.float64)).astype(np.int64)
        return log_ns - stamp_ns - self.offset_ns - slope

    def offset_std_at(self, stamp_ns: int) -> float:
        """Standard error of the offset at a vehicle's time, s: it grows away from `origin_ns`."""
        return float(np.hypot(self.offset_std_s, self.drift_std * (stamp_ns - self.origin_ns) / NS_PER_S))


@dataclass(frozen=True)
class _Line:
    """offset + drift t, s, t from the origin; standard errors of the offset at t = 0 and of the drift."""

    offset: float
    drift: float
    offset_std: float = float("inf")
    drift_std: float = float("inf")


def fit_clock(log_ns: Times, stamp_ns: Times) -> ClockFit:
    """The line of N >= 1 messages, in order of reception or not; outliers of either sign are borne.

    log_ns, stamp_ns: (N,) reception and stamp. The standard errors are statistical, for delays that are alike
    throughout; the coverage of their 95 % intervals is what the tests hold them to.
    """
    origin = round(float(np.mean(stamp_ns - stamp_ns[0]))) + int(stamp_ns[0])
    spread = float(np.median(np.abs(stamp_ns - np.median(stamp_ns))))
    if abs(origin - float(np.median(stamp_ns))) > spread:
        origin = int(np.median(stamp_ns))  # a stray stamp far off would carry the mean away
    base = int(np.median(log_ns - stamp_ns))
    t = (stamp_ns - origin).astype(np.float64) / NS_PER_S
    d = (log_ns - stamp_ns - base).astype(np.float64) / NS_PER_S
    arrived = (log_ns - log_ns.min()).astype(np.float64) / NS_PER_S
    line = first = first_line(arrived, t, d)
    anchor: Literal["smallest", "typical"] = "smallest"
    if t.size >= FEWEST and np.ptp(arrived) > SHORTEST_BLOCK_S and np.ptp(t) > 0.0:
        line = _below_all(arrived, t, d, first)
        if not _has_edge(d - first.drift * t):
            core = _through_core(t, d, first)
            if core is not None and core.drift_std < line.drift_std:
                line, anchor = core, "typical"
    low, middle, high = np.quantile(d - line.offset - line.drift * t, (0.0, 0.5, 0.95))
    return ClockFit(
        origin,
        base + round(line.offset * NS_PER_S),
        line.drift,
        line.offset_std,
        line.drift_std,
        anchor,
        Delays(float(low), float(middle), float(high)),
    )


def _places(arrived: Array, count: int) -> NDArray[np.int64]:
    # Stretches of reception, which unlike a stamp never strays.
    return np.minimum((arrived * (count / max(float(arrived.max()), RESOLUTION_S))).astype(np.int64), count - 1)


def first_line(arrived: Array, t: Array, d: Array) -> _Line:
    """Line under the smallest delays of up to 60 stretches of time, robust against outliers in 29 % of them.

    arrived: (N,) time of reception from the first, s. t, d: (N,) stamp and delay, s. Theil and Sen's median of slopes.
    """
    count = int(min(BINS, max(1.0, float(arrived.max()))))
    chosen = lowest(_places(arrived, count), d, count)
    at, least = t[chosen], d[chosen]
    drift = 0.0
    if at.size >= 3:
        i, j = np.triu_indices(at.size, 1)
        apart = at[j] - at[i]
        if np.any(apart > 0):
            drift = float(np.median((least[j] - least[i])[apart > 0] / apart[apart > 0]))
    return _Line(float(np.median(least - drift * at)), drift)


def _below_all(arrived: Array, t: Array, d: Array, first: _Line) -> _Line:
    """The highest line below all messages but outliers.

    The smallest delays of equal stretches of time follow a Weibull distribution whatever the delays' own is; its shape
    and scale, read off their quantiles, give the line's bias and standard errors by 200 replicates of it.
    """
    rest = d - first.offset - first.drift * t
    least = rest[lowest(_places(arrived, BINS), rest, BINS)]
    usual = float(np.median(least))
    kept = rest > usual - OUTLIER * float(np.median(np.abs(least - usual))) - 1e-6
    arrived, t, rest = arrived[kept], t[kept], rest[kept]
    count = int(max(1, min(BLOCKS, t.size // 2, arrived.max() / SHORTEST_BLOCK_S)))
    chosen = lowest(_places(arrived, count), rest, count)
    chosen = chosen[np.argsort(t[chosen], kind="stable")]
    at, least = t[chosen], rest[chosen]
    centre = float(at.mean())
    height, slope = support_lines(at, least[None, :], centre)[0].tolist()
    above = least - height - slope * (at - centre)
    draws = np.random.default_rng(0).standard_exponential((REPLICATES, at.size))
    bias, shape = 0.0, 1.0
    lines = np.zeros((1, 2))
    for _ in range(3):  # the line lies too high by its bias, which distorts the shape a little
        shape, scale = _weibull(above + bias)
        lines = support_lines(at, scale * draws ** (1.0 / shape), centre)
        bias = float(lines[:, 0].mean())
    height_std = SHAPE_UNCERTAINTY * float(lines[:, 0].std()) + RESOLUTION_S
    slope_std = SHAPE_UNCERTAINTY * float(np.sqrt(np.mean(lines[:, 1] ** 2))) + RESOLUTION_S / max(np.ptp(at), 1.0)
    return _Line(
        first.offset + height - bias - slope * centre,
        first.drift + slope,
        float(np.hypot(height_std, slope_std * centre)),
        slope_std,
    )


def _has_edge(rest: Array) -> bool:
    """Whether delays set in steeply: their lowest 5 % lie close together, as against the half below the median."""
    first, low, middle = np.quantile(rest, (0.005, 0.05, 0.5))
    return bool(middle - low >= SHARP * (low - first))


def _weibull(values: Array) -> tuple[float, float]:
    """Shape and scale of a Weibull distribution that begins at 0, from its quantiles of 10 % and 50 %."""
    low, middle = np.maximum(np.quantile(values, (0.1, 0.5)), 1e-12)
    ratio = np.log(np.log(2.0) / -np.log(0.9))
    shape = float(np.clip(ratio / max(np.log(middle / low), 1e-3), SHARPEST, BLUNTEST))
    return shape, float(middle / np.log(2.0) ** (1.0 / shape))


def _through_core(t: Array, d: Array, first: _Line) -> _Line | None:
    """The most likely line when the delays' density is estimated along with it (Stone, Ann. Stat. 3, 1975).

    Its standard error is the sandwich over stretches of time, so delays that hang together in bursts are borne. The
    offset is the centre of the core. None where there is no core to speak of.
    """
    step = -(-t.size // CORE_MESSAGES)
    t, d = t[::step], d[::step]
    drift = first.drift
    for _ in range(CORE_ROUNDS):
        rest = d - drift * t
        score = _score(rest, *_score_table(rest))
        information = float(np.sum((score * t) ** 2))
        if information <= 0.0:
            return None
        drift += float(np.sum(score * t)) / information
    rest = d - drift * t
    table = _score_table(rest)
    score = _score(rest, *table)
    cluster = np.minimum(((t - t.min()) / np.ptp(t) * CORE_CLUSTERS).astype(np.int64), CORE_CLUSTERS - 1)
    sums = np.bincount(cluster, score * t, CORE_CLUSTERS)
    shift = 2.0 / np.sqrt(float(np.sum((score * t) ** 2)))
    change = np.sum((_score(rest - shift * t, *table) - _score(rest + shift * t, *table)) * t) / (2.0 * shift)
    if change == 0.0:
        return None
    variance = float(np.sum(sums**2)) * CORE_CLUSTERS / (CORE_CLUSTERS - 1)
    found = _centre(rest)
    if found is None:
        return None
    offset, sigma = found
    together = max(1.0, variance / float(np.sum((score * t) ** 2)))
    # A normal core cut off one sigma above its centre determines it half as well as a whole one.
    offset_std = sigma * float(np.hypot(2.0 * np.sqrt(together / rest.size), 0.01))
    return _Line(offset, drift, offset_std, float(np.sqrt(variance)) / abs(float(change)))


def _score_table(rest: Array) -> tuple[Array, Array]:
    """Places, s, and there the slope of the log density of delays, with its sign turned: (M,), (M,).

    The histogram's bins grow wider away from the core (inverse hyperbolic sine), where few messages are.
    """
    low, middle = np.quantile(rest, (0.005, 0.5))
    scale = max(float(middle - low), RESOLUTION_S)
    bent = np.arcsinh((rest - low) / scale)
    first, last = np.quantile(bent, (0.0005, 0.9995))
    edges = np.linspace(first - 0.3, last + 0.3, CORE_BINS + 1)
    width = float(edges[1] - edges[0])
    density = np.histogram(bent, edges)[0] / (rest.size * width)
    for _ in range(4):
        padded = np.pad(density, 1, mode="edge")
        density = (padded[:-2] + 2.0 * padded[1:-1] + padded[2:]) / 4.0
    middles = (edges[1:] + edges[:-1]) / 2.0
    places = low + scale * np.sinh(middles)
    # Three messages more in each bin keep the logarithm's slope small where there are hardly any.
    logs = np.log(density / (scale * np.cosh(middles)) + 3.0 / (rest.size * scale * width))
    slope = -np.gradient(logs, places)
    slope[0] = slope[-1] = 0.0
    return places, slope


def _score(rest: Array, places: Array, slope: Array) -> Array:
    return np.interp(rest, places, slope, left=0.0, right=0.0)


def _centre(rest: Array) -> tuple[float, float] | None:
    """Centre and sigma, s, of a normal core from what lies below one sigma above the centre, where none is late.

    Moments of the normal distribution cut off above (Cohen, Ann. Math. Stat. 21, 1950), by fixed-point iteration.
    """
    low, middle = np.quantile(rest, (0.005, 0.5))
    centre, sigma = float(middle), float(middle - low) / 2.5
    for _ in range(60):
        cut = centre + sigma
        held = rest[(rest < cut) & (rest > centre - 5.0 * sigma)]
        if held.size < FEWEST:
            return None
        mean, variance = float(held.mean()), float(held.var())
        before = centre
        for _ in range(30):
            beta = (cut - centre) / sigma
            hazard = _hazard(beta)
            left = 1.0 - beta * hazard - hazard * hazard
            if not left > 0.0:
                return None
            wanted = np.sqrt(variance / left)
            centre, sigma = 0.5 * (centre + mean + wanted * hazard), 0.5 * (sigma + wanted)
        if abs(centre - before) < 0.1 * sigma / np.sqrt(rest.size):
            break
    return centre, sigma


def _hazard(beta: float) -> float:
    """phi(beta) / Phi(beta)."""
    from math import erf, exp, pi, sqrt

    return exp(-0.5 * beta * beta) / sqrt(2.0 * pi) / max(0.5 * (1.0 + erf(beta / sqrt(2.0))), 1e-300)
