"""Without satellites: how far a flight on the model strays from where the aircraft was, beside one by inertia alone.

The model makes of the forces that the accelerometers feel the angles at which the aircraft meets the air; airspeed,
attitude and those give its velocity through the air, and the wind that was there before carries it on. The wind is a
Kalman filter's: a mean that wanders and gusts with memory (Gauss and Markov), whose sizes are those that the flight
before makes likely (Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, ch. 3 and 6;
dead reckoning by air data ch. 16). The filter's covariance, without measurements, is the ellipse of the drift.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import SegmentError, SignalError
from sysid.numerics.smoothing import fourier_smooth
from sysid.problem.coefficient_residuals import along_path
from sysid.problem.free_run import Fixed
from sysid.signals.flight import FlightData
from sysid.signals.preparation import Prepared, airspeed_gain
from sysid.signals.record import Record, make_records

NEEDED = ("airspeed", "phi", "theta", "psi", "ax", "ay", "az", "p", "q", "r", "vn", "ve")
# Steps of the filter, s. The wind is looked for in so much flight before at most, and in so much at least.
_STEP_S, MOST_BEFORE_S, LEAST_BEFORE_S = 0.5, 180.0, 20.0
# Gusts are over in the mean of so long, s.
_STEADY_S = 10.0
# Gaps of sensors that are bridged, s.
_BRIDGED_S = 2.0
# In flight the airspeed is above this share of its median.
_FLOWN_SHARE = 0.5
# Band in which forces show the mean angles of the flow, Hz; largest angle that is looked for, rad.
_FLOW_HZ, _LARGEST = 2.0, 0.5
_NEWTON_STEPS, _ANGLE_STEP = 6, 1e-3
# A derivative of a force by its angle, m/s^2 per rad, below which it shows none.
_SHOWS = 1.0
# What is usual, and by which factor it varies (1 sigma of the logarithm): standard deviation of gusts along an axis,
# m/s, their memory, s, how far the mean wind wanders in a minute, m/s, and what a mean of GPS velocities is wrong by.
_USUAL = np.log([0.5, 12.0, 0.3, 0.1])
_FACTOR = np.log([2.5, 2.5, 2.5, 3.0])
# What is usual counts as much as so many gusts that were seen.
_SEEN_BEFORE = 4.0
# What is known of the mean wind, m/s, of the airspeed's scale, and of the heading with the flow's side, rad, before the
# flight; the last wanders by so much in a minute.
_WIND_STD, _SCALE_STD, _HEADING_STD, _HEADING_WANDERS = 15.0, 0.03, 0.05, 0.01
# Zeros of accelerometers are those of so much flight before, s.
_ZEROS_S = 60.0
# Chi-square of two degrees of freedom that holds 95 %.
CHI2_95 = 5.991


@dataclass(frozen=True)
class Coast:
    """A stretch without satellites. time_s: (N,) s of the flight. aircraft, by_model, by_inertia: (N, 2) m north and
    east of where it began: by GPS, and as the two coast. covariance: (N, 2, 2) m^2, of `by_model` less `aircraft`.
    wind: north and east, m/s, at its beginning, gusts with it. before_s: length of the flight that the wind comes from.
    """

    time_s: Array
    aircraft: Array
    by_model: Array
    by_inertia: Array
    covariance: Array
    wind: tuple[float, float]
    before_s: float

    @property
    def drift(self) -> Array:
        """(N,) m, of the model."""
        return np.asarray(np.hypot(*(self.by_model - self.aircraft).T))

    @property
    def inertial_drift(self) -> Array:
        """(N,) m, by inertia."""
        return np.asarray(np.hypot(*(self.by_inertia - self.aircraft).T))

    @property
    def distance(self) -> float:
        """What was flown, m."""
        return float(np.sum(np.hypot(*np.diff(self.aircraft, axis=0).T)))

    @property
    def inside(self) -> bool:
        """Whether the drift at the end lies within its 95 % ellipse."""
        off = (self.by_model - self.aircraft)[-1]
        return bool(off @ np.linalg.solve(self.covariance[-1], off) <= CHI2_95)


def coast(flight: Prepared, vehicle: Vehicle, model: Fixed, seconds: float, start_s: float | None = None) -> Coast:
    """Withhold GPS for some time.

    start_s: when, s from the flight's first stamp; so that it ends with the flight without it. Raises SignalError for
    signals that are missing, SegmentError where there is not enough flight before or behind.
    """
    data = flight.data
    missing = [name for name in NEEDED if name not in data]
    if missing:
        raise SignalError(f"{data.name}: coasting needs {', '.join(missing)}, which the recording does not have")
    begin, end = _flown(data)
    first, last = float(data.time_s[begin]), float(data.time_s[end - 1])
    start = last - seconds if start_s is None else start_s
    if not (first + LEAST_BEFORE_S <= start and start + seconds <= last):
        raise SegmentError(
            f"{data.name}: in flight from {first:.0f} to {last:.0f} s: {seconds:g} s from {start:.0f} s on, and"
            f" {LEAST_BEFORE_S:g} s before, are not in it; take less, or another beginning"
        )
    span = (int(np.searchsorted(data.time_s, max(first, start - MOST_BEFORE_S))),
            int(np.searchsorted(data.time_s, start + seconds)) + 1)  # fmt: skip
    (record,) = make_records(data, vehicle, [span])
    part = _bridged(data.window(*span))
    rows = _turned(np.column_stack([part[name] for name in ("phi", "theta", "psi")]))
    speed = part["airspeed"] * flight.layout.airspeed_factor * airspeed_gain(record, flight.layout)
    air = np.einsum("kij,kj->ki", rows, _through_air(part, record, vehicle, model, speed))[:, :2]
    ground = np.column_stack([part["vn"], part["ve"]])
    cut = int(np.searchsorted(part.time_s, start))
    size = max(1, round(_STEP_S / part.interval_s))
    before = _steps(air, ground, cut, size)
    filter_ = _fitted(*before, size * part.interval_s)
    filter_.run(*before)
    filter_.forget_position()
    count = (part.time_s.size - 1 - cut) // size
    places, spread = [np.zeros(2)], [np.zeros((2, 2))]
    for k in range(count):
        at = slice(cut + k * size, cut + (k + 1) * size)
        filter_.carry(air[at].mean(axis=0))
        places.append(filter_.x[:2].copy())
        spread.append(filter_.P[:2, :2].copy())
    kept = cut + size * np.arange(count + 1)
    wind = (float(filter_.wind[0]), float(filter_.wind[1]))
    by_gps = _filled(part, ground, cut)
    return Coast(
        part.time_s[kept], _path(by_gps[cut:], part.interval_s)[: count * size + 1 : size], np.array(places),
        _by_inertia(part, rows, by_gps, cut)[: count * size + 1 : size], _widened(spread, filter_, len(before[0])),
        wind, float(part.time_s[cut] - part.time_s[0]),
    )  # fmt: skip


def _bridged(part: FlightData) -> FlightData:
    """The part with short gaps of its sensors on a line. Raises SegmentError where a gap is long."""
    columns = dict(part.columns)
    for name in NEEDED[:10]:
        there = np.isfinite(part[name])
        times = part.time_s[there]
        gaps = np.diff(np.concatenate([[part.time_s[0]], times, [part.time_s[-1]]]))
        if gaps.max() > _BRIDGED_S:
            raise SegmentError(
                f"{part.name}: {name} has a gap of {gaps.max():.1f} s there; take another beginning with --at"
            )
        # What stands there may be angles that have been unwrapped, or not.
        values = np.unwrap(part[name][there]) if name in ("phi", "psi") else part[name][there]
        columns[name] = np.interp(part.time_s, times, values)
    return replace(part, columns=columns)


def _flown(data: FlightData) -> tuple[int, int]:
    """First sample in flight, and the one behind the last."""
    speed = data["airspeed"]
    usual = float(np.nanmedian(speed[speed > 0.5 * np.nanpercentile(speed, 95.0)]))
    fast = np.flatnonzero(speed > _FLOWN_SHARE * usual)
    return int(fast[0]), int(fast[-1]) + 1


def _turned(angles: Array) -> Array:
    """(N, 3, 3) from body axes to north, east, down. angles: (N, 3) phi, theta, psi, rad."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix())


