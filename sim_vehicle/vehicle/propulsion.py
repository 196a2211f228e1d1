"""Motor and propeller of a vehicle file: thrust by a law of the throttle, or by CT and CQ over advance ratio.

    T = rho n^2 D^4 CT(J)     Q = rho n^2 D^5 CQ(J)     J = V / (n D), n in revolutions a second

(McCormick, "Aerodynamics, Aeronautics, and Flight Mechanics", ch. 6; the propeller data base of the University of
Illinois tables CT and CP = 2 pi CQ in this form.)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.physics.layout import CURVE_COEFFICIENTS, CURVE_SEGMENTS, CURVE_SIZE
from sim_vehicle.vehicle.strict_toml import Table

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Points = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Polynomial:
    """c0 + c1 J + c2 J^2 ... between the ends of `range`, straight on beyond them."""

    coefficients: tuple[float, ...]
    range: tuple[float, float]


Curve = Points | Polynomial


@dataclass(frozen=True)
class Propulsion:
    """Motor and propeller.

    line: a point of the thrust line from the centre of gravity, m; line_known: whether it was given; line_std:
    standard deviation of its height, m, None for what is usual. inclination: rad, positive where thrust points
    upward: it acts along (cos i, 0, -sin i). diameter: m. rotation: "cw" or "ccw" seen from behind.
    max_thrust: N at full throttle. CT, CQ: (advance ratio, coefficient) points, or a polynomial, or empty.
    tau: first-order lag from throttle to thrust, or to propeller speed where CT is known, s.
    moving_mass: kg hanging on the thrust sensor; moving_mass_known: whether it was given. max_rpm: 1/min at full
    throttle. voltage: of the battery, V, at which max_thrust and max_rpm hold; None where it does not count.
    pitch: of the propeller, m. efficiency: share of the battery's power that motor and controller give to the shaft,
    None where it is not given; efficiency_std: its standard deviation.
    """

    line: Vector = (0.0, 0.0, 0.0)
    inclination: float = 0.0
    diameter: float | None = None
    rotation: str = "cw"
    max_thrust: float | None = None
    CT: Curve = ()
    CQ: Curve = ()
    tau: float = 0.0
    moving_mass: float = 0.0
    max_rpm: float | None = None
    line_known: bool = True
    line_std: float | None = None
    pitch: float | None = None
    voltage: float | None = None
    efficiency: float | None = None
    efficiency_std: float | None = None
    moving_mass_known: bool = True

    @property
    def by_throttle(self) -> str:
        """The law that gives thrust from the throttle: "CT(J)", "max_thrust", or "" where there is none.

        CT counts before max_thrust; it needs the propeller's speed, which is max_rpm times the throttle.
        """
        if self.CT and self.max_rpm:
            return "CT(J)"
        return "max_thrust" if self.max_thrust else ""

    @property
    def by_rpm(self) -> str:
        """The law that gives thrust from the propeller's speed: "CT(J)", "max_thrust (rpm / max_rpm)^2", or ""."""
        if self.CT:
            return "CT(J)"
        return "max_thrust (rpm / max_rpm)^2" if self.max_thrust and self.max_rpm else ""


# Full speed of a propeller of which none is given, 1/min: a unit for measured speeds, never a speed assumed.
_UNIT_RPM = 10000.0


def rotor_scale(propulsion: Propulsion) -> float:
    """Propeller speed, rad/s, that a throttle of 1 behind the motor's lag stands for."""
    full = propulsion.max_rpm or (_UNIT_RPM if propulsion.CT or propulsion.CQ else 0.0)
    return full * 2.0 * math.pi / 60.0


def scaled(curve: Curve, gain: float) -> Curve:
    """The curve times a factor."""
    if isinstance(curve, Polynomial):
        return Polynomial(tuple(gain * value for value in curve.coefficients), curve.range)
    return tuple((J, gain * value) for J, value in curve)


def pack_curve(curve: Curve) -> Array:
    """A curve in the form of the compiled code.

    Points are joined by a monotone cubic, which makes no bumps between them.

    Parameters
    ----------
    curve : Curve
        Points (advance ratio, coefficient), or a polynomial of the advance ratio; dimensionless.

    Returns
    -------
    Array, shape (CURVE_SIZE,)
        How many pieces there are, the end of the last, then start and powers of each piece; dimensionless.

    References
    ----------
    F. N. Fritsch, J. Butland, SIAM J. Sci. Stat. Comput. 5(2), 1984.
    """
    packed = np.zeros(CURVE_SIZE)
    if not curve:
        return packed
    pieces = packed[2:].reshape(CURVE_SEGMENTS, 1 + CURVE_COEFFICIENTS)
    if isinstance(curve, Polynomial):
        low, high = curve.range
        shifted = np.polynomial.Polynomial(curve.coefficients)(np.polynomial.Polynomial([low, 1.0])).coef
        packed[:2] = 1.0, high
        pieces[0, 0] = low
        pieces[0, 1 : 1 + shifted.size] = shifted
        return packed
    from scipy.interpolate import PchipInterpolator  # slow to import, and seldom wanted

    places, values = np.array(curve).T
    cubic = PchipInterpolator(places, values)
    count = places.size - 1
    packed[:2] = count, places[-1]
    pieces[:count, 0] = places[:-1]
    pieces[:count, 1:5] = cubic.c[::-1].T
    return packed


