"""Noise taken off measured inputs, which a simulation would otherwise feel as rough air.

Which way a sensor with free play was moving, from its reading alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft, linalg

from sysid.arrays import Array
from sysid.numerics.filters import first_order_lag
from sysid.numerics.smoothing import fourier_smooth, noise_sigma

# Motor lags tried when measured thrust is explained by the throttle, s.
_LAGS_S = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.5)
_LAG_TURNS, _LAG_FOUND_S = 12, 1e-5
# Terms of the series of the slow swings whose own noise is carried on as doubts: an aircraft's speed averages the
# quicker ones out.
DOUBTED_TERMS = 8

# Loads turn in this band. A reading has moved when it has gone further than the noise does, in standard deviations.
_BAND_HZ = 4.0
_MOVED = 4.0
_FEWEST = 16  # samples that can be smoothed
_SURE = 0.9


@dataclass(frozen=True)
class AirspeedLaw:
    """Thrust away from the airspeed `about` [m/s]: slope [N s/m] times the difference, bend [N s2/m2] its square."""

    about: float
    slope: float
    bend: float

    def falls(self, airspeed: Array) -> bool:
        """Whether thrust falls with the airspeed all over the range of `airspeed`."""
        ends = np.array([airspeed.min(), airspeed.max()]) - self.about
        return bool(np.all(self.slope + 2.0 * self.bend * ends < 0.0))

    def along(self, airspeed: Array) -> Array:
        """What it adds at each airspeed (N,), N."""
        faster = airspeed - self.about
        return np.asarray((self.slope + self.bend * faster) * faster)


@dataclass(frozen=True)
class Passed:
    """Noise of a measured input that its smoothing lets pass: as white as the sensor's, up to a frequency.

    sigma: its standard deviation, 0 where there is none. memory_s: s, of the first-order process of that size and of
    the sensor's spectral density at low frequencies. terms: of the series that it came through. doubted: rows at the
    end of the doubts that are of the same noise.
    """

    sigma: float = 0.0
    memory_s: float = 0.0
    terms: int = 0
    doubted: int = 0


NO_NOISE = Passed()


@dataclass(frozen=True)
class Denoised:
    """A measured input without its noise.

    values: (N,). doubt: (K, N) independent errors that are left in it, each of one standard deviation; K may be 0.
    Those that are also in `noise`, its level and slowest swings above all, come last.
    law: what of it the airspeed explains, None if nothing. noise: what of the sensor's noise passed the smoothing.
    """

    values: Array
    doubt: Array
    law: AirspeedLaw | None = None
    noise: Passed = NO_NOISE

    @property
    def by_airspeed(self) -> bool:
        """Whether the airspeed explains a part of it."""
        return self.law is not None


def smooth_series(values: Array, max_share: float = 0.5) -> Array:
    """The cosine series of `values` (N,) cut where further terms are noise (Bayesian information criterion).

    A constant in noise becomes its mean: what is kept at low frequency would make a simulated aircraft drift.
    """
    if not np.any(values):
        return np.zeros(values.size)
    coefficients = fft.dct(values, norm="ortho")
    coefficients[_terms(values, coefficients, max_share) :] = 0.0
    return np.ascontiguousarray(fft.idct(coefficients, norm="ortho"))


def _terms(values: Array, coefficients: Array, max_share: float) -> int:
    """How many terms of the cosine series of `values` are above the noise."""
    n = values.size
    power = np.concatenate((np.cumsum(coefficients[::-1] ** 2)[::-1][1:], [0.0]))
    limit = max(1, int(max_share * n))
    floor = 1e-24 * max(float(np.max(values**2)), 1e-300)
    criterion = n * np.log(np.maximum(power / n, floor)) + np.arange(1, n + 1) * np.log(n)
    return int(np.argmin(criterion[:limit])) + 1


def denoised_thrust(thrust: Array, throttle: Array, interval_s: float, airspeed: Array | None = None) -> Denoised:
    """Measured thrust with its noise taken off, and what that leaves uncertain.

    Uncertain are the level, gain and lag of the throttle's share, and slow swings. What a lagged throttle explains is
    taken as it is, so that its steps stay sharp; the rest is smoothed. A propeller pulls less the faster it flies:
    where airspeed explains thrust, its first two powers take the place of the many slow swings that would else be
    needed.

    Parameters
    ----------
    thrust : Array, shape (N,)
        Thrust as measured, N, or the propeller's speed, 1/min. Fewer than 16 samples, one that is not finite, or a
        constant come back unchanged.
    throttle : Array, shape (N,)
        Throttle, dimensionless.
    interval_s : float
        Sample interval, s.
    airspeed : Array, shape (N,), or None
        Airspeed as measured, m/s; None where there is none.

    Returns
    -------
    Denoised
        Thrust without its noise, (N,), and the independent errors left in it, (K, N), each of one standard deviation,
        both in the unit of `thrust`; what of it the airspeed explains; and what noise passed the smoothing.
    """
    thrust = np.asarray(thrust, dtype=np.float64)
    if thrust.size < 16 or not np.isfinite(thrust).all() or np.ptp(thrust) == 0.0:
        return Denoised(np.ascontiguousarray(thrust), np.zeros((0, thrust.size)))
    n = thrust.size
    known = _smooth_airspeed(airspeed, n, interval_s)
    explained, design, law = _explained(thrust, throttle, interval_s, known)
    rest = thrust - explained
    values = explained + smooth_series(rest)
    kept = _terms(rest, fft.dct(rest, norm="ortho"), 0.5) if np.any(rest) else 1
    explaining = design.shape[1]
    swings = fft.idct(np.eye(min(kept, DOUBTED_TERMS), n)[1:], norm="ortho").T
    own, shared = _last_of_series(_basis(design), kept)
    rest_of_swings = _basis(swings - own @ (own.T @ swings), 1.0)
    basis = np.hstack([own, rest_of_swings])
    doubted = shared + rest_of_swings.shape[1]
    fitted = kept + explaining - 1  # the series has a level, and so has the explanation
    sigma = float(np.sqrt(np.sum((thrust - values) ** 2) / max(n - fitted, 1)))
    passed = Passed(sigma * float(np.sqrt(kept / n)), 0.5 * interval_s * n / kept, kept, doubted)
    return Denoised(np.ascontiguousarray(values), np.ascontiguousarray(sigma * basis.T), law, passed)


def _basis(columns: Array, size: float = 0.0) -> Array:
    """Orthonormal columns (N, at most K) that span what K columns (N, K) do.

    size: of a column, a billionth of which is a rounding error; at least that of the largest.
    """
    if columns.shape[1] == 0:
        return columns
    basis, sizes, _ = linalg.qr(columns, mode="economic", pivoting=True)
    return np.asarray(basis[:, np.abs(np.diag(sizes)) > 1e-9 * max(size, float(np.abs(sizes[0, 0])))])


def _last_of_series(basis: Array, terms: int) -> tuple[Array, int]:
    """Orthonormal columns (N, K) turned so that those come last that the first `terms` of a cosine series have too, and
    how many of them are more in that series than outside it.
    """
    shares, turn = np.linalg.svd(fft.dct(basis, axis=0, norm="ortho")[:terms])[1:]
    return np.asarray(basis @ turn[::-1].T), int(np.sum(shares**2 > 0.5))


def _smooth_airspeed(airspeed: Array | None, count: int, interval_s: float) -> Array:
    """The airspeed without its noise, (N, 1); (N, 0) where there is none that moves."""
    if airspeed is None or not np.isfinite(airspeed).all() or np.ptp(airspeed) == 0.0:
        return np.zeros((count, 0))
    return fourier_smooth(airspeed, interval_s).values[:, None]


def _explained(
    thrust: Array, throttle: Array, interval_s: float, airspeed: Array
) -> tuple[Array, Array, AirspeedLaw | None]:
    """What airspeed and throttle explain of thrust, (N,), what is uncertain of that, (N, unknowns), and the airspeed's
    share.

    Two powers of the airspeed, and the throttle behind its lag, count where the Bayesian information criterion asks for
    them. Where the airspeed counts it is a propeller that pulls, and a throttle that moves counts as well: swings of
    it that are too small to be seen would else be mistaken for drag, which they moved by two standard errors.
    """
    n = thrust.size
    best: tuple[Array, Array, AirspeedLaw | None] = (thrust, np.ones((n, 1)), None)
    least = np.inf
    for air in (airspeed[:, :0], airspeed) if airspeed.shape[1] else (airspeed,):
        about, spread = (float(air.mean()), max(float(air.std()), 1e-9)) if air.size else (0.0, 1.0)
        scaled = (air - about) / spread
        powers = np.hstack([scaled, scaled**2])
        explanations = _explanations(throttle, interval_s, thrust, powers)
        for explanation in explanations[-1:] if air.size else explanations:
            # Gain, lag and start of the throttle's share count for three.
            unknowns = powers.shape[1] + (3 if explanation.throttle else 0)
            gains = np.linalg.lstsq(explanation.regressors, thrust, rcond=None)[0]
            fitted = explanation.regressors @ gains
            power = max(float(np.mean((thrust - fitted) ** 2)), 1e-300)
            criterion = n * np.log(power) + unknowns * np.log(n)
            if criterion < least:
                # The powers of the airspeed are the last regressors.
                law = AirspeedLaw(about, float(gains[-2]) / spread, float(gains[-1]) / spread**2) if air.size else None
                if law is not None and not law.falls(air):
                    continue  # power that made the aircraft faster, not the other way round
                least, best = criterion, (fitted, explanation.uncertain, law)
    return best


@dataclass(frozen=True)
class _Explanation:
    """A way to explain thrust: its regressors (N, K), what is uncertain of it (N, L), whether the throttle counts."""

    regressors: Array
    uncertain: Array
    throttle: bool


def _explanations(throttle: Array, interval_s: float, thrust: Array, air: Array) -> list[_Explanation]:
    """Powers of the airspeed (N, k) without and with the throttle behind its likeliest lag."""
    alone = np.column_stack([np.ones(throttle.size), air])
    found = [_Explanation(alone, alone, False)]
    if np.ptp(throttle) > 1e-6:
        lag_s = _likeliest_lag(thrust, throttle, interval_s, air)
        regressors = uncertain = np.column_stack([_regressors(throttle, interval_s, lag_s), air])
        if lag_s is not None and lag_s >= 1e-6:
            longer = _lagged(throttle, interval_s, 1.05 * lag_s) - _lagged(throttle, interval_s, 0.95 * lag_s)
            uncertain = np.column_stack([regressors, longer])
        found.append(_Explanation(regressors, uncertain, True))
    return found


def _likeliest_lag(thrust: Array, throttle: Array, interval_s: float, air: Array) -> float | None:
    """Lag of the motor, s, behind the throttle; None where thrust shows the throttle of its own sample."""

    def at(lag_s: float | None) -> Array:
        return np.column_stack([_regressors(throttle, interval_s, lag_s), air])

    def error(lag_s: float | None) -> float:
        regressors = at(lag_s)
        return float(np.mean((thrust - regressors @ _gains(thrust, regressors)) ** 2))

    tried = (None, *_LAGS_S)
    errors = [error(lag_s) for lag_s in tried]
    first = int(np.argmin(errors))
    coarse = tried[first]
    if coarse is None or coarse == 0.0:
        return coarse
    # The lags tried are coarse; between its neighbours the best one has a single minimum, to which Gauss-Newton leads.
    low, high = _LAGS_S[first - 2], _LAGS_S[min(first, len(_LAGS_S) - 1)]
    lag_s = coarse
    for _ in range(_LAG_TURNS):
        regressors, step_s = at(lag_s), 0.05 * lag_s
        slope = (at(lag_s + step_s) - at(lag_s - step_s)) @ _gains(thrust, regressors) / (2.0 * step_s)
        change = float(_gains(thrust, np.column_stack([regressors, slope]))[-1])
        before, lag_s = lag_s, float(np.clip(lag_s + change, max(low, 0.1 * coarse), high))
        if abs(lag_s - before) < _LAG_FOUND_S:
            break
    return lag_s if error(lag_s) <= errors[first] else coarse


def _regressors(throttle: Array, interval_s: float, lag_s: float | None) -> Array:
    """Level, lagged throttle, and what the command before the first sample left under way, (N, 2 or 3)."""
    columns = [np.ones(throttle.size), _lagged(throttle, interval_s, lag_s)]
    if lag_s is not None:
        columns.append(np.exp(-interval_s * np.arange(throttle.size) / max(lag_s, 1e-6)))
    return np.column_stack(columns)


def _gains(thrust: Array, regressors: Array) -> Array:
    """What each regressor counts for in thrust, by least squares, near enough to rank lags by."""
    squares = regressors.T @ regressors
    return np.asarray(np.linalg.lstsq(squares, regressors.T @ thrust, rcond=1e-13)[0], dtype=np.float64)


def _lagged(command: Array, interval_s: float, lag_s: float | None) -> Array:
    """A command held from each sample on, after a first-order lag, as seen at the samples; None: seen at once."""
    if lag_s is None:
        return command
    before = np.concatenate((command[:1], command[:-1]))
    if lag_s < 1e-6:
        return before
    decay = float(np.exp(-interval_s / lag_s))
    return first_order_lag(before, decay, float(command[0]))


def way_of(reading: Array, interval_s: float) -> Array:
    """The way in which a reading moves.

    The way in which it came, seen forwards in time, holds until the reading has left a turn; that in which it goes on,
    seen backwards, holds from where it came into the turn. Where both agree it moves.

    Parameters
    ----------
    reading : Array, shape (N,)
        In any unit.
    interval_s : float
        Sample interval, s.

    Returns
    -------
    Array, shape (N,)
        1 where the reading rises, -1 where it falls, dimensionless, and on a straight line between where it stands.
    """
    if reading.size < _FEWEST or np.ptp(reading) == 0.0:
        return np.zeros(reading.size)
    smooth = fourier_smooth(reading, interval_s, _BAND_HZ).values
    noise = noise_sigma(reading, interval_s) * float(np.sqrt(min(2.0 * _BAND_HZ * interval_s, 1.0)))
    moved = max(_MOVED * noise, 1e-3 * float(np.ptp(smooth)))
    way = 0.5 * (_way_come(smooth, moved) - _way_come(smooth[::-1], moved)[::-1])
    sure = np.abs(way) > _SURE
    places = np.arange(way.size)
    return np.interp(places, places[sure], way[sure]) if sure.any() else np.zeros(way.size)


def _way_come(values: Array, moved: float) -> Array:
    """(N,) which way values have come, -1 to 1: how far they are ahead of a play of full width `moved` behind them."""
    behind = []
    follower, half = float(values[0]), 0.5 * moved
    for low, high in zip((values - half).tolist(), (values + half).tolist(), strict=True):
        if follower < low:
            follower = low
        elif follower > high:
            follower = high
        behind.append(follower)
    return np.asarray((values - np.array(behind)) / half, dtype=np.float64)
