"""A flight: signals in SI units, from arrays, tables and logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightmodel.aircraft import Aircraft
from flightmodel.errors import FlightModelError
from flightmodel.optional import library
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.signals.flight import FlightSignals
from sysid.tables.columns import Wanted, match_columns
from sysid.tables.files import ENDINGS, read_table
from sysid.tables.flight_table import flight_from_table, with_airspeed_of
from sysid.tables.pose import signals_of_pose
from sysid.tables.pose_columns import derived_columns
from sysid.tables.sidpac import fdata_columns

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Flight:
    """The signals of one flight.

    signals: each on its own time stamps. columns: which column of a table became which signal, one line each; empty for
    a log. unused: columns that became none. aircraft: by which a log was read.
    """

    signals: FlightSignals
    columns: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()
    aircraft: Aircraft | None = None

    @classmethod
    def from_frame(
        cls,
        frame: Any,
        *,
        columns: Mapping[str, Wanted] | None = None,
        units: Mapping[str, str] | str | None = None,
        name: str = "flight",
    ) -> Flight:
        """A flight from a table.

        Parameters
        ----------
        frame : Any
            A pandas or polars frame, an xarray Dataset, a structured numpy array, or a mapping of names to arrays.
        columns : Mapping[str, str | int | Mapping[str, float]] | None
            Signal (or "time") -> column, or columns with weights; those that are not named are found by their names.
        units : Mapping[str, str] | str | None
            Signal or column -> unit, where the name of the column does not end with it; "SI" where all others are in SI
            units and radians.
        name : str
            What the flight is called in results.

        Returns
        -------
        Flight
            With `columns` that say what was taken for what.

        Raises
        ------
        sysid.errors.TableError
            Where there is no time, or the unit of a column is not known.

        Examples
        --------
        >>> import numpy as np
        >>> t = np.arange(0.0, 10.0, 0.02)
        >>> flight = Flight.from_frame({"time_s": t, "alpha (deg)": 3.0 + np.sin(t)})
        >>> flight.columns
        ("alpha: column 'alpha (deg)', deg",)
        """
        table, left_out = _columns_of(frame)
        every, named, said = derived_columns(table, columns, units)
        matched = match_columns(list(every), named, said)
        flight = flight_from_table(name, every, matched)
        return cls(flight, tuple(use.sentence for use in matched.uses), (*matched.unused, *left_out))

    @classmethod
    def from_pose(
        cls,
        time_s: ArrayLike,
        position: ArrayLike,
        quaternion: ArrayLike,
        *,
        inputs: Mapping[str, ArrayLike],
        frame: str = "ned",
        wind: tuple[float, float, float] = (0.0, 0.0, 0.0),
        name: str = "flight",
    ) -> Flight:
        """A flight that was seen from outside: motion capture, visual odometry.

        Parameters
        ----------
        time_s : ArrayLike, shape (N,)
            When, s.
        position : ArrayLike, shape (N, 3)
            North, east, down, m, or what `frame` says; NaN where it was not seen.
        quaternion : ArrayLike, shape (N, 4)
            Scalar, x, y, z, from body axes to those of the position.
        inputs : Mapping[str, ArrayLike]
            Signals that were recorded beside it on the same time, (N,) each, SI units and rad: `de`, `da`, `dr`,
            `throttle`, `thrust`, `rpm`, `air_density`.
        frame : str
            "ned" (body axes forward, right, down), or "enu" (forward, left, up), as ROS has them.
        wind : tuple[float, float, float]
            Velocity of the air, north, east, down, m/s: still, as it is in a hall.
        name : str
            What the flight is called in results.

        Returns
        -------
        Flight
            Rates, attitude, specific force, airspeed, flow angles and velocity, smoothed, at even steps.

        Raises
        ------
        sysid.errors.TableError
            Where these do not go together, or the motion is none of an aircraft in these axes.
        """
        found = signals_of_pose(time_s, position, quaternion, frame, wind)
        stamps = np.asarray(time_s, dtype=np.float64)
        table = {key: values for key, values in found.items() if key != "time"}
        for key, values in inputs.items():
            given = np.asarray(values, dtype=np.float64)
            if given.shape != stamps.shape:
                raise FlightModelError(f"inputs: {key} has the shape {given.shape}, and the time {stamps.shape}")
            # An input holds until the next one.
            place = np.searchsorted(stamps, found["time"] + 1e-9, side="right") - 1
            table[key] = given[place.clip(min=0)]
        return cls.from_frame({"time": found["time"], **table}, units="SI", name=name)

    @classmethod
    def from_fdata(cls, fdata: ArrayLike, *, name: str = "fdata") -> Flight:
        """A flight from SIDPAC's flight data array.

        Parameters
        ----------
        fdata : ArrayLike, shape (N, 90)
            The array: U.S. customary units, degrees, g; columns of zeros were not measured.
        name : str
            What the flight is called.

        Returns
        -------
        Flight
            Its measured channels in SI units.
        """
        table, matched = fdata_columns(fdata, name)
        return cls(flight_from_table(name, table, matched), tuple(use.sentence for use in matched.uses))

    @classmethod
    def read(
        cls,
        path: str | Path,
        aircraft: Aircraft | None = None,
        *,
        columns: Mapping[str, Wanted] | None = None,
        units: Mapping[str, str] | str | None = None,
    ) -> Flight:
        """A flight from a file.

        Parameters
        ----------
        path : str | Path
            A table (.csv, .txt, .tsv, .parquet, .mat, .npz) or a log (.mcap, .tlog, ArduPilot .bin or
            Mission Planner's .mat of it, PX4 .ulg); or a
            folder with a CSV of each topic of PX4 or ROS.
        aircraft : Aircraft | None
            Whose servos moved which surface, for logs; tables do without.
        columns, units :
            Of a table, as for `from_frame`.

        Returns
        -------
        Flight
            Its signals.
        """
        from gcs.importers.dataflash_matlab import is_mission_planner

        path = Path(path)
        is_log = path.suffix.lower() == ".mat" and is_mission_planner(path)
        if path.suffix.lower() in ENDINGS and not is_log:
            read = read_table(path)
            table, matched = read.matched(columns, units)
            found = flight_from_table(read.name, table, matched, read.warnings)
            return cls(found, tuple(use.sentence for use in matched.uses), (*matched.unused, *read.left_out))
        if columns or units:
            raise FlightModelError(f"{path.name}: a log says itself what its fields are; leave columns and units out")
        from gcs.analysis.postflight import read_flights
        from gcs.inspection.info import as_recordings

        with as_recordings([path]) as recordings:
            (signals,) = read_flights(recordings, Vehicle.unknown() if aircraft is None else aircraft.vehicle)
        return cls(signals, aircraft=aircraft)

    @property
    def name(self) -> str:
        """What the flight is called in results."""
        return self.signals.name

    @property
    def duration_s(self) -> float:
        """From the first stamp to the last, s."""
        return max((float(one.time_s[-1]) for one in self.signals.signals.values() if one.time_s.size), default=0.0)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is doubtful about it, one line each."""
        return self.signals.warnings

    def __getitem__(self, signal: str) -> tuple[Array, Array]:
        """(N,) s and (N,) values in SI units of a signal."""
        found = self.signals.signals.get(signal)
        if found is None:
            raise FlightModelError(f"{self.name}: no signal {signal}; it has {', '.join(self.signals.signals)}")
        return found.time_s, found.values

    def to_frame(self, signals: Sequence[str] | None = None) -> Any:
        """The signals as a pandas frame on the time of the fastest, SI units; slower ones are NaN between."""
        pandas = library("pandas", "to_frame")
        kept = {key: one for key, one in self.signals.signals.items() if signals is None or key in signals}
        parts = [pandas.Series(one.values, index=one.time_s, name=key) for key, one in kept.items()]
        table = pandas.concat([one[~one.index.duplicated()] for one in parts], axis=1).sort_index()
        return table.rename_axis("time_s")

    def plot(self, signals: Sequence[str] | None = None) -> Any:
        """Time histories as a matplotlib figure: one axis for each signal, degrees for angles."""
        from flightmodel.figures import time_histories

        return time_histories(self.signals, signals)

    def of(self, aircraft: Aircraft) -> FlightSignals:
        """The signals as the estimators want them: airspeed of the kind that the aircraft's sensor is said to read."""
        if self.columns:
            return with_airspeed_of(self.signals, aircraft.vehicle)
        if self.aircraft is None or self.aircraft.vehicle != aircraft.vehicle:
            raise FlightModelError(
                f"{self.name}: was read without this aircraft, whose servos and airspeed make it; read it with"
                " Flight.read(path, aircraft)"
            )
        return self.signals

    def __repr__(self) -> str:
        return f"Flight({self.name!r}, {self.duration_s:.1f} s, {len(self.signals.signals)} signals)"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{escape(key)}</th><td>{escape(one.unit)}</td><td>{one.rate_hz:.1f} Hz</td>"
            f"<td>{escape(one.source)}</td></tr>"
            for key, one in self.signals.signals.items()
        )
        head = "<tr><th>signal</th><th>unit</th><th>rate</th><th>from</th></tr>"
        doubts = "".join(f"<li>{escape(one)}</li>" for one in self.warnings)
        caption = f"<caption>{escape(self.name)}, {self.duration_s:.1f} s</caption>"
        return f"<table>{caption}{head}{rows}</table>{f'<ul>{doubts}</ul>' if doubts else ''}"


