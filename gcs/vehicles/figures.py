"""What follows from a vehicle file: figures by which a person sees that a unit is wrong."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.vehicle_file import Vehicle

# A wing of no special profile flies up to about this lift coefficient.
_LARGEST_LIFT = 1.2


@dataclass(frozen=True)
class Figure:
    """One figure: what it is, its value and unit, and between what it lies for small aircraft that fly."""

    name: str
    value: float
    unit: str
    usual: tuple[float, float]

    @property
    def is_usual(self) -> bool:
        """Whether it lies where those of small aircraft lie."""
        return self.usual[0] <= self.value <= self.usual[1]


def figures(vehicle: Vehicle) -> list[Figure]:
    """Figures of an aircraft, from its wing to its motor. What is usual: models of 0.5 to 3 m that are flown."""
    mass, geometry = vehicle.mass, vehicle.geometry
    weight = mass.mass * vehicle.environment.gravity
    density = vehicle.environment.air_density or SEA_LEVEL_DENSITY
    found = [
        Figure("wing loading", weight / geometry.S, "N/m^2", (10.0, 300.0)),
        Figure("aspect ratio", geometry.b**2 / geometry.S, "", (3.0, 25.0)),
        Figure("area over span times chord", geometry.S / (geometry.b * geometry.c), "", (0.6, 1.2)),
        Figure("stalls at about", math.sqrt(2.0 * weight / (density * geometry.S * _LARGEST_LIFT)), "m/s", (3.0, 25.0)),
        Figure(
            "lift coefficient in level flight", 2.0 * weight / (density * geometry.S * vehicle.flight.airspeed**2), "",
            (0.1, 1.0),
        ),
    ]  # fmt: skip
    for key, usual in (("Ixx", (0.06, 0.25)), ("Iyy", (0.08, 0.3)), ("Izz", (0.1, 0.35))):
        radius = math.sqrt(getattr(mass, key) / mass.mass) / geometry.b
        found.append(Figure(f"radius of gyration by {key}, over span", radius, "", usual))
    if vehicle.propulsion is not None and vehicle.propulsion.max_thrust is not None:
        found.append(Figure("largest thrust over weight", vehicle.propulsion.max_thrust / weight, "", (0.2, 2.5)))
    return found
