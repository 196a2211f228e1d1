"""Signals that no other one determines, against what is possible at all: the density of the air, the thrust."""

from __future__ import annotations

import numpy as np

from sim_vehicle.constants import STANDARD_GRAVITY
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.errors import SignalError
from sysid.signal_check.fault import Mistake
from sysid.signals.preparation import Prepared

# What air can weigh between sea level in the cold and 10 km, kg/m^3.
_DENSITIES = (0.3, 1.7)
# Thrust over weight beyond which no small aircraft goes.
_THRUST_TO_WEIGHT = 5.0
_GRAM_FORCE = STANDARD_GRAVITY / 1000.0


def require_possible_density(flight: Prepared) -> None:
    """Raise SignalError for a density that no air has."""
    typical = float(np.median(np.concatenate([stretch.record.rho for stretch in flight.stretches])))
    if not _DENSITIES[0] < typical < _DENSITIES[1]:
        raise SignalError(
            f"{flight.data.name}: air density is {typical:.3g} kg/m^3, which no air has: give static pressure in Pa and"
            " temperature in K by their scale and offset in [signals], or environment.air_density"
        )


def impossible_thrust(flight: Prepared, vehicle: Vehicle) -> Mistake | None:
    """A thrust that is many times the weight; what it is multiplied with is NaN where no unit explains it."""
    thrust = [stretch.data["thrust"] for stretch in flight.stretches if "thrust" in stretch.data]
    if not thrust:
        return None
    ratio = float(np.nanmedian(np.abs(np.concatenate(thrust)))) / (vehicle.mass.mass * vehicle.environment.gravity)
    if ratio <= _THRUST_TO_WEIGHT:
        return None
    much = f"thrust is {ratio:.0f} times the weight"
    if ratio * _GRAM_FORCE > _THRUST_TO_WEIGHT:
        text = f"{much}: check mass.mass in the vehicle file, and the unit of the thrust"
        return Mistake("thrust", "unit", float("nan"), "N", text, ("thrust",))
    text = f"{much} and looks like gram-force: scale it by {_GRAM_FORCE:.4g} in [signals] of the vehicle file"
    return Mistake("thrust", "unit", _GRAM_FORCE, "gf", text, ("thrust",))
