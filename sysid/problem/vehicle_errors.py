"""What mass, moments of inertia and density may be wrong by: one table for every estimator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from sim_vehicle.vehicle.vehicle_file import Vehicle

# End of the name of an error whose size the vehicle file states.
STATED = "_std"
DENSITY, DENSITY_SHARE = "density_2pct", 0.02
_INERTIA = ("Ixx", "Iyy", "Izz", "Ixz")


def is_stated(source: str) -> bool:
    """Whether the size of a doubt is the vehicle file's, by its name."""
    return source.endswith(STATED)


def doubts_of_mass(vehicle: Vehicle) -> dict[str, dict[str, float]]:
    """What mass and moments of inertia may be off by: name of the doubt -> key of the vehicle's mass -> one standard
    deviation, kg or kg m^2. What the file states is named after its key there, else stands a usual share.
    """
    mass = vehicle.mass
    stated = {key: std for key in ("mass", *_INERTIA) if (std := getattr(mass, f"{key}_std")) is not None}
    found = {f"{key}{STATED}": {key: std} for key, std in stated.items()}
    if "mass" not in stated:
        found["mass_1pct"] = {"mass": 0.01 * mass.mass}
    usual = [key for key in _INERTIA if key not in stated]
    if len(usual) >= len(_INERTIA) - 1:  # the product alone says nothing of the moments
        found["inertia_5pct"] = {key: 0.05 * getattr(mass, key) for key in usual}
    return found


def heavier(vehicle: Vehicle, by: Mapping[str, float], share: float = 1.0) -> Vehicle:
    """The vehicle with so much of an error of its mass and inertia (of `doubts_of_mass`)."""
    more = {key: getattr(vehicle.mass, key) + share * change for key, change in by.items()}
    return replace(vehicle, mass=replace(vehicle.mass, **more))


def under_error(vehicle: Vehicle, density: float, source: str, share: float) -> tuple[Vehicle, float]:
    """Vehicle and density of the air, kg/m^3, with so many standard deviations of an error, by its name; as they are
    where it is of neither.
    """
    denser = density * (1.0 + (DENSITY_SHARE * share if source == DENSITY else 0.0))
    return heavier(vehicle, doubts_of_mass(vehicle).get(source, {}), share), denser
