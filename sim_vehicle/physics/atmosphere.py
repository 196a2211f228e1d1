"""International Standard Atmosphere, troposphere and lower stratosphere, in closed form.

Source: ICAO Doc 7488/3 (the same constants as the U.S. Standard Atmosphere 1976 below 20 km). Altitudes are
geopotential; below 1 km the geometric altitude differs from it by less than 0.16 m.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_vehicle.constants import GAS_CONSTANT, SEA_LEVEL_DENSITY, STANDARD_GRAVITY

Array = NDArray[np.float64]

SEA_LEVEL_PRESSURE = 101325.0  # Pa
SEA_LEVEL_TEMPERATURE = 288.15  # K
LAPSE_RATE = 0.0065  # K/m, downwards positive
TROPOPAUSE = 11000.0  # m
_TROPOPAUSE_TEMPERATURE = SEA_LEVEL_TEMPERATURE - LAPSE_RATE * TROPOPAUSE
_EXPONENT = STANDARD_GRAVITY / (GAS_CONSTANT * LAPSE_RATE)
_TROPOPAUSE_PRESSURE = SEA_LEVEL_PRESSURE * (_TROPOPAUSE_TEMPERATURE / SEA_LEVEL_TEMPERATURE) ** _EXPONENT
_SCALE_HEIGHT = GAS_CONSTANT * _TROPOPAUSE_TEMPERATURE / STANDARD_GRAVITY


def temperature(altitude: ArrayLike) -> Array:
    """Air temperature at a geopotential altitude.

    Parameters
    ----------
    altitude : ArrayLike, any shape
        Geopotential altitude, m (up to 20 km).

    Returns
    -------
    Array, shape of `altitude`
        Air temperature, K.
    """
    h = np.asarray(altitude, dtype=np.float64)
    return np.asarray(SEA_LEVEL_TEMPERATURE - LAPSE_RATE * np.minimum(h, TROPOPAUSE))


def pressure(altitude: ArrayLike) -> Array:
    """Static pressure at a geopotential altitude.

    Parameters
    ----------
    altitude : ArrayLike, any shape
        Geopotential altitude, m (up to 20 km).

    Returns
    -------
    Array, shape of `altitude`
        Static pressure, Pa.
    """
    h = np.asarray(altitude, dtype=np.float64)
    below = SEA_LEVEL_PRESSURE * (temperature(h) / SEA_LEVEL_TEMPERATURE) ** _EXPONENT
    above = _TROPOPAUSE_PRESSURE * np.exp(-(np.maximum(h, TROPOPAUSE) - TROPOPAUSE) / _SCALE_HEIGHT)
    return np.asarray(np.where(h <= TROPOPAUSE, below, above))


def density(altitude: ArrayLike) -> Array:
    """Air density at a geopotential altitude.

    Parameters
    ----------
    altitude : ArrayLike, any shape
        Geopotential altitude, m (up to 20 km).

    Returns
    -------
    Array, shape of `altitude`
        Air density, kg/m^3.

    References
    ----------
    ICAO Doc 7488/3 (the same constants as the U.S. Standard Atmosphere 1976 below 20 km).
    """
    return np.asarray(pressure(altitude) / (GAS_CONSTANT * temperature(altitude)))


def air_at(altitude: float) -> tuple[float, float, float]:
    """Temperature, K, static pressure, Pa, and density, kg/m^3, at one geopotential `altitude`, m (up to 20 km).

    The same as `temperature`, `pressure` and `density`, for a loop that asks for one altitude at a time.
    """
    kelvin = SEA_LEVEL_TEMPERATURE - LAPSE_RATE * min(altitude, TROPOPAUSE)
    if altitude <= TROPOPAUSE:
        pascal = SEA_LEVEL_PRESSURE * (kelvin / SEA_LEVEL_TEMPERATURE) ** _EXPONENT
    else:
        pascal = _TROPOPAUSE_PRESSURE * math.exp(-(altitude - TROPOPAUSE) / _SCALE_HEIGHT)
    return kelvin, pascal, pascal / (GAS_CONSTANT * kelvin)


def pressure_altitude(static_pressure: ArrayLike) -> Array:
    """Geopotential altitude, m, at which the standard atmosphere has `static_pressure`, Pa."""
    p = np.asarray(static_pressure, dtype=np.float64)
    below = SEA_LEVEL_TEMPERATURE / LAPSE_RATE * (1.0 - (p / SEA_LEVEL_PRESSURE) ** (1.0 / _EXPONENT))
    above = TROPOPAUSE - _SCALE_HEIGHT * np.log(np.minimum(p, _TROPOPAUSE_PRESSURE) / _TROPOPAUSE_PRESSURE)
    return np.asarray(np.where(p >= _TROPOPAUSE_PRESSURE, below, above))


def dynamic_pressure(calibrated_airspeed: ArrayLike) -> Array:
    """Differential pressure, Pa, of a pitot tube at `calibrated_airspeed`, m/s; odd, incompressible.

    Below 30 m/s compressibility adds less than 0.2 %, and the calibration of section "pitot" leaves it out
    alike.
    """
    v = np.asarray(calibrated_airspeed, dtype=np.float64)
    return np.asarray(0.5 * SEA_LEVEL_DENSITY * v * np.abs(v))
