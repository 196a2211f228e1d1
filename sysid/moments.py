"""Moments of a flight at which something may have happened: where a step in lift, drag or pitching best explains it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.flight import Array
from sysid.records import OUTPUTS, Record
from sysid.smoothing import fourier_smooth

# Moments looked at in all, and the least time between two that are proposed, s.
_LOOKS = 400
_APART_S = 1.0
_NEEDED = ("airspeed", "alpha", "q", "ax", "az")
_BAND_HZ = 8.0
# Share of a step that the other regressors must leave for it to be told.
_OWN_SHARE = 1e-6


def likely_moments(records: Sequence[Record], count: int) -> list[float]:
    """Up to `count` moments [s], likeliest first; [] where the flights lack alpha, q, airspeed or accelerations.

    Forces and pitching over the dynamic pressure are explained by angle of attack, elevator, pitch rate and thrust, all
    flights together; a step from a moment on joins the regressors, and the gain in the log likelihood counts.
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
    gains = np.zeros(looks.size)
    for i, look in enumerate(looks):
        step = (time > look).astype(np.float64)
        own = step - basis @ (basis.T @ step)
        size = float(own @ own)
        if size > _OWN_SHARE * step.size:
            share = np.minimum((own @ residual) ** 2 / size / power, 1.0 - 1e-12)
            gains[i] = -0.5 * step.size * float(np.sum(np.log1p(-share)))
    found: list[float] = []
    for i in np.argsort(-gains):
        if len(found) == count or gains[i] <= 0.0:
            break
        if all(abs(looks[i] - other) >= _APART_S for other in found):
            found.append(float(looks[i]))
    return found


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
