"""What level flight costs the battery, by a flight's power balance and the drag of a model: endurance and range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs.errors import SettingsError
from sysid.arrays import Array
from sysid.signals.thrust.electric import PrintedPropeller

# What is worked out here, and its unit.
UNITS = {
    "drive_efficiency": "1", "min_battery_power": "W", "min_battery_power_speed": "m/s", "min_energy_per_km": "Wh/km",
    "min_energy_speed": "m/s", "endurance": "min", "range": "km",
}  # fmt: skip
# Windows of a power balance that say how well it is known.
_FEWEST = 20
# Standard deviation of the change of the efficiency with the logarithm of the airspeed, with the propeller's print and
# without: measured propellers leave so much to the law of the former, and the latter has none.
_SHAPE_STD, _SHAPELESS_STD = 0.15, 0.5
_SECONDS_IN_HOUR, _SECONDS_IN_MINUTE, _METRES_IN_KM = 3600.0, 60.0, 1000.0


@dataclass(frozen=True)
class PowerBalance:
    """Steady windows of a flight: (N,) airspeed, density, load (lift over weight), battery's power, W, and how fast
    height and speed together grew, m/s; rest: W, of what is no propulsion. propeller: by its print, None where that is
    not given: then its losses go with the thrust's power.
    """

    airspeed: Array
    density: Array
    load: Array
    power: Array
    gained: Array
    rest: float
    propeller: PrintedPropeller | None

    def needed(self, thrust: Array, airspeed: Array, density: Array) -> Array:
        """(N,) W of the shaft for thrusts, N; without the propeller's print thrust times airspeed."""
        if self.propeller is None:
            return np.asarray(np.maximum(thrust, 0.0) * airspeed)
        return self.propeller.power(thrust, airspeed, density)

    def efficiency(self, level: LevelFlight) -> tuple[float, float]:
        """Share of the battery's power that `needed` finds again, and its standard error."""
        # At the same lift coefficient thrust goes with the load, and airspeed with the root of it.
        heavier = self.load * level.weight_flown / level.weight
        alike = self.airspeed * np.sqrt(self.density / level.density / heavier)
        thrust = heavier * np.interp(alike, level.speed, level.thrust)
        thrust = thrust + level.weight_flown * self.gained / self.airspeed
        given = self.power - self.rest
        asked = self.needed(thrust, self.airspeed, self.density)
        share = float(asked.sum() / given.sum())
        # Of a ratio of sums (Cochran, Sampling Techniques, 3rd ed., 1977, eq. 6.9).
        count = given.size
        spread = float(np.sqrt(np.sum((asked - share * given) ** 2) / (count - 1) / count) / given.mean())
        return share, spread


@dataclass(frozen=True)
class LevelFlight:
    """Thrust, N, at speeds, m/s, of level flight, (M,) each, speeds rising; weight there and as the battery was flown,
    N; density there, kg/m^3.
    """

    speed: Array
    thrust: Array
    weight: float
    weight_flown: float
    density: float


def balance_of(found: Mapping[str, Any] | None, propeller: PrintedPropeller | None) -> PowerBalance | str:
    """That of a result's `battery`, or why there is none. Raises SettingsError for what holds not what it should."""
    if not found:
        return "the battery was not read: have the board log its voltage and current"
    try:
        return _balance(found, propeller)
    except (KeyError, TypeError, ValueError) as error:
        raise SettingsError(
            f"the result's battery does not hold what it should ({type(error).__name__}: {error}): make it again with"
            " gcs identify"
        ) from error


def _balance(found: Mapping[str, Any], propeller: PrintedPropeller | None) -> PowerBalance | str:
    windows: Sequence[Mapping[str, float]] = found["windows"]
    if len(windows) < _FEWEST:
        return f"the battery was read in {len(windows)} steady half seconds with power: it takes {_FEWEST} at least"
    columns = {
        key: np.array([float(one[key]) for one in windows])
        for key in ("airspeed", "air_density", "load", "power", "gained")
    }
    return PowerBalance(
        columns["airspeed"], columns["air_density"], columns["load"], columns["power"], columns["gained"],
        float(found["rest"]), propeller,
    )  # fmt: skip


def electric_figures(
    balance: PowerBalance, level: LevelFlight, luck: tuple[float, float], battery: float | None
) -> dict[str, tuple[float, int]]:
    """Name -> value, and the place in the speeds that it is flown at.

    luck: standard errors by which the efficiency and its change with airspeed are off. battery: Wh. Empty where no drag
    that is one explains the balance.
    """
    share, spread = balance.efficiency(level)
    share += luck[0] * spread
    if not share > 0.0:
        return {}
    speed = level.speed
    bend = luck[1] * (_SHAPELESS_STD if balance.propeller is None else _SHAPE_STD)
    shares = share * (speed / float(balance.airspeed.mean())) ** bend
    power = balance.needed(level.thrust, speed, np.full(speed.size, level.density)) / shares + balance.rest
    longest, farthest = int(np.argmin(power)), int(np.argmin(power / speed))
    per_km = float(power[farthest] / speed[farthest]) * _METRES_IN_KM / _SECONDS_IN_HOUR
    found = {
        "drive_efficiency": (share, int(np.argmin(np.abs(speed - balance.airspeed.mean())))),
        "min_battery_power": (float(power[longest]), longest),
        "min_battery_power_speed": (float(speed[longest]), longest),
        "min_energy_per_km": (per_km, farthest), "min_energy_speed": (float(speed[farthest]), farthest),
    }  # fmt: skip
    if battery is not None:
        minutes = battery * _SECONDS_IN_HOUR / float(power[longest]) / _SECONDS_IN_MINUTE
        found |= {"endurance": (minutes, longest), "range": (battery / per_km, farthest)}
    return found
