"""Signals of a flight of which position and attitude were seen from outside: motion capture, visual odometry.

Velocity, acceleration and turning are those of smoothed series (Morelli's global Fourier smoothing); the air stands
still, or moves as it is said to, so that velocity gives airspeed and flow angles. What an accelerometer would read is
the acceleration less gravity, in body axes (Groves, eq. 5.17).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sim_vehicle.constants import STANDARD_GRAVITY
from sysid.arrays import Array
from sysid.errors import TableError
from sysid.numerics.smoothing import fourier_smooth

FRAMES = ("ned", "enu")
# Poses that a flight has at least, and so many a second.
_FEWEST, _SLOWEST_HZ = 50, 20.0
# Longest time without a pose that is bridged, s; a longer one would be made up.
_BRIDGED_S = 0.2
# Band of the motion, Hz: what is slower always counts, what is faster never does.
_LEAST_HZ, _MOST_HZ = 3.0, 15.0
# From east, north, up to north, east, down, and from forward, left, up to forward, right, down.
_EARTH = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_BODY = np.diag([1.0, -1.0, -1.0])
# Below this speed nothing flies, m/s; so much of it must be along the nose.
_SLOWEST, _ALONG = 1.0, 0.7
# In a bank gravity pulls sideways, and no aircraft holds itself against that: a side force of more than this share of
# it, where banks go so far (rad), is gravity in another direction.
_HELD_SHARE, _BANKED = 1.0, 0.02


def signals_of_pose(
    time_s: ArrayLike,
    position: ArrayLike,
    quaternion: ArrayLike,
    frame: str = "ned",
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> dict[str, Array]:
    """Signals at even steps of time.

    Parameters
    ----------
    time_s : ArrayLike, shape (N,)
        When, s, rising.
    position : ArrayLike, shape (N, 3)
        m: north, east, down, or what the frame says; NaN where it was not seen.
    quaternion : ArrayLike, shape (N, 4)
        Scalar, x, y, z, from body axes to those.
    frame : str
        "ned": body axes forward, right, down; "enu": east, north, up, and forward, left, up (REP 103).
    wind : tuple[float, float, float]
        Velocity of the air, north, east, down, m/s.

    Returns
    -------
    dict[str, Array]
        "time" and p, q, r, phi, theta, psi, ax, ay, az, true_airspeed, alpha, beta, vn, ve, vd, each (M,), s, rad,
        rad/s, m/s, m/s^2.

    Raises
    ------
    TableError
        In one line, for shapes that do not go together, too few poses or a long gap, and for a motion that no aircraft
        makes in these axes.
    """
    from scipy.interpolate import PchipInterpolator
    from scipy.spatial.transform import Rotation, Slerp

    air = np.asarray(wind, dtype=np.float64)
    if air.shape != (3,) or not np.isfinite(air).all():
        raise TableError(f"wind: {wind!r} is no velocity; give north, east, down in m/s")
    if frame not in FRAMES:
        raise TableError(f"frame: {frame!r} is none of {', '.join(FRAMES)}")
    t, at, turned = (np.asarray(one, dtype=np.float64) for one in (time_s, position, quaternion))
    if t.ndim != 1 or at.shape != (t.size, 3) or turned.shape != (t.size, 4):
        raise TableError(
            f"pose: time {t.shape}, position {at.shape} and quaternion {turned.shape} do not go together: (N,), (N, 3)"
            " and (N, 4) are wanted"
        )
    good = np.isfinite(t) & np.isfinite(at).all(axis=1) & (np.abs(np.linalg.norm(turned, axis=1) - 1.0) < 0.1)
    # A stamp far ahead of those that follow is a stray one; so is one that is not behind all that came before.
    good &= t <= np.minimum.accumulate(np.where(good, t, np.inf)[::-1])[::-1]
    good[1:] &= t[1:] > np.maximum.accumulate(np.where(good, t, -np.inf))[:-1]
    t, at, turned = t[good], at[good], turned[good]
    if t.size < _FEWEST:
        raise TableError(f"pose: {t.size} poses are known; a flight has {_FEWEST} or more")
    step, longest = float(np.median(np.diff(t))), float(np.max(np.diff(t)))
    if 1.0 / step < _SLOWEST_HZ:
        raise TableError(f"pose: {1.0 / step:.1f} poses a second are too few; {_SLOWEST_HZ:g} or more are wanted")
    if longest > _BRIDGED_S:
        where = float(t[np.argmax(np.diff(t))])
        raise TableError(
            f"pose: {longest:.2f} s without a pose from {where:.2f} s on: give the parts before and behind"
        )
    even = np.arange(t[0], t[-1] + 0.5 * step, step).clip(max=t[-1])
    rotation = Slerp(t, Rotation.from_quat(turned[:, [1, 2, 3, 0]]))(even)
    places, rows = PchipInterpolator(t, at)(even), rotation.as_matrix()
    if frame == "enu":
        places, rows = places @ _EARTH.T, _EARTH @ rows @ _BODY
    cutoff = _cutoff(places, step)
    velocity = _slope(places, step, cutoff)
    felt = _slope(velocity, step, cutoff) - np.array([0.0, 0.0, STANDARD_GRAVITY])
    between = np.einsum("kji,kjl->kil", rows[:-1], rows[1:])
    turning = Rotation.from_matrix(between).as_rotvec() / step
    middle = 0.5 * (turning[1:] + turning[:-1])
    raw = np.vstack([turning[:1], middle, turning[-1:]])
    rates = np.column_stack([fourier_smooth(one, step, _cutoff(raw, step)).values for one in raw.T])
    psi, theta, phi = np.unwrap(Rotation.from_matrix(rows).as_euler("ZYX"), axis=0).T
    force = np.einsum("kji,kj->ki", rows, felt)
    u, v, w = np.einsum("kji,kj->ki", rows, velocity - air).T
    speed = np.sqrt(u**2 + v**2 + w**2)
    _check(u, speed, force, phi, frame)
    return {
        "time": even, "p": rates[:, 0], "q": rates[:, 1], "r": rates[:, 2], "phi": phi, "theta": theta, "psi": psi,
        "ax": force[:, 0], "ay": force[:, 1], "az": force[:, 2], "true_airspeed": speed, "alpha": np.arctan2(w, u),
        "beta": np.arcsin(np.clip(v / np.maximum(speed, 1e-6), -1.0, 1.0)),
        "vn": velocity[:, 0], "ve": velocity[:, 1], "vd": velocity[:, 2],
    }  # fmt: skip


def _cutoff(columns: Array, step: float) -> float:
    """One for all columns, Hz: that of the one in which noise begins last, in the band of the motion."""
    found = max(fourier_smooth(one, step).cutoff_hz for one in columns.T)
    return float(np.clip(found, _LEAST_HZ, min(_MOST_HZ, 0.4 / step)))


def _slope(columns: Array, step: float, cutoff_hz: float) -> Array:
    return np.column_stack([fourier_smooth(one, step, cutoff_hz).derivative for one in columns.T])


def _check(u: Array, speed: Array, force: Array, phi: Array, frame: str) -> None:
    """TableError for a motion that shows the axes to be others than they are said to be."""
    flying = speed > max(_SLOWEST, 0.5 * float(np.median(speed)))
    if np.median(speed) < _SLOWEST:
        raise TableError(f"pose: {np.median(speed):.2f} m/s at the median: nothing flies so slowly; is position in m?")
    if np.mean(u[flying]) < _ALONG * np.mean(speed[flying]):
        raise TableError(
            "pose: it does not fly along its nose (x of the body): the quaternion turns the other way (from earth to"
            " body), or has its scalar last, or other body axes"
        )
    other = "enu" if frame == "ned" else "ned"
    if np.mean(force[flying, 2]) > 0.0:
        raise TableError(f'pose: it hangs from its wings, as upside down: z of the body points up; try frame="{other}"')
    bank = np.sin(phi[flying])
    bank = bank - np.mean(bank)
    if np.std(bank) > _BANKED:
        held = float(bank @ force[flying, 1] / (bank @ bank)) / STANDARD_GRAVITY
        if abs(held) > _HELD_SHARE:
            raise TableError(
                f'pose: banked right it is pulled to the left: try frame="{other}", or one of its axes is mirrored'
            )
