"""Moments of a flight at which something may have happened: where a step in lift, drag or pitching best explains it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.numerics.smoothing import fourier_smooth
from sysid.signals.record import OUTPUTS, Record

# Moments looked at in all, and the least time between two that are proposed and of flight before and after each, s.
_LOOKS = 400
_APART_S = 1.0
_NEEDED = ("airspeed", "alpha", "q", "ax", "az")
_BAND_HZ = 8.0  # of pitch rate, well above a small aircraft's short period
# Share of a step that the other regressors must leave for it to be detected.
_OWN_SHARE = 1e-6


def likely_events(records: Sequence[Record], vehicle: Vehicle, count: int) -> list[dict[str, float]]:
    """Up to `count` steps, likeliest first: moment `time` [s] and about how large: `dCL`, `dCD`, `dCm`.

    Forces and pitching over the dynamic pressure are explained by angle of attack, elevator, pitch rate and thrust, all
    flights together; a step from a moment on joins the regressors, and the gain in the log likelihood counts. None
    where the flights lack alpha, q, airspeed or accelerations, or are too short.
    """
    used = [record for record in records if _complete(record)]
    if not used:
        return []
    X = np.concatenate([_regressors(record) for record in used])
    Y = np.concatenate([_forces(record) for record in used])
    time = np.concatenate([record.time_s for record in used])
    scale = np.linalg.norm(X, axis=0)
    basis, _ = np.linalg.qr(X[:, scale > 0.0] / scale[scale > 0.0])
    residual = Y - basis @ (basis.T @ Y)
    power = np.maximum(np.sum(residual**2, axis=0), 1e-300)
    looks = np.linspace(time.min(), time.max(), _LOOKS + 2)[1:-1]
    looks = looks[[is_in_flight(used, float(look)) for look in looks]]
    gains, sizes = np.zeros(looks.size), np.zeros((looks.size, 3))
    for i, look in enumerate(looks):
        step = (time > look).astype(np.float64)
        own = step - basis @ (basis.T @ step)
        size = float(own @ own)
        if size > _OWN_SHARE * step.size:
            share = np.minimum((own @ residual) ** 2 / size / power, 1.0 - 1e-12)
            sizes[i] = own @ residual / size
            gains[i] = -0.5 * step.size * float(np.sum(np.log1p(-share)))
    rho = float(np.mean(np.concatenate([record.rho for record in used])))
    alpha = float(np.mean(X[:, 1]))
    found: list[dict[str, float]] = []
    for i in np.argsort(-gains):
        if len(found) == count or gains[i] <= 0.0:
            break
        if all(abs(looks[i] - other["time"]) >= _APART_S for other in found):
            found.append({"time": float(looks[i]), **_coefficients(sizes[i], vehicle, rho, alpha)})
    return found


def is_in_flight(records: Sequence[Record], moment: float) -> bool:
    """Whether some flight has been flown for a second before a moment [s] and goes on for one after it.

    What changes with the first or last samples is how a record starts or ends.
    """
    spans: dict[str, tuple[float, float]] = {}
    for record in records:
        first, last = spans.get(record.flight, (np.inf, -np.inf))
        spans[record.flight] = min(first, float(record.time_s[0])), max(last, float(record.time_s[-1]))
    return any(first + _APART_S <= moment <= last - _APART_S for first, last in spans.values())


def _coefficients(size: Array, vehicle: Vehicle, rho: float, alpha: float) -> dict[str, float]:
    """Steps of CL, CD and Cm that give steps (3,) of what `_forces` gives, at a mean angle of attack."""
    pressure_area = 0.5 * rho * vehicle.geometry.S
    ahead, down = vehicle.mass.mass / pressure_area * size[:2]
    return {
        "dCL": float(ahead * np.sin(alpha) - down * np.cos(alpha)),
        "dCD": float(-ahead * np.cos(alpha) - down * np.sin(alpha)),
        "dCm": float(size[2] * vehicle.mass.Iyy / (pressure_area * vehicle.geometry.c)),
    }


def _complete(record: Record) -> bool:
    columns = [OUTPUTS.index(name) for name in _NEEDED]
    return record.length > 16 and bool(np.isfinite(record.z[:, columns]).all())


def _regressors(record: Record) -> Array:
    """(N, 8) what forces and pitching usually follow from, over the record's own samples."""
    here = slice(record.start, record.start + record.length)
    airspeed, alpha, q = (record.z[:, OUTPUTS.index(name)] for name in ("airspeed", "alpha", "q"))
    elevator, throttle = record.commands[here, 0], record.commands[here, 3]
    thrust = np.where(np.isfinite(record.thrust[here]), record.thrust[here], throttle) / airspeed**2
    return np.column_stack(
        (np.ones(record.length), alpha, alpha**2, elevator, q / airspeed, thrust, 1.0 / airspeed**2, airspeed)
    )


def _forces(record: Record) -> Array:
    """(N, 3) forward and downward force and pitching acceleration over the square of the airspeed."""
    airspeed, q, ax, az = (record.z[:, OUTPUTS.index(name)] for name in ("airspeed", "q", "ax", "az"))
    pitching = fourier_smooth(np.ascontiguousarray(q), record.interval_s, _BAND_HZ).derivative
    return np.column_stack((ax, az, pitching)) / airspeed[:, None] ** 2
