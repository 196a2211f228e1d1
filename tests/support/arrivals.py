"""Ten minutes of messages over a bad link: when they arrive, from clocks and delays that are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gcs.clock.fit import NS_PER_S, ClockFit

Array = NDArray[np.float64]
Jitter = Callable[[np.random.Generator, int], Array]
Late = Callable[[np.random.Generator, int], NDArray[np.bool_]]

UTC = 1_790_000_000 * NS_PER_S
BOOT_S = 500.0
LEAST_S = 0.012  # the smallest delay, unknown to the estimator, which must count it to the offset
DRIFT = 50e-6
JITTER: dict[str, Jitter] = {
    "exponential": lambda rng, n: rng.exponential(0.03, n),
    "half normal": lambda rng, n: np.abs(rng.normal(0.0, 0.03, n)),
    "uniform": lambda rng, n: rng.uniform(0.0, 0.03, n),
    "normal": lambda rng, n: rng.normal(0.0, 0.03, n),
}


def late_singly(rng: np.random.Generator, n: int) -> NDArray[np.bool_]:
    return rng.random(n) < 0.2


def late_in_bursts(rng: np.random.Generator, n: int) -> NDArray[np.bool_]:
    """Runs of 1 to 40 late messages, 20 % in all."""
    starts = np.flatnonzero(rng.random(n) < np.log(1 / 0.8) / 20.5)
    ends = np.minimum(starts + rng.integers(1, 41, starts.size), n)
    depth = np.zeros(n + 1, np.int64)
    np.add.at(depth, starts, 1)
    np.add.at(depth, ends, -1)
    return np.asarray(np.cumsum(depth[:-1]) > 0)


def flight(
    seed: int, jitter: str, late: Late, *, rate_hz: float = 50.0, in_order: bool = False
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Reception and stamps, ns, of ten minutes: 50 ppm, jitter of 30 ms, 20 % of the packets 50 to 500 ms late."""
    rng = np.random.default_rng(seed)
    n = round(600 * rate_hz)
    sent = BOOT_S + np.arange(n) / rate_hz
    delay = LEAST_S + JITTER[jitter](rng, n) + late(rng, n) * rng.uniform(0.05, 0.5, n)
    arrived = sent + DRIFT * (sent - BOOT_S) + delay
    if in_order:
        arrived = np.maximum.accumulate(arrived)
    return UTC + np.rint(arrived * NS_PER_S).astype(np.int64), np.rint(sent * NS_PER_S).astype(np.int64)


def errors(fit: ClockFit) -> tuple[float, float]:
    """Of the drift, ppm, and of the offset in the middle of the flight, ms."""
    truth = (LEAST_S + DRIFT * (fit.origin_ns / NS_PER_S - BOOT_S)) * 1e3
    return (fit.drift - DRIFT) * 1e6, (fit.offset_ns - UTC) / 1e6 - truth