def _columns_of(frame: Any) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Name -> (N,) numbers of whatever holds columns; and those that hold none."""
    found: dict[str, Any]
    if isinstance(frame, Mapping) and not hasattr(frame, "data_vars"):
        found = {str(key): np.asarray(values) for key, values in frame.items()}
    elif hasattr(frame, "data_vars"):  # xarray
        each = {str(key): one for key, one in {**frame.coords, **frame.data_vars}.items() if one.ndim == 1}
        found = {
            key if not one.attrs.get("units") else f"{key} [{one.attrs['units']}]": one.to_numpy()
            for key, one in each.items()
        }
    elif isinstance(frame, np.ndarray) and frame.dtype.names:
        found = {key: frame[key] for key in frame.dtype.names}
    elif hasattr(frame, "columns") and hasattr(frame, "__getitem__"):
        found = {str(key): _plain(frame[key]) for key in frame.columns}
        index = getattr(frame, "index", None)
        if index is not None and (getattr(index, "name", None) or getattr(index.dtype, "kind", "") in "mM"):
            found = {str(index.name or "time"): _plain(index), **found}
    else:
        raise FlightModelError(
            f"a {type(frame).__name__} is no table: give a pandas or polars frame, an xarray Dataset, a structured"
            " array or a mapping of names to arrays; a matrix of SIDPAC goes to from_fdata"
        )
    numbers = {key: _numbers(values) for key, values in found.items() if values.dtype.kind in "fiubmM"}
    return numbers, tuple(key for key in found if key not in numbers)


def _plain(column: Any) -> Any:
    """A column as an array; moments of a time zone as UTC, missing values as NaN."""
    zone = getattr(column.dtype, "tz", None)
    if zone is not None:
        column = column.dt.tz_convert(None) if hasattr(column, "dt") else column.tz_convert(None)
    values = column.to_numpy()
    if values.dtype.kind == "O":
        try:
            return values.astype(np.float64)
        except (TypeError, ValueError):
            return values
    return values


def _numbers(values: Any) -> Any:
    """Values as they are; moments and spans of time as seconds, those of today to less than a microsecond."""
    if values.dtype.kind not in "mM":
        return values
    ns = values.astype("datetime64[ns]" if values.dtype.kind == "M" else "timedelta64[ns]").astype(np.int64)
    whole = int(ns[0]) // 1_000_000_000 if ns.size else 0
    return whole + (ns - whole * 1_000_000_000) * 1e-9