def _through_air(part: FlightData, record: Record, vehicle: Vehicle, model: Fixed, speed: Array) -> Array:
    """(N, 3) u, v, w, m/s: at the angles at which the model's forces are those that are felt."""
    rates = np.column_stack([part[name] for name in ("p", "q", "r")])
    arm = np.array(vehicle.sensors.accelerometer.position)
    turning = np.cross(rates, np.cross(rates, arm))
    felt = [
        fourier_smooth(part[name] - turning[:, axis], part.interval_s, _FLOW_HZ).values
        for name, axis in (("az", 2), ("ay", 1))
    ]
    flow = np.zeros((speed.size, 2))
    states = np.column_stack([*np.zeros((3, speed.size)), rates, part["phi"], part["theta"], part["psi"]])

    def forces(angles: Array) -> Array:
        states[:, :3] = _body(speed, angles)
        every = along_path(record, states, model)
        return np.column_stack([every[:, 8], every[:, 7]])

    for _ in range(_NEWTON_STEPS):
        here = forces(flow)
        for axis in range(2):
            moved = flow.copy()
            moved[:, axis] += _ANGLE_STEP
            slope = (forces(moved)[:, axis] - here[:, axis]) / _ANGLE_STEP
            shows = np.abs(slope) > _SHOWS
            change = np.where(shows, (felt[axis] - here[:, axis]) / np.where(shows, slope, 1.0), 0.0)
            flow[:, axis] = np.clip(flow[:, axis] + change, -_LARGEST, _LARGEST)
    smooth = np.column_stack([fourier_smooth(one, part.interval_s, _FLOW_HZ).values for one in flow.T])
    return _body(speed, smooth)


