"""Second sensors of a kind: the one table from which the simulator flies them, the estimator averages them with the
first, and recordings and tables know them. A new one is a row here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Place = tuple[float, float, float]
Rates = tuple[float | Array, float | Array, float | Array]


@dataclass(frozen=True)
class SecondSensor:
    """A sensor beside the first of its kind. of: the signal that the first gives. first, key: what the two are called
    under [sensors] of the vehicle file. unit: SI.
    """

    of: str
    first: str
    key: str
    unit: str


#: Signal of the second sensor -> what it is. It comes as NAMED_VALUE_FLOAT of that name, 10 characters at most.
SECOND_SENSORS: Mapping[str, SecondSensor] = {
    "alpha2": SecondSensor("alpha", "alpha_vane", "alpha2_vane", "rad"),
    "beta2": SecondSensor("beta", "beta_vane", "beta2_vane", "rad"),
    "airspeed2": SecondSensor("airspeed", "airspeed", "airspeed2", "m/s"),
}


def by_place(signal: str, place: Place, rates: Rates, speed: float | Array) -> float | Array:
    """What a sensor reads more because it sits away from the centre of gravity, to first order.

    Parameters
    ----------
    signal : str
        Signal that it gives.
    place : tuple of three float
        x, y, z from the centre of gravity, m, body axes.
    rates : tuple of three float or Array, shape (N,)
        p, q, r, rad/s.
    speed : float or Array, shape (N,)
        True airspeed, m/s.

    Returns
    -------
    float or Array, shape (N,)
        rad of a vane, m/s of an airspeed, 0 of what does not hang on its place.

    References
    ----------
    Jolly, Unhelkar & Arya, section III; the velocity at a place is that of the centre of gravity plus rates cross
    place.
    """
    (x, y, z), (p, q, r) = place, rates
    if signal == "alpha":
        return (y * p - x * q) / speed
    if signal == "beta":
        return (x * r - z * p) / speed
    if signal == "airspeed":
        return q * z - r * y
    return 0.0
