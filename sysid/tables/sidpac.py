"""SIDPAC's flight data array `fdata`: its columns and what they are.

E. A. Morelli, V. Klein, "Aircraft System Identification: Theory and Practice", 2nd ed., Sunflyte 2016: `fdata` has 90
columns in U.S. customary units, degrees and g; columns that were not measured are 0. Only what is measured is read: the
coefficients in columns 61 to 73 follow from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sysid.arrays import Array
from sysid.errors import TableError
from sysid.tables.columns import Matched, match_columns
from sysid.tables.units import unit_of

# Columns of the array; older ones have fewer.
COLUMNS, _FEWEST = 90, 30
# Column, from 1 -> signal and unit.
_CHANNELS: dict[int, tuple[str, str]] = {
    1: ("time", "s"),
    2: ("true_airspeed", "ft/s"),
    **{column: (name, "deg") for column, name in ((3, "beta"), (4, "alpha"))},
    **{column: (name, "deg/s") for column, name in zip(range(5, 8), "pqr", strict=True)},
    **{column: (name, "deg") for column, name in zip(range(8, 11), ("phi", "theta", "psi"), strict=True)},
    **{column: (name, "g") for column, name in zip(range(11, 14), ("ax", "ay", "az"), strict=True)},
    **{column: (name, "deg") for column, name in zip(range(14, 17), ("de", "da", "dr"), strict=True)},
    **{column: (name, "deg/s^2") for column, name in zip(range(42, 45), ("pdot", "qdot", "rdot"), strict=True)},
    29: ("air_density", "slug/ft^3"),
    30: ("altitude", "ft"),
}
_THRUST = range(38, 42)  # lbf, of up to four engines
# Columns of the mass, slug, the moments of inertia, slug ft^2, and the wing, ft^2, ft, ft.
_MASS, _INERTIA, _AREA, _SPAN, _CHORD = 48, {"Ixx": 49, "Iyy": 50, "Izz": 51, "Ixz": 52}, 77, 78, 79
# kg and kg m^2 in a slug and a slug ft^2.
_SLUG, _SLUG_FT2 = 14.593902937206, 1.3558179483314


@dataclass(frozen=True)
class AircraftInTable:
    """What `fdata` says of the aircraft, the mean over the flight: kg, kg m^2, m^2, m."""

    mass: float
    Ixx: float
    Iyy: float
    Izz: float
    Ixz: float
    S: float
    b: float
    c: float


def fdata_columns(fdata: ArrayLike, name: str = "fdata") -> tuple[dict[str, Array], Matched]:
    """The measured channels of an `fdata` array as a table.

    Parameters
    ----------
    fdata : ArrayLike, shape (N, 30 or more)
        The array as SIDPAC keeps it.
    name : str
        What it is called, for errors.

    Returns
    -------
    table : dict[str, Array]
        "fdata(:,4)" -> (N,) values as they are.
    matched : Matched
        Which column is what.

    Raises
    ------
    TableError
        Where it is no such array.
    """
    array = _checked(fdata, name)
    table, columns, units = {}, {}, {}
    for column, (signal, unit) in _CHANNELS.items():
        if column > array.shape[1]:
            continue
        values = array[:, column - 1]
        if column > 1 and not np.any(np.nan_to_num(values)):
            continue
        header = f"fdata(:,{column})"
        table[header], columns[signal], units[signal] = values, header, unit
    thrust = [column for column in _THRUST if column <= array.shape[1] and np.any(np.nan_to_num(array[:, column - 1]))]
    headers = {f"fdata(:,{column})": 1.0 for column in thrust}
    table |= {header: array[:, column - 1] for header, column in zip(headers, thrust, strict=True)}
    wanted: dict[str, str | int | dict[str, float]] = {**columns}
    if headers:
        wanted["thrust"], units["thrust"] = headers, "lbf"
    return table, match_columns(list(table), wanted, units)


def aircraft_of_fdata(fdata: ArrayLike, name: str = "fdata") -> AircraftInTable:
    """Mass, inertia and geometry of an aircraft in SIDPAC's flight data array.

    Parameters
    ----------
    fdata : ArrayLike, shape (N, 79 or more)
        The array, U.S. customary units.
    name : str
        What it is called, for errors.

    Returns
    -------
    AircraftInTable
        In SI units, each the mean over the flight.

    Raises
    ------
    TableError
        Where one of them is missing.
    """
    array = _checked(fdata, name)
    columns = (_MASS, _AREA, _SPAN, _CHORD, *list(_INERTIA.values())[:3])
    if array.shape[1] < _CHORD or any(not np.any(np.nan_to_num(array[:, column - 1])) for column in columns):
        lacking = [
            str(column)
            for column in columns
            if array.shape[1] < column or not np.any(np.nan_to_num(array[:, column - 1]))
        ]
        raise TableError(
            f"{name}: columns {', '.join(lacking)} (mass, inertia, wing) are empty; describe the aircraft yourself"
        )
    mean = {column: float(np.nanmean(array[:, column - 1])) for column in (*columns, _INERTIA["Ixz"])}
    foot = unit_of("ft", "m", name).factor
    inertia = {key: _SLUG_FT2 * mean[column] for key, column in _INERTIA.items()}
    return AircraftInTable(
        _SLUG * mean[_MASS], **inertia, S=foot**2 * mean[_AREA], b=foot * mean[_SPAN], c=foot * mean[_CHORD]
    )


def looks_like_fdata(array: Array) -> bool:
    """Whether a matrix is as wide as `fdata` and its first column a time."""
    if array.ndim != 2 or array.shape[1] < COLUMNS or array.shape[0] < 2:
        return False
    return bool((np.diff(array[:, 0]) > 0.0).all())


def _checked(fdata: ArrayLike, name: str) -> Array:
    try:
        array = np.asarray(fdata, dtype=np.float64)
    except (TypeError, ValueError):
        raise TableError(f"{name}: is no array of numbers; give the variable fdata itself") from None
    if array.ndim != 2 or array.shape[1] < _FEWEST:
        raise TableError(
            f"{name}: an array of the shape {array.shape} is no flight data array of SIDPAC, which has 90 columns"
        )
    return array
