"""The wind of a flight, by what velocity over ground has beyond the velocity through the air.

Kinematics that take a gust for white noise know the wind to centimetres a second, which no flight of a minute does:
here it is known as well as it scattered, as the scale of the airspeed and the heading let it be distinguished, and as a
wind stays what it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.arrays import Array
from sysid.numerics.normal_equations import inverse
from sysid.signals.preparation import Prepared

# Standard errors of the airspeed's scale, of the heading, rad, and of the flow angle in pitch, rad, beyond what was
# estimated of them.
_SCALE_STD, _HEADING_STD, _PITCH_STD = 0.05, 0.06, 0.03
# Means over so many seconds scatter by themselves.
_BLOCK_S, _LEAST_BLOCKS = 5.0, 3
# A wind over minutes is that of now to a tenth (the intensity of turbulence near the ground), and to so much, m/s.
_WANDERS, _LEAST = 0.1, 0.2
_NAMES = ("wind_north", "wind_east", "wind_down")


def mean_wind(
    flights: Sequence[Prepared], scale: tuple[float, float] | None = None
) -> dict[str, tuple[float, float, str]]:
    """The velocity of the air, by the names of sensor errors: value, standard error, unit.

    Parameters
    ----------
    flights : sequence of Prepared
        With velocity over ground, airspeed and attitude with heading, SI and rad; vanes where there are any.
    scale : tuple of float, optional
        Scale error of the airspeed's reading and its standard error, as estimated, dimensionless.

    Returns
    -------
    dict
        North, east and, with a vane of the angle of attack, down, m/s; empty where a flight lacks what is needed.
    """
    found = [one for flight in flights if (one := _of_one(flight, scale))]
    if len(found) < 2:
        return found[0] if found else {}
    together = {}
    for name in found[0]:
        values, stds = np.array([one[name][:2] for one in found if name in one]).T
        # Each flight has a wind of its own.
        std = np.hypot(np.sqrt(np.mean(stds**2) / values.size), np.std(values, ddof=1))
        together[name] = (float(np.mean(values)), float(std), "m/s")
    return together


def _of_one(flight: Prepared, scale: tuple[float, float] | None) -> dict[str, tuple[float, float, str]]:
    """The same of one flight."""
    parts = _blocks(flight)
    if len(parts) < _LEAST_BLOCKS:
        return {}
    over_ground, through_air = (np.array([one[key] for one in parts]) for key in (0, 1))
    read, read_std = scale or (0.0, _SCALE_STD)
    found: dict[str, tuple[float, float, str]] = {}
    flat = through_air[:, :2]
    across = np.column_stack((-flat[:, 1], flat[:, 0]))
    # d = wind + gain of the airspeed along the flight + heading across it, both with priors.
    count = len(parts)
    rows = np.zeros((2 * count, 4))
    rows[0::2, 0], rows[1::2, 1] = 1.0, 1.0
    rows[:, 2], rows[:, 3] = flat.reshape(-1), across.reshape(-1)
    difference = (over_ground[:, :2] - flat).reshape(-1)
    prior = np.array([0.0, 0.0, 1.0 / read_std**2, 1.0 / _HEADING_STD**2])
    start = np.array([0.0, 0.0, -read / read_std**2, 0.0])
    sigma = 1.0
    for _ in range(3):
        covariance = inverse(rows.T @ rows / sigma**2 + np.diag(prior))
        theta = covariance @ (rows.T @ difference / sigma**2 + start)
        left = difference - rows @ theta
        sigma = max(float(np.sqrt(left @ left / max(2 * count - 4, 1))), _LEAST)
    speed = float(np.hypot(*theta[:2]))
    for i, name in enumerate(_NAMES[:2]):
        found[name] = (float(theta[i]), float(np.hypot(np.sqrt(covariance[i, i]), _WANDERS * speed)), "m/s")
    if "alpha" in flight.data:
        down = over_ground[:, 2] - through_air[:, 2]
        own = max(float(np.std(down, ddof=1)), _LEAST) / np.sqrt(count)
        fast = float(np.mean(np.hypot(flat[:, 0], flat[:, 1])))
        found[_NAMES[2]] = (float(np.mean(down)), float(np.hypot(own, _PITCH_STD * fast)), "m/s")
    return found


def _blocks(flight: Prepared) -> list[tuple[Array, Array]]:
    """Mean velocity over ground and through the air, (3,) north, east, down, of every few seconds of a flight."""
    data = flight.data
    if not all(name in data for name in ("vn", "ve", "vd", "airspeed", "phi", "theta", "psi")):
        return []
    columns: Mapping[str, Array] = data.columns
    nothing = np.zeros(data.time_s.size)
    V = columns["airspeed"] * flight.layout.airspeed_factor
    alpha, beta = (columns.get(name, nothing) for name in ("alpha", "beta"))
    u, v, w = V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha) * np.cos(beta)
    phi, theta, psi = (columns[name] for name in ("phi", "theta", "psi"))
    along = u * np.cos(theta) + (v * np.sin(phi) + w * np.cos(phi)) * np.sin(theta)
    side = v * np.cos(phi) - w * np.sin(phi)
    down = -u * np.sin(theta) + (v * np.sin(phi) + w * np.cos(phi)) * np.cos(theta)
    air = np.column_stack((along * np.cos(psi) - side * np.sin(psi), along * np.sin(psi) + side * np.cos(psi), down))
    ground = np.column_stack([columns[name] for name in ("vn", "ve", "vd")])
    length = max(1, round(_BLOCK_S / data.interval_s))
    found = []
    for begin in range(0, data.time_s.size - length + 1, length):
        here = slice(begin, begin + length)
        good = np.isfinite(ground[here]).all(axis=1) & np.isfinite(air[here]).all(axis=1)
        if np.count_nonzero(good) > 0.5 * length:
            found.append((ground[here][good].mean(axis=0), air[here][good].mean(axis=0)))
    return found
