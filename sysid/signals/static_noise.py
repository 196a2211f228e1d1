"""The noise of a sensor from a recording at rest: spectral densities, steps, sticking and peaks.

The noise model is that of IEEE Std 952, annex C: white noise (random-walk coefficient N), flicker (bias instability B)
and random walk of the rate (K), with the two-sided spectral density

    S(f) = N^2 + B^2 / (2 pi f) + K^2 / (2 pi f)^2

whose Allan variance is N^2 / tau + (2 ln 2 / pi) B^2 + K^2 tau / 3. The coefficients are fitted by maximum likelihood
on the tapered periodogram (Whittle, 1953), which uses all of the record; the Allan deviation is what people look at.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.optimize import nnls
from scipy.special import chdtri

from sysid.errors import SignalError
from sysid.numerics.normal_equations import inverse
from sysid.signals.flight import Signal

Array = NDArray[np.float64]

SHORTEST_SAMPLES = 200  # of a bench log
TERMS = ("N", "B", "K")
_FALSE_ALARM = 1e-3  # probability of a line or a term of noise that is not there
_EVIDENCE = float(chdtri(1, _FALSE_ALARM)) / 2.0  # gain in log likelihood that a further term must bring
_ROLL_OFF = 0.7  # density of the upper band over the lower below which the sensor is taken to be filtered
_FIRST_BIN = 2  # the taper mixes the mean into the bins before it
_ITERATIONS = 50
_TREND_S = 2.0  # the noise of one sample is taken about a moving mean of this length
_STILL = 5  # equal readings in a row that count as standing still
_STEP_TOLERANCE = 0.02
_LARGEST_STEP_COUNT = 20_000  # distinct values beyond which a reading is taken to be continuous


@dataclass(frozen=True)
class NoiseEstimate:
    """A value with its standard error, or the reason why there is none."""

    value: float | None
    std: float | None
    unit: str
    refused: str = ""

    def to_json(self) -> dict[str, object]:
        """As results hold it."""
        if self.value is None:
            return {"refused": self.refused, "unit": self.unit}
        return {"value": self.value, "std": self.std, "unit": self.unit}


@dataclass(frozen=True)
class Peak:
    """A line in the spectrum: its frequency, Hz, and the RMS of that oscillation in the signal's unit."""

    frequency_hz: float
    rms: float


@dataclass(frozen=True)
class SensorNoise:
    """What a signal at rest shows of its sensor.

    mean: of all samples. sample_std: standard deviation of one sample about the slow drift. white, bias_instability,
    rate_random_walk: N, B and K. bandwidth_hz: where the sensor's own filter cuts, None where none shows.
    quantisation: step of the reading, None where none shows. dead_zone: smallest movement after standing still, None
    where the reading does not stick. peaks: oscillations, largest first. allan_tau_s, allan_deviation: (T,).
    """

    rate_hz: float
    duration_s: float
    samples: int
    unit: str
    mean: float
    sample_std: float
    white: NoiseEstimate
    bias_instability: NoiseEstimate
    rate_random_walk: NoiseEstimate
    bandwidth_hz: float | None
    quantisation: float | None
    dead_zone: float | None
    peaks: tuple[Peak, ...]
    allan_tau_s: Array
    allan_deviation: Array


def allan_deviation(values: Array, interval_s: float) -> tuple[Array, Array]:
    """(T,) averaging times, s, in octaves up to a quarter of the record, and the overlapping Allan deviation there.

    values: (N,) samples of the quantity itself (a rate, not an angle), `interval_s` apart.
    """
    phase = np.concatenate(([0.0], np.cumsum(values - values.mean()))) * interval_s
    counts = [2**k for k in range(int(math.log2(max(values.size / 4, 1))) + 1)]
    taus, deviations = [], []
    for m in counts:
        second = phase[2 * m :] - 2.0 * phase[m:-m] + phase[: -2 * m]
        taus.append(m * interval_s)
        deviations.append(math.sqrt(float(np.mean(second**2)) / 2.0) / (m * interval_s))
    return np.array(taus), np.array(deviations)