def read_motors(table: Table) -> dict[str, Propulsion]:
    """The tables [propulsion.NAME] of a vehicle file, one for each of several motors; none where there is one motor.

    Raises VehicleFileError in one line naming the key.
    """
    names = [name for name in table if table.is_table(name) and name not in ("CT", "CQ")]
    return {name: read_propulsion(table.table(name)) for name in names}


def together(motors: Mapping[str, Propulsion]) -> Propulsion:
    """Several motors as one that all of them are: their thrust at one throttle, on the middle of their lines, without
    torque.
    """
    every = list(motors.values())
    first, count = every[0], len(every)
    middle = [sum(one.line[axis] for one in every) / count for axis in range(3)]
    most = [one.max_thrust for one in every if one.max_thrust is not None]
    return replace(
        first, line=(middle[0], middle[1], middle[2]), max_thrust=sum(most) if len(most) == count else None,
        CT=scaled(first.CT, float(count)), CQ=(), moving_mass=sum(one.moving_mass for one in every),
        line_known=all(one.line_known for one in every),
    )  # fmt: skip


def read_propulsion(table: Table) -> Propulsion:
    """The table [propulsion] of a vehicle file, or that of one of several motors. Raises VehicleFileError in one line
    naming the key.
    """
    turns = ("cw", "ccw")
    sense = table.text("sense", "cw", turns)
    curves = {key: _read_curve(table, key) if table.optional(key) else () for key in ("CT", "CQ")}
    propulsion = Propulsion(
        line=table.vector("line"),
        line_known=table.optional("line"),
        line_std=table.optional_number("line_std", low=0.0),
        inclination=table.number("inclination", 0.0),
        diameter=table.optional_number("diameter", above=0.0),
        rotation=table.text("rotation", sense, turns),
        max_thrust=table.optional_number("max_thrust", above=0.0),
        CT=curves["CT"],
        CQ=curves["CQ"],
        tau=table.number("tau", 0.0, low=0.0),
        moving_mass=table.number("moving_mass", 0.0, low=0.0),
        moving_mass_known=table.optional("moving_mass"),
        max_rpm=table.optional_number("max_rpm", above=0.0),
        pitch=table.optional_number("pitch", above=0.0),
        voltage=table.optional_number("voltage", above=0.0),
        efficiency=table.optional_number("efficiency", above=0.0),
        efficiency_std=table.optional_number("efficiency_std", above=0.0),
    )
    table.close()
    if propulsion.max_thrust is None and not propulsion.CT and propulsion.pitch is None:
        raise table.error(
            "max_thrust",
            "is missing; give it, or CT over advance ratio with diameter, or diameter and pitch for thrust by the"
            " battery's voltage and current",
        )
    if (propulsion.efficiency or 0.0) >= 1.0:
        raise table.error("efficiency", "is a share of the battery's power: above 0, below 1 (0.76 is usual)")
    if propulsion.pitch is not None and propulsion.diameter is None:
        raise table.error("diameter", "is missing; pitch needs it")
    if (propulsion.CT or propulsion.CQ) and propulsion.diameter is None:
        raise table.error("diameter", "is missing; CT and CQ need it")
    return propulsion


def _read_curve(table: Table, key: str) -> Curve:
    if table.is_table(key):
        entry = table.table(key)
        coefficients, ends = entry.numbers("polynomial"), entry.numbers("range")
        entry.close()
        if len(coefficients) > CURVE_COEFFICIENTS:
            raise entry.error("polynomial", f"has {len(coefficients)} coefficients; at most {CURVE_COEFFICIENTS}")
        if len(ends) != 2 or not ends[0] < ends[1]:
            raise entry.error("range", "must be [lowest, highest] advance ratio that the polynomial holds for")
        return Polynomial(coefficients, (ends[0], ends[1]))
    rows = table.rows(key)
    if not 2 <= len(rows) <= CURVE_SEGMENTS + 1 or any(len(row) != 2 for row in rows):
        raise table.error(
            key, f"must be two to {CURVE_SEGMENTS + 1} pairs [advance ratio, coefficient], or a polynomial"
        )
    if any(b[0] <= a[0] for a, b in pairwise(rows)):
        raise table.error(key, "must have its advance ratios rise from pair to pair")
    return tuple((row[0], row[1]) for row in rows)
