"""A table of columns becomes a flight: SI units, one time, values that were only repeated left out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from sim_vehicle.constants import GAS_CONSTANT, SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import TableError
from sysid.signals.flight import FlightSignals, Signal
from sysid.tables.columns import ColumnUse, Matched
from sysid.tables.names import INPUTS

# Rows of a table, and s between two of them, that a flight can be: from 2 kHz loggers to 1 Hz GPS.
_FEWEST_ROWS = 20
_SHORTEST_STEP_S, _LONGEST_STEP_S = 1e-4, 2.0
# Share of values that repeat the one before, beyond which a sensor is slower than the table.
_HELD_SHARE = 0.5
# Angles, rad, that 99 % of the rows keep within in any aircraft: surfaces and flow, attitude however it is counted.
_LARGEST_RAD = {
    **dict.fromkeys(("de", "da", "dr", "theta"), 1.6),
    **dict.fromkeys(("alpha", "beta", "alpha2", "beta2"), 3.2),
    "phi": 6.4,
}
#: What a source is called that a table gave.
SOURCE = "table"


def flight_from_table(name: str, table: Mapping[str, ArrayLike], matched: Matched) -> FlightSignals:
    """The signals of a table.

    Parameters
    ----------
    name : str
        What the flight is called in results.
    table : Mapping[str, ArrayLike]
        Header -> (N,) values; NaN where there is none.
    matched : Matched
        Which column is what (`match_columns`).

    Returns
    -------
    FlightSignals
        Signals on the table's time, from its first row, with `air_density` by the gas law where pressure and
        temperature are there. A signal that mostly repeats its last value keeps the rows in which it changes.

    Raises
    ------
    TableError
        Where the time does not run forward in steps of a flight, or a column holds no numbers.
    """
    warnings: list[str] = []
    time_s = _seconds(name, _values(name, table, matched.time), matched.time, warnings)
    order = np.flatnonzero(np.isfinite(time_s))
    keep = order[np.concatenate(([True], np.diff(time_s[order]) > 0.0))] if order.size else order
    if keep.size < order.size:
        warnings.append(f"{order.size - keep.size} rows repeat the time of the row before; they are left out")
    time_s = time_s[keep] - time_s[keep][0]
    signals = {}
    for use in matched.uses:
        values = _values(name, table, use)[keep]
        if not np.isfinite(values).any():
            warnings.append(f"{use.signal}: column {use.headers[0]!r} holds no value; it is left out")
            continue
        stamps = time_s
        if use.signal not in INPUTS:
            stamps, values = _without_repeats(time_s, values)
            if stamps.size < time_s.size:
                warnings.append(
                    f"{use.signal}: column {use.headers[0]!r} mostly repeats its last value; the {stamps.size} rows in"
                    " which it changes count"
                )
        source = f"{SOURCE}.{use.headers[0]}"
        _check_angle(name, use, values)
        unit = "" if use.unit.si == "1" else use.unit.si
        signals[use.signal] = Signal(stamps, np.ascontiguousarray(values), unit, source)
    if "air_density" not in signals and {"static_pressure", "temperature"} <= signals.keys():
        signals["air_density"] = _density(signals["static_pressure"], signals["temperature"])
    return FlightSignals(name, signals, tuple(warnings))


def with_airspeed_of(flight: FlightSignals, vehicle: Vehicle) -> FlightSignals:
    """The flight with `airspeed` of the kind that the vehicle's sensor is said to read.

    Parameters
    ----------
    flight : FlightSignals
        A flight with `true_airspeed` [m/s], `airspeed` [m/s, calibrated] or `differential_pressure` [Pa].
    vehicle : Vehicle
        Whose `sensors.airspeed.kind` is "calibrated" or "true".

    Returns
    -------
    FlightSignals
        The same where there is nothing to turn: V_c = V sqrt(rho / 1.225), by the density of the vehicle file, else
        the flight's, else that at sea level.
    """
    signals = dict(flight.signals)
    true, calibrated = signals.pop("true_airspeed", None), signals.get("airspeed")
    if calibrated is None and true is None and "differential_pressure" in signals:
        pressure = signals["differential_pressure"]
        values = np.sign(pressure.values) * np.sqrt(2.0 * np.abs(pressure.values) / SEA_LEVEL_DENSITY)
        calibrated = Signal(pressure.time_s, np.asarray(values), "m/s", pressure.source)
    wants_true = vehicle.sensors.airspeed.kind == "true"
    chosen = (true or calibrated) if wants_true else (calibrated or true)
    if chosen is None:
        return flight
    if chosen is (calibrated if wants_true else true):
        ratio = np.sqrt(_density_at(flight, vehicle, chosen.time_s) / SEA_LEVEL_DENSITY)
        values = chosen.values / ratio if wants_true else chosen.values * ratio
        chosen = Signal(chosen.time_s, np.asarray(values), "m/s", chosen.source)
    kind = "true airspeed" if wants_true else "calibrated airspeed"
    signals["airspeed"] = Signal(chosen.time_s, chosen.values, "m/s", f"{chosen.source} ({kind})")
    if vehicle.environment.air_density is not None:
        ends = np.array([chosen.time_s[0], chosen.time_s[-1]])
        density = np.full(2, vehicle.environment.air_density)
        signals["air_density"] = Signal(ends, density, "kg/m^3", "environment.air_density")
    return FlightSignals(flight.name, signals, flight.warnings, flight.sender)


def _density_at(flight: FlightSignals, vehicle: Vehicle, time_s: Array) -> Array:
    if vehicle.environment.air_density is not None:
        return np.full(time_s.size, vehicle.environment.air_density)
    one = flight.signals.get("air_density")
    if one is None:
        return np.full(time_s.size, SEA_LEVEL_DENSITY)
    known = np.isfinite(one.values)
    return np.interp(time_s, one.time_s[known], one.values[known])


def _density(pressure: Signal, temperature: Signal) -> Signal:
    known = np.isfinite(temperature.values)
    kelvin = np.interp(pressure.time_s, temperature.time_s[known], temperature.values[known])
    source = f"{pressure.source}, {temperature.source}"
    return Signal(pressure.time_s, pressure.values / (GAS_CONSTANT * kelvin), "kg/m^3", source)


def _values(name: str, table: Mapping[str, ArrayLike], use: ColumnUse) -> Array:
    """(N,) a signal in SI units."""
    parts = []
    for header, weight in zip(use.headers, use.weights, strict=True):
        try:
            column = np.asarray(table[header], dtype=np.float64)
        except (TypeError, ValueError):
            raise TableError(
                f"{name}: column {header!r} ({use.signal}) holds what is no number; leave it empty there"
            ) from None
        if column.ndim != 1:
            raise TableError(f"{name}: column {header!r} has the shape {column.shape}; one number in a row is wanted")
        parts.append(weight * column if weight != 1.0 else column)
    total = parts[0] if len(parts) == 1 else np.sum(parts, axis=0)
    if use.unit.factor == 1.0 and use.unit.offset == 0.0:
        return np.asarray(total)
    return np.asarray(use.unit.factor * total + use.unit.offset)


def _seconds(name: str, time_s: Array, use: ColumnUse, warnings: list[str]) -> Array:
    """The time of a table, once it is one."""
    known = time_s[np.isfinite(time_s)]
    if known.size < _FEWEST_ROWS:
        raise TableError(
            f"{name}: {known.size} rows have a time in {use.headers[0]!r}; a flight has {_FEWEST_ROWS} or more"
        )
    if known.size < time_s.size:
        warnings.append(f"{time_s.size - known.size} rows have no time; they are left out")
    steps = np.diff(known)
    if (steps < 0.0).any():
        row = int(np.flatnonzero(steps < 0.0)[0]) + 1
        raise TableError(
            f"{name}: the time in {use.headers[0]!r} goes back at row {row + 1}: one flight in a table, in time's order"
        )
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if not _SHORTEST_STEP_S <= usual <= _LONGEST_STEP_S:
        likely = next(
            (unit for unit, factor in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)) if _fits(usual * factor)), ""
        )
        advice = f"give units = {{'time': '{likely}'}}" if likely else "a flight has 0.5 to 10,000 rows a second"
        raise TableError(f"{name}: rows are {usual:g} s apart by {use.headers[0]!r} in {use.written}: {advice}")
    return time_s


def _check_angle(name: str, use: ColumnUse, values: Array) -> None:
    """TableError for an angle that no aircraft has: degrees that are said to be radians."""
    most = _LARGEST_RAD.get(use.signal)
    reach = float(np.nanpercentile(np.abs(values), 99.0))
    if most is not None and reach > most:
        raise TableError(
            f"{name}: {use.signal} reaches {reach:.3g} rad by column {use.headers[0]!r} in {use.written}, which no"
            f" aircraft does: is it in degrees? give units = {{'{use.signal}': 'deg'}}"
        )


def _fits(step_s: float) -> bool:
    return _SHORTEST_STEP_S <= step_s <= _LONGEST_STEP_S


def _without_repeats(time_s: Array, values: Array) -> tuple[Array, Array]:
    """The rows in which a value changes, where most repeat the one before: a sensor that is slower than the table."""
    same = np.diff(values) == 0.0
    if not _HELD_SHARE < float(np.mean(same)) < 1.0:
        return time_s, values
    changed = np.concatenate(([True], ~same))
    return (time_s[changed], values[changed]) if changed.sum() >= 2 else (time_s, values)