def quantisation_step(values: Array) -> float | None:
    """The step of which all differences between readings are multiples; None for a continuous reading."""
    distinct = np.unique(values)
    if distinct.size < 2 or distinct.size > _LARGEST_STEP_COUNT:
        return None
    gaps = np.diff(distinct)
    # 32-bit fields and unit conversion leave dust between equal readings.
    gaps = gaps[gaps > 1e-6 * max(float(np.abs(distinct).max()), float(gaps.max()))]
    if gaps.size == 0:
        return None
    step = float(np.quantile(gaps, 0.05))
    turns = gaps / step
    step = float(gaps.sum() / np.rint(turns).sum())
    regular = np.abs(gaps / step - np.rint(gaps / step)) < _STEP_TOLERANCE * np.maximum(np.rint(gaps / step), 1.0)
    # Gaps of a continuous reading are exponentially spread: few of them would be near a multiple of a small step.
    return step if regular.mean() > 0.95 and np.median(turns) < 8.0 else None


def dead_zone(values: Array, step: float | None) -> float | None:
    """Median movement with which a reading leaves a stand of at least 5 equal samples; None where it does not stick.

    step: quantisation step, which alone makes readings repeat and so must be exceeded.
    """
    moves = np.flatnonzero(np.diff(values) != 0.0)
    if moves.size < 3:
        return None
    stands = np.diff(np.concatenate(([-1], moves)))
    left = np.abs(np.diff(values))[moves][stands >= _STILL]
    still = stands[stands >= _STILL].sum() / values.size
    if left.size < 3 or still < 0.3:
        return None
    size = float(np.median(left))
    return size if step is None or size > 1.5 * step else None


def sensor_noise(signal: Signal) -> SensorNoise:
    """The noise of one signal of a sensor at rest. Raises SignalError where it is too short, or constant."""
    received, values, interval = _uniform(signal)
    step = quantisation_step(received)
    frequencies, power = _periodogram(values, interval)
    peaks, clean = _peaks(frequencies, power, values.size, interval)
    top, bandwidth = _usable(frequencies, power, clean, 1.0 / interval)
    chosen = clean & (frequencies <= top)
    found, identified = _fit_density(frequencies[chosen], power[chosen], interval)
    units = {"N": f"{signal.unit}/sqrt(Hz)", "B": signal.unit, "K": f"{signal.unit}/s/sqrt(Hz)"}
    duration = values.size * interval
    estimates = [_estimate(found, identified, term, units[term], duration) for term in TERMS]
    taus, deviations = allan_deviation(values, interval)
    span = max(3, 2 * round(_TREND_S / interval / 2.0) + 1)
    around = values - uniform_filter1d(values, span, mode="reflect")
    return SensorNoise(
        rate_hz=1.0 / interval,
        duration_s=duration,
        samples=values.size,
        unit=signal.unit,
        mean=float(values.mean()),
        sample_std=float(around.std() / math.sqrt(1.0 - 1.0 / span)),
        white=estimates[0],
        bias_instability=estimates[1],
        rate_random_walk=estimates[2],
        bandwidth_hz=bandwidth,
        quantisation=step,
        dead_zone=dead_zone(received, step),
        peaks=peaks,
        allan_tau_s=taus,
        allan_deviation=deviations,
    )


def _uniform(signal: Signal) -> tuple[Array, Array, float]:
    """The finite samples as they came, the same on an even grid with missing ones bridged, and the grid's step, s."""
    good = np.isfinite(signal.values)
    time, values = signal.time_s[good], signal.values[good]
    if values.size < SHORTEST_SAMPLES:
        raise SignalError(
            f"{signal.source}: {values.size} samples are too few to estimate noise; record {SHORTEST_SAMPLES}"
        )
    if np.ptp(values) == 0.0:
        raise SignalError(f"{signal.source} never changes; the sensor is dead, or its noise is below its step")
    interval = _interval(time)
    if interval <= 0.0:
        raise SignalError(f"{signal.source}: its time stamps do not advance; the noise cannot be estimated")
    places = np.rint((time - time[0]) / interval).astype(np.int64)
    places, first = np.unique(places, return_index=True)
    missing = 1.0 - places.size / (places[-1] + 1)
    if missing > 0.1:
        raise SignalError(f"{signal.source}: {100 * missing:.0f} % of its samples are missing; record it without gaps")
    return values, np.interp(np.arange(places[-1] + 1), places, values[first]), interval


