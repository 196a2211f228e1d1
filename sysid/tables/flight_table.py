"""A table of columns becomes a flight: SI units, one time, values that were only repeated left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from sim_vehicle.constants import GAS_CONSTANT, SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.second_sensors import SECOND_SENSORS
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import SignalError, TableError
from sysid.signals.flight import FlightSignals, Signal
from sysid.tables.columns import TAKEN_FOR_SECONDS, ColumnUse, Matched
from sysid.tables.names import INPUTS

# Rows of a table, and s between two of them, that a flight can be: from 2 kHz loggers to 1 Hz GPS.
_FEWEST_ROWS = 20
_SHORTEST_STEP_S, _LONGEST_STEP_S = 1e-4, 2.0
# From so many s between rows on a time without a unit may well be one in ms.
_UNLIKELY_STEP_S = 0.5
# Share of values that repeat the one before, beyond which a sensor is slower than the table.
_HELD_SHARE = 0.5
# Angles, rad, that 99 % of the rows keep within in any aircraft: surfaces and flow, attitude however it is counted.
_LARGEST_RAD = {
    **dict.fromkeys(("de", "da", "dr", "theta"), 1.6),
    **dict.fromkeys(("alpha", "beta", *(name for name, one in SECOND_SENSORS.items() if one.unit == "rad")), 3.2),
    "phi": 6.4,
}
# Largest throttle that is a fraction; more is a percentage.
_LARGEST_THROTTLE = 1.5
# Signals that stand still for reasons of their own, and then step.
_STEPPING = ("thrust", "rpm")
# Longest time between changes over the usual one, up to which a slower sensor's clock is seen in them.
_REGULAR = 3.0
#: What a source is called that a table gave.
SOURCE = "table"


def flight_from_table(
    name: str, table: Mapping[str, ArrayLike], matched: Matched, doubts: Sequence[str] = ()
) -> FlightSignals:
    """The signals of a table.

    Parameters
    ----------
    name : str
        What the flight is called in results.
    table : Mapping[str, ArrayLike]
        Header -> (N,) values; NaN where there is none.
    matched : Matched
        Which column is what (`match_columns`).
    doubts : Sequence[str]
        What is doubtful about the table itself, for the flight's warnings.

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
    warnings = list(doubts)
    time_s = _seconds(name, _values(name, table, matched.time), matched.time, warnings)
    rows = time_s.size
    order = np.flatnonzero(np.isfinite(time_s))
    keep = order[np.concatenate(([True], np.diff(time_s[order]) > 0.0))] if order.size else order
    if keep.size < order.size:
        warnings.append(f"{order.size - keep.size} rows repeat the time of the row before; they are left out")
    time_s = time_s[keep] - time_s[keep][0]
    signals = {}
    for use in matched.uses:
        values = _values(name, table, use)
        if values.size != rows:
            raise TableError(f"{name}: column {use.headers[0]!r} has {values.size} rows, and the time {rows}")
        values = values[keep]
        if not np.isfinite(values).any():
            warnings.append(f"{use.signal}: column {use.headers[0]!r} holds no value; it is left out")
            continue
        stamps = time_s
        if use.signal not in (*INPUTS, *_STEPPING):
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
        A flight with `airspeed` [m/s, of that kind], `true_airspeed` [m/s] or `differential_pressure` [Pa].
    vehicle : Vehicle
        Whose `sensors.airspeed.kind` is "calibrated" or "true".

    Returns
    -------
    FlightSignals
        Its own column where there is one of that kind, else the other turned: V_c = V sqrt(rho / 1.225), by the density
        of the vehicle file, else the flight's, else that at sea level, which is what the estimators take then.

    Raises
    ------
    SignalError
        For a true airspeed from pressure alone where the density is not known.
    """
    signals = dict(flight.signals)
    true, own, pressure = (
        signals.pop("true_airspeed", None),
        signals.get("airspeed"),
        signals.get("differential_pressure"),
    )
    wants_true = vehicle.sensors.airspeed.kind == "true"
    if own is None and true is None and pressure is None:
        return flight
    chosen = (true or own) if wants_true else (own or true)
    if chosen is None and pressure is not None:
        values = np.sign(pressure.values) * np.sqrt(2.0 * np.abs(pressure.values) / SEA_LEVEL_DENSITY)
        if wants_true:
            if vehicle.environment.air_density is None and "air_density" not in signals:
                raise SignalError(
                    f"{flight.name}: true airspeed is wanted of a pressure, and the air density is not known: give it"
                    " (air_density, or pressure and temperature), or call the airspeed calibrated"
                )
            values = values / np.sqrt(_density_at(flight, vehicle, pressure.time_s) / SEA_LEVEL_DENSITY)
        chosen = Signal(pressure.time_s, np.asarray(values), "m/s", pressure.source)
    elif chosen is true and not wants_true and true is not None:
        ratio = np.sqrt(_density_at(flight, vehicle, true.time_s) / SEA_LEVEL_DENSITY)
        chosen = Signal(true.time_s, np.asarray(true.values * ratio), "m/s", true.source)
    assert chosen is not None
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
    if len({part.size for part in parts}) > 1:
        raise TableError(f"{name}: {use.signal} is made from columns of unequal length")
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
    if usual >= _UNLIKELY_STEP_S and use.written == TAKEN_FOR_SECONDS:
        raise TableError(
            f"{name}: rows are {usual:g} apart by {use.headers[0]!r}, whose unit nobody says: {_units_for(usual)}"
        )
    if not _fits(usual):
        raise TableError(
            f"{name}: rows are {usual:g} s apart by {use.headers[0]!r} in {use.written}:"
            f" {_units_for(usual / use.unit.factor)}"
        )
    return time_s


def _check_angle(name: str, use: ColumnUse, values: Array) -> None:
    """TableError for an angle that no aircraft has: degrees that are said to be radians."""
    most = _LARGEST_RAD.get(use.signal)
    if use.signal == "throttle" and float(np.nanpercentile(np.abs(values), 99.0)) > _LARGEST_THROTTLE:
        raise TableError(
            f"{name}: throttle reaches {np.nanmax(values):.3g} by column {use.headers[0]!r} in {use.written}, and 1 is"
            " all there is: is it in percent? give units = {'throttle': '%'}"
        )
    reach = float(np.nanpercentile(np.abs(values), 99.0))
    if most is not None and reach > most:
        radians = use.unit.factor == 1.0
        likely = f"is it in degrees? give units = {{'{use.signal}': 'deg'}}" if radians else "its unit is another one"
        raise TableError(
            f"{name}: {use.signal} reaches {reach:.3g} rad by column {use.headers[0]!r} in {use.written}, which no"
            f" aircraft does: {likely}"
        )


def _fits(step_s: float) -> bool:
    return _SHORTEST_STEP_S <= step_s <= _LONGEST_STEP_S


def _units_for(step: float) -> str:
    """What to do about a time whose rows are so far apart: every unit in which that is a flight's."""
    likely = [unit for unit, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)) if _fits(step * factor)]
    if not likely:
        return "a flight has 0.5 to 10,000 rows a second"
    others = f", or {' or '.join(map(repr, likely[1:]))} where they are that" if likely[1:] else ""
    return f"give units = {{'time': {likely[0]!r}}}{others}"


def _without_repeats(time_s: Array, values: Array) -> tuple[Array, Array]:
    """The rows in which a value changes, where it does so at a regular, slower rate than the table's."""
    same = np.diff(values) == 0.0
    if not _HELD_SHARE < float(np.mean(same)) < 1.0:
        return time_s, values
    changed = np.flatnonzero(np.concatenate(([True], ~same)))
    steps = np.diff(time_s[changed])
    if changed.size < _FEWEST_ROWS or float(np.percentile(steps, 90.0)) > _REGULAR * float(np.median(steps)):
        return time_s, values
    return time_s[changed], values[changed]
