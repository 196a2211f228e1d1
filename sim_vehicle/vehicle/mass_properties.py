"""Mass, moments of inertia and reference lengths of a vehicle file."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from sim_vehicle.vehicle.strict_toml import Table

# Of the moments of inertia: by how much the sum of two may fall short of the third, without and with a warning.
_SWING_TEST_ERROR, _LARGEST_SWING_ERROR = 0.02, 0.10
MASS_KEYS = ("mass", "Ixx", "Iyy", "Izz", "Ixz")
_TAIL_KEYS = ("tail_area", "tail_arm", "fin_area", "fin_arm")
# Moments of inertia over mass and span squared, the geometric mean of three small aircraft that were swung (Ultra Stick
# 25e; Aerosonde and Zagi in Beard & McLain, Small Unmanned Aircraft, app. E), and how far one of them may be off.
_USUAL_INERTIA = {"Ixx": 0.019, "Iyy": 0.020, "Izz": 0.035}
_USUAL_INERTIA_STD = 0.7
# The product of inertia over the root of Ixx Izz: 0.13, 0.10 and 0.01 for the same three; its sign goes with the tail.
_USUAL_PRODUCT_STD = 0.1


@dataclass(frozen=True)
class MassProperties:
    """Mass, kg, and moments of inertia about the centre of gravity, kg m^2; Ixz is + integral of x z dm.

    *_std: how well each is known, 1 sigma; None where none is given. estimated: whether the moments of inertia are
    those usual for mass and span.
    """

    mass: float
    Ixx: float
    Iyy: float
    Izz: float
    Ixz: float = 0.0
    mass_std: float | None = None
    Ixx_std: float | None = None
    Iyy_std: float | None = None
    Izz_std: float | None = None
    Ixz_std: float | None = None
    estimated: bool = field(default=False, kw_only=True)

    @property
    def doubted(self) -> bool:
        """Whether anything is given on how well the mass or a moment of inertia is known."""
        return any(getattr(self, f"{key}_std") for key in MASS_KEYS)


@dataclass(frozen=True)
class Geometry:
    """Reference area S, m^2, span b, m, and mean chord c, m.

    tail_*, fin_*: area, m^2, of the horizontal tail and of the fin, each with its movable part, and how far the quarter
    chord lies behind the centre of gravity, m; None where they are not given.
    """

    S: float
    b: float
    c: float
    tail_area: float | None = None
    tail_arm: float | None = None
    fin_area: float | None = None
    fin_arm: float | None = None


def read_mass(table: Table, geometry: Geometry, warnings: list[str]) -> MassProperties:
    mass = table.number("mass", above=0.0)
    if not any(table.optional(key) for key in MASS_KEYS if key.startswith("I")):
        mass_std = table.optional_number("mass_std", low=0.0)
        table.close()
        found = usual_inertia(mass, geometry.b)
        usual = {key: value for key, (value, _) in found.items()}
        shown = [f"{usual[key]:.2g}" for key in _USUAL_INERTIA]
        doubt = {f"{key}_std": std for key, (_, std) in found.items()}
        warnings.append(
            f"{table.path('Ixx')}, Iyy, Izz: not given; what is usual for mass and span is taken"
            f" ({', '.join(shown)} kg m^2, to {_USUAL_INERTIA_STD:.0%}), so that"
            " moment coefficients are known no better; swing the aircraft as a pendulum"
        )
        return MassProperties(mass, **usual, mass_std=mass_std, **doubt, estimated=True)
    Ixx, Iyy, Izz = (table.number(key, above=0.0) for key in ("Ixx", "Iyy", "Izz"))
    Ixz = table.number("Ixz", 0.0)
    doubts = [table.optional_number(f"{key}_std", low=0.0) for key in MASS_KEYS]
    table.close()
    if Ixz * Ixz >= Ixx * Izz:
        raise table.error("Ixz", f"is {Ixz:g}; its square must be below Ixx Izz = {Ixx * Izz:g}")
    smallest, middle, largest = np.linalg.eigvalsh(np.array([[Ixx, 0, -Ixz], [0, Iyy, 0], [-Ixz, 0, Izz]]))
    beyond = largest / (smallest + middle) - 1.0
    if beyond > _SWING_TEST_ERROR:
        key = ("Ixx", "Iyy", "Izz")[int(np.argmax([Ixx, Iyy, Izz]))]
        problem = f"is too large: a principal moment of inertia ({largest:g}) exceeds the sum of the other two"
        if beyond > _LARGEST_SWING_ERROR:
            raise table.error(key, problem)
        warnings.append(f"{table.path(key)}: {problem} by {beyond:.0%}, which no body does: a swing test repeated?")
    return MassProperties(mass, Ixx, Iyy, Izz, Ixz, *doubts)


def usual_inertia(mass: float, span: float) -> dict[str, tuple[float, float]]:
    """Moments of inertia that are usual for a mass, kg, and a span, m.

    By name: value and standard deviation, kg m^2.
    """
    values = {key: share * mass * span**2 for key, share in _USUAL_INERTIA.items()}
    product = _USUAL_PRODUCT_STD * math.sqrt(values["Ixx"] * values["Izz"])
    return {**{key: (value, _USUAL_INERTIA_STD * value) for key, value in values.items()}, "Ixz": (0.0, product)}


def read_geometry(table: Table) -> Geometry:
    wing = [table.number(key, above=0.0) for key in ("S", "b", "c")]
    tail = [table.optional_number(key, above=0.0) for key in _TAIL_KEYS]
    table.close()
    for area, arm in (_TAIL_KEYS[:2], _TAIL_KEYS[2:]):
        if (area in table) != (arm in table):
            raise table.error(
                *(area, f"is missing beside {arm}") if arm in table else (arm, f"is missing beside {area}")
            )
    return Geometry(*wing, *tail)