def _interval(time: Array) -> float:
    """Sampling interval, s, of stamps that may be rounded to whole milliseconds and of which some may be missing."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    near = steps[(steps > 0.5 * usual) & (steps < 1.6 * usual)]
    interval = float(near.mean()) if near.size else usual
    for reach in (64, 1024, time.size):
        # Numbers of samples are sure over a short stretch first, then over longer ones.
        part = time[: min(reach, time.size)] - time[0]
        if interval <= 0.0:
            break
        places = np.rint(part / interval)
        spread = places - places.mean()
        interval = float(spread @ part / max(float(spread @ spread), 1e-300))
    return interval


def _periodogram(values: Array, interval: float) -> tuple[Array, Array]:
    """Frequencies, Hz, and two-sided density of the signal under a Hann taper, without the bins next to 0."""
    taper = np.hanning(values.size + 2)[1:-1]
    centred = values - values.mean()
    power = np.abs(np.fft.rfft(centred * taper)) ** 2 * (interval / float((taper**2).sum()))
    frequencies = np.fft.rfftfreq(values.size, interval)
    inside = slice(_FIRST_BIN, power.size - 1)
    return np.asarray(frequencies[inside], dtype=np.float64), np.asarray(power[inside], dtype=np.float64)


def _peaks(frequencies: Array, power: Array, size: int, interval: float) -> tuple[tuple[Peak, ...], NDArray[np.bool_]]:
    """Lines that exceed their neighbourhood by chance once in 1000 records, and the bins without them."""
    half = min(max(16, power.size // 40), max(power.size // 4, 1))
    around = median_filter(power, size=2 * half + 1, mode="reflect") / math.log(2.0)
    # A tapered bin is nearly exponential; neighbours share energy, so the number of independent ones is no larger.
    limit = -math.log(_FALSE_ALARM / power.size)
    loud = power > limit * around
    loud[: half // 2] = False  # drift is not a line
    clean = np.ones(power.size, np.bool_)
    found = []
    resolution = 1.0 / (size * interval)
    for at in np.flatnonzero(loud):
        if power[max(at - 2, 0) : at + 3].max() > power[at]:
            continue
        near = slice(max(at - 2, 0), at + 3)
        excess = float((power[near] - around[near]).sum()) * 2.0 * resolution
        found.append(Peak(float(frequencies[at]), math.sqrt(max(excess, 0.0))))
        clean[max(at - 4, 0) : at + 5] = False
    return tuple(sorted(found, key=lambda peak: -peak.rms)[:10]), clean & ~loud


def _usable(frequencies: Array, power: Array, clean: NDArray[np.bool_], rate: float) -> tuple[float, float | None]:
    """Highest frequency at which the density is the sensor's noise and not its filter's, and the filter's bandwidth."""
    low = clean & (frequencies > rate / 40.0) & (frequencies < rate / 10.0)
    high = clean & (frequencies > 0.4 * rate)
    if not low.any() or not high.any() or power[high].mean() > _ROLL_OFF * power[low].mean():
        return math.inf, None
    reference = power[low].mean()
    edges = np.linspace(rate / 10.0, rate / 2.0, 17)
    bands = [clean & (frequencies >= a) & (frequencies < b) for a, b in pairwise(edges)]
    below = [
        edge for edge, band in zip(edges, bands, strict=False) if band.any() and power[band].mean() < reference / 2
    ]
    return rate / 10.0, float(below[0]) if below else None