def _body(speed: Array, flow: Array) -> Array:
    """(N, 3) u, v, w. speed: (N,) m/s. flow: (N, 2) alpha and beta, rad."""
    alpha, beta = flow.T
    return np.column_stack(
        [speed * np.cos(alpha) * np.cos(beta), speed * np.sin(beta), speed * np.sin(alpha) * np.cos(beta)]
    )


def _steps(air: Array, ground: Array, cut: int, size: int) -> tuple[Array, Array]:
    """(K, 2) of each step before the cut: mean velocity through the air; over ground, NaN where GPS said nothing."""
    count = cut // size
    at = slice(cut - count * size, cut)
    known = ground[at].reshape(count, size, 2)
    said = np.isfinite(known)
    sums = np.where(said, known, 0.0).sum(axis=1)
    means = np.where(said.any(axis=1), sums / np.maximum(said.sum(axis=1), 1), np.nan)
    return air[at].reshape(count, size, 2).mean(axis=1), means


class _WindFilter:
    """Kalman filter of position, wind, gust (each north and east), the airspeed's scale and the heading's offset."""

    def __init__(self, sizes: Array, step_s: float) -> None:
        """sizes: standard deviation of gusts, m/s, their memory, s, wander of the wind in a minute, m/s, and error of a
        mean of GPS velocities, m/s.
        """
        gust, self.memory, wander, self._noise = sizes.tolist()
        self.step_s, self._kept = step_s, float(np.exp(-step_s / self.memory))
        minute = step_s / 60.0
        self._more = np.array([0.0, 0.0, *2 * [wander**2 * minute], *2 * [gust**2 * (1.0 - self._kept**2)], 0.0,
                               _HEADING_WANDERS**2 * minute])  # fmt: skip
        self.x = np.zeros(8)
        self.P = np.diag([0.0, 0.0, *2 * [_WIND_STD**2], *2 * [gust**2], _SCALE_STD**2, _HEADING_STD**2])

    @property
    def wind(self) -> Array:
        """North and east with the gust, m/s."""
        return self.x[2:4] + self.x[4:6]

    def _velocity(self, air: Array) -> Array:
        """(2, 8) velocity over ground by the states, less that through the air."""
        H = np.zeros((2, 8))
        H[0, 2] = H[1, 3] = H[0, 4] = H[1, 5] = 1.0
        H[:, 6], H[:, 7] = air, (-air[1], air[0])
        return H

    def carry(self, air: Array) -> None:
        """A step on. air: (2,) velocity through the air, m/s."""
        F = np.eye(8)
        F[4, 4] = F[5, 5] = self._kept
        F[:2] += self.step_s * self._velocity(air)
        self.x = F @ self.x
        self.x[:2] += self.step_s * air
        self.P = F @ self.P @ F.T + np.diag(self._more)

    def measure(self, air: Array, steady: Array, ground: Array) -> float:
        """GPS says `ground`, (2,) m/s; minus two log likelihoods of that.

        steady: (2,) m/s, mean velocity through the air about then: a gust changes that through the air alone, which is
        no error of the airspeed.
        """
        H = self._velocity(steady)
        left = ground - air - H @ self.x
        S = H @ self.P @ H.T + self._noise**2 * np.eye(2)
        gain = np.linalg.solve(S, H @ self.P).T
        self.x = self.x + gain @ left
        self.P = self.P - gain @ S @ gain.T
        return float(left @ np.linalg.solve(S, left) + np.log(np.linalg.det(S)))

    def run(self, air: Array, ground: Array) -> float:
        """Through the flight before; minus two log likelihoods."""
        cost = 0.0
        for a, steady, g in zip(air, self._steady(air), ground, strict=True):
            if np.isfinite(g).all():
                cost += self.measure(a, steady, g)
            self.carry(a)
        return cost

    def _steady(self, air: Array) -> Array:
        half = round(0.5 * _STEADY_S / self.step_s)
        sums = np.vstack([np.zeros(2), np.cumsum(air, axis=0)])
        k = np.arange(len(air))
        low, high = np.maximum(k - half, 0), np.minimum(k + half + 1, len(air))
        return np.asarray((sums[high] - sums[low]) / (high - low)[:, None])

    def forget_position(self) -> None:
        """Here is the origin."""
        self.x[:2] = 0.0
        self.P[:2] = self.P[:, :2] = 0.0


