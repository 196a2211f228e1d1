"""Air that moves: von Karman's turbulence along the flight, its rolling, thermals, and a wind that wanders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jsbsim_twin import Array
from scipy import signal

SETTLED = 1.5  # s over which the gusts come up from nothing, so that a flight starts in trim


@dataclass(frozen=True)
class Air:
    """What the air does.

    gust: m/s, standard deviation of each component. length: m, von Karman's scale of turbulence. rolling: share of the
    rolling gust that goes with `gust` (0 or 1). wind: m/s north and east, steady. wander: m/s, standard deviation of a
    horizontal wind that changes over half a minute. thermal: m/s, strongest updraught of a thermal every half minute.
    """

    gust: float = 0.0
    length: float = 80.0
    rolling: float = 0.0
    wind: tuple[float, float] = (0.0, 0.0)
    wander: float = 0.0
    thermal: float = 0.0


@dataclass(frozen=True)
class AirMotion:
    """(N, 3) m/s in body axes, (N,) down, m/s, (N,) rolling, rad/s, and the steady wind, m/s north and east."""

    body: Array
    down: Array
    rolling: Array
    steady: tuple[float, float]


def along(omega: Array, length: float, speed: float) -> Array:
    """von Karman's spectrum of u, of unit variance: (m/s)^2 s/rad, one-sided over rad/s."""
    x = 1.339 * length * omega / speed
    return np.asarray(2.0 * length / (np.pi * speed) / (1.0 + x**2) ** (5.0 / 6.0))


def across(omega: Array, length: float, speed: float) -> Array:
    """von Karman's spectrum of v and w, of unit variance."""
    x = (1.339 * length * omega / speed) ** 2
    return np.asarray(length / (np.pi * speed) * (1.0 + 8.0 / 3.0 * x) / (1.0 + x) ** (11.0 / 6.0))


def rolling(omega: Array, length: float, speed: float, span: float) -> Array:
    """Spectrum of the rolling gust that goes with a vertical one of unit variance (MIL-F-8785C): (rad/s)^2 s/rad."""
    height = 0.8 * (np.pi * length / (4.0 * span)) ** (1.0 / 3.0) / (length * speed)
    return np.asarray(height / (1.0 + (4.0 * span * omega / (np.pi * speed)) ** 2))


def realise(spectrum: Array, count: int, step: float, generator: np.random.Generator) -> Array:
    """(count,) noise with a spectrum given at the frequencies of 2 count points."""
    # Twice as long as the flight, so that its end does not know its beginning.
    width = 2.0 * np.pi / (2 * count * step)
    size = np.sqrt(spectrum * width) * 2 * count / 2.0
    size[0] = 0.0
    lines = size * (generator.standard_normal(size.size) + 1j * generator.standard_normal(size.size))
    return np.asarray(np.fft.irfft(lines, 2 * count)[:count])


def slow_noise(count: int, step: float, correlation: float, generator: np.random.Generator) -> Array:
    """(count,) Gauss-Markov noise of unit variance and correlation time, s."""
    left = float(np.exp(-step / correlation))
    shocks = np.sqrt(1.0 - left**2) * generator.standard_normal(count)
    shocks[0] = generator.standard_normal()
    return np.asarray(signal.lfilter([1.0], [1.0, -left], shocks))


def air_motion(air: Air, count: int, step: float, speed: float, span: float, seed: int) -> AirMotion:
    """The air along one flight of `count` steps at a speed, m/s, for a span, m."""
    generator = np.random.default_rng([seed, 11])
    times = np.arange(count) * step
    rise = np.clip(times / SETTLED, 0.0, 1.0)
    omega = 2.0 * np.pi * np.fft.rfftfreq(2 * count, step)
    # A wing averages what is shorter than itself; JSBSim's integrators would amplify what changes from step to step.
    felt = 1.0 / (1.0 + (omega * span / (2.0 * np.pi * speed)) ** 4) ** 2
    spectra = (felt * along(omega, air.length, speed), *(felt * across(omega, air.length, speed),) * 2)
    body = air.gust * np.stack([realise(s, count, step, generator) for s in spectra], axis=1) * rise[:, None]
    turning = (
        air.gust * air.rolling * rise * realise(felt * rolling(omega, air.length, speed, span), count, step, generator)
    )
    generator = np.random.default_rng([seed, 12])
    for axis in range(2):
        # It blows along a turning aircraft's axes rather than the earth's: over half a minute that makes no difference.
        wander = slow_noise(count, step, 30.0, generator)
        body[:, axis] += air.wander * (wander - wander[0])
    down = np.zeros(count)
    for middle in np.arange(generator.uniform(5.0, 20.0), times[-1], 30.0):
        width = generator.uniform(30.0, 60.0) / speed
        down -= air.thermal * generator.uniform(0.5, 1.0) * rise * np.exp(-(((times - middle) / width) ** 2))
    return AirMotion(body, down, turning, air.wind)