def _fit_density(frequencies: Array, power: Array, interval: float) -> tuple[dict[str, tuple[float, float]], bool]:
    """Terms of the density that the periodogram shows, each with its coefficient and standard error.

    And whether the kind of drift can be identified; where it cannot, flicker and random walk are left out.
    """
    shapes = {
        "N": np.ones(frequencies.size),
        "B": 1.0 / (2.0 * math.pi * frequencies),
        "K": (interval / (2.0 * np.sin(math.pi * frequencies * interval))) ** 2,
    }
    starts = _bins(frequencies.size)
    counts = np.diff(np.append(starts, frequencies.size)).astype(np.float64)
    shapes = {term: np.add.reduceat(shape, starts) / counts for term, shape in shapes.items()}
    power = np.add.reduceat(power, starts) / counts
    enough = _EVIDENCE * _TAPER_LOSS
    sets: tuple[tuple[str, ...], ...] = (("N",), ("N", "B"), ("N", "K"), TERMS)
    fits = {terms: _whittle([shapes[term] for term in terms], power, counts) for terms in sets}
    terms = max(sets, key=lambda names: fits[names][1] - enough * len(names))
    # With one kind of drift in the record, the other one must be clearly worse for the name to count.
    rivals = [fits[other][1] for other in sets[1:3] if len(terms) == 2 and other != terms]
    identified = not rivals or fits[terms][1] - rivals[0] > enough
    weights = fits[terms][0]
    chosen = np.array([shapes[term] for term in terms])
    relative = chosen * weights[:, None] / (weights @ chosen) * np.sqrt(counts)
    # Fisher information of the logarithms; the taper correlates neighbours, which counts as fewer bins.
    covariance = inverse(relative @ relative.T) * _TAPER_LOSS
    found = {
        term: (math.sqrt(weight), math.sqrt(weight) * 0.5 * math.sqrt(covariance[i, i]))
        for i, (term, weight) in enumerate(zip(terms, weights, strict=True))
        if term == "N" or identified
    }
    return found, identified


_TAPER_LOSS = 35.0 / 18.0  # sum w^4 n / (sum w^2)^2 of the Hann taper


def _bins(size: int) -> NDArray[np.int64]:
    """Where bins begin: single ones at first, then so wide that the density hardly changes within one."""
    edges = np.unique(np.concatenate((np.arange(32), np.geomspace(32, max(size, 33), 200)))).astype(np.int64)
    return np.unique(edges[edges < size])


def _whittle(shapes: Sequence[Array], power: Array, counts: Array) -> tuple[Array, float]:
    """Weights of the shapes, none below 0, of greatest likelihood, and its logarithm: by Fisher scoring.

    power: (B,) mean periodogram of bins that hold `counts` frequencies each.
    """
    stack = np.array(shapes)
    density = power.copy()
    best, weights = -math.inf, np.zeros(len(shapes))
    for _ in range(_ITERATIONS):
        scale = np.sqrt(counts) / density
        trial, _ = nnls((stack * scale).T, power * scale)
        density = trial @ stack
        if not np.all(density > 0.0):
            break
        likelihood = -float(counts @ (np.log(density) + power / density))
        if likelihood > best:
            weights, gained, best = trial, likelihood - best, likelihood
            if gained < 1e-6:
                break
    return weights, best


def _estimate(
    found: dict[str, tuple[float, float]], identified: bool, term: str, unit: str, duration: float
) -> NoiseEstimate:
    if found.get(term, (0.0, 0.0))[0] > 0.0:
        value, std = found[term]
        if term == "B":  # what people call bias instability is the floor of the Allan deviation
            factor = math.sqrt(2.0 * math.log(2.0) / math.pi)
            return NoiseEstimate(value * factor, std * factor, unit)
        return NoiseEstimate(value, std, unit)
    if not identified:
        return NoiseEstimate(
            None,
            None,
            unit,
            f"it drifts, but {duration:.0f} s do not separate flicker from a random walk; record longer",
        )
    return NoiseEstimate(
        None, None, unit, f"none shows in {duration:.0f} s at rest; record longer to see a smaller one"
    )