def _fitted(air: Array, ground: Array, step_s: float) -> _WindFilter:
    """The filter, its sizes the likeliest by the flight before and what is usual."""
    from scipy.optimize import minimize

    def cost(logs: NDArray[np.float64]) -> float:
        return _WindFilter(np.exp(logs), step_s).run(air, ground) + float(np.sum(((logs - _USUAL) / _FACTOR) ** 2))

    simplex = _USUAL + 0.5 * np.vstack([np.zeros(4), np.diag(_FACTOR)])
    found = minimize(
        cost,
        _USUAL,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": 120, "xatol": 0.05, "fatol": 0.1},
    )
    return _WindFilter(np.exp(found.x), step_s)


def _widened(spread: list[Array], fitted: _WindFilter, steps: int) -> Array:
    """(N, 2, 2) covariances, so much wider that ellipses hold what they say: how large gusts are is known from as many
    of them as there were before, in both directions (Hotelling's distribution in place of the normal one).
    """
    from scipy.stats import f

    seen = _SEEN_BEFORE + steps * fitted.step_s / fitted.memory
    return np.array(spread) * (2.0 * float(f.ppf(0.95, 2.0, seen)) / CHI2_95)


def _filled(part: FlightData, ground: Array, cut: int) -> Array:
    """GPS velocities, (N, 2) m/s, between those that came on a line. Raises SegmentError for a long gap from just
    before the cut on: what the drift is held against would be made up.
    """
    said, time_s = np.isfinite(ground).all(axis=1), part.time_s
    late = time_s[said & (time_s >= time_s[cut] - _BRIDGED_S)]
    longest = float(np.max(np.diff(np.concatenate([[time_s[cut]], late[late > time_s[cut]], [time_s[-1]]]))))
    if longest > _BRIDGED_S or not late.size:
        raise SegmentError(f"{part.name}: GPS has a gap of {longest:.1f} s there; take another beginning with --at")
    return np.column_stack([np.interp(time_s, time_s[said], one[said]) for one in ground.T])


def _path(velocity: Array, interval_s: float) -> Array:
    """(N, 2) m from the first sample on."""
    steps = 0.5 * interval_s * (velocity[1:] + velocity[:-1])
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def _by_inertia(part: FlightData, rows: Array, ground: Array, cut: int) -> Array:
    """(N, 2) m: rates and forces integrated from the attitude and velocity at the cut, zeros of gyros and
    accelerometers by attitude and GPS before.
    """
    felt, rates = (np.column_stack([part[n] for n in names]) for names in (NEEDED[4:7], NEEDED[7:10]))
    dt = part.interval_s
    late = slice(max(0, cut - round(_ZEROS_S / dt)), cut)
    # Velocity is linear in what it begins with and in the three zeros of the accelerometers.
    turned = np.einsum("kij,kj->ki", rows[late], felt[late])[:, :2]
    gained, zeros = _path(turned, dt), np.concatenate([[np.zeros((2, 3))], dt * np.cumsum(rows[late, :2], axis=0)[1:]])
    design = np.concatenate([np.tile(np.eye(2), (len(gained), 1)), -zeros.reshape(-1, 3)], axis=1)
    solved = np.linalg.lstsq(design, (ground[late] - gained).reshape(-1), rcond=None)[0]
    own = _turning(rows[late], dt)
    rates = rates[cut:] - (rates[late][:-1] - own).mean(axis=0)
    steps = _small_turns(0.5 * dt * (rates[1:] + rates[:-1]))
    attitude = [rows[cut]]
    for step in steps:
        attitude.append(attitude[-1] @ step)
    forces = np.einsum("kij,kj->ki", np.array(attitude), felt[cut:] - solved[2:])[:, :2]
    return _path(ground[cut] + _path(forces, dt), dt)


def _turning(rows: Array, dt: float) -> Array:
    """(N - 1, 3) rad/s, body axes, of attitudes (N, 3, 3)."""
    from scipy.spatial.transform import Rotation

    steps = np.einsum("kji,kjl->kil", rows[:-1], rows[1:])
    return np.asarray(Rotation.from_matrix(steps).as_rotvec()) / dt


def _small_turns(turns: Array) -> Array:
    """(N, 3, 3) rotations by (N, 3) rad."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(turns).as_matrix())
