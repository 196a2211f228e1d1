"""ArduPilot's onboard logs (.bin, their text, Mission Planner's .mat) onto standard messages.

Fields and units: ardupilot.org, "Onboard Message Log Messages".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.flights.signals import IMPORT_WARNING
from gcs.importers import messages as make
from gcs.importers.dataflash import DESCRIPTIONS, DataflashLog, Table, boots, read_dataflash, read_mission_planner
from gcs.importers.synthesis import (
    ImportedLog,
    Ints,
    Progress,
    Series,
    one_after_another,
    utc_offset,
    whole,
    without_strays,
    write_recording,
)

FORMAT, TEXT, MATLAB = "dataflash", "dataflash text", "dataflash matlab"
AUTOPILOT = 3  # MAV_AUTOPILOT_ARDUPILOTMEGA
REAL32 = 9  # MAV_PARAM_TYPE_REAL32; ArduPilot sends every parameter as a float
FIX_3D = 3
GOOD_RANGE = 4  # RangeFinder::Status::Good
EV_ARMED, EV_DISARMED = 10, 11
_VEHICLES = {"ArduPlane": 1, "ArduCopter": 2, "ArduRover": 10, "Rover": 10, "ArduSub": 12, "Blimp": 7}
_SYSTEM_PARAMETERS = ("SYSID_THISMAV", "MAV_SYSID")
_INSTANCE_FIELDS = ("I", "Instance")
_PRIMARY_FIELDS = ("Pri", "Primary")

_GPS_EPOCH_S = 315_964_800
_WEEK_S = 604_800

Values = NDArray[np.float64]
#: GPS less UTC, s, from each UTC second on (IERS Bulletin C).
_LEAP_SECONDS = ((1_483_228_800, 18), (1_435_708_800, 17), (1_341_100_800, 16), (1_230_768_000, 15), (0, 14))


def import_dataflash(source: Path, target: Path, progress: Progress = lambda share: None, name: str = "") -> None:
    """Write a .bin log as a recording, called `name` there. ImportFileError where there is nothing in it to use."""
    logs = [_Mapping(part).log() for part in boots(read_dataflash(source))]
    write_recording(one_after_another(logs), source, target, progress, name)


def import_mission_planner(source: Path, target: Path, progress: Progress = lambda share: None, name: str = "") -> None:
    """Write a log that Mission Planner saved as .mat as a recording, as `import_dataflash` does."""
    logs = [replace(_Mapping(part).log(), format=MATLAB) for part in boots(read_mission_planner(source))]
    write_recording(one_after_another(logs), source, target, progress, name)


def _utc_us(week: NDArray[Any], milliseconds: NDArray[Any]) -> Ints:
    """(N,) UTC of a GPS week and its milliseconds."""
    seconds = _GPS_EPOCH_S + week.astype(np.int64) * _WEEK_S
    leap = np.select([seconds >= since for since, _ in _LEAP_SECONDS], [count for _, count in _LEAP_SECONDS])
    return np.asarray((seconds - leap) * 1_000_000 + milliseconds.astype(np.int64) * 1000, np.int64)


class _Mapping:
    """One log on its way to MAVLink."""

    def __init__(self, log: DataflashLog) -> None:
        self._file = log
        self._tables = {name: table for name, table in log.tables.items() if table.is_timed and len(table)}
        self._used: set[str] = set()
        self._left_out: set[str] = set()
        self._notes: dict[str, str] = {}

    def log(self) -> ImportedLog:
        """All series of the log, and notes of what has no counterpart."""
        series: list[Series] = []
        steps: tuple[Callable[[], list[Series]], ...] = (
            self._parameters,
            self._texts,
            self._imu,
            self._magnetometer,
            self._barometer,
            self._airspeed,
            self._attitude,
            self._angles_of_flow,
            self._gps,
            self._local_position,
            self._range,
            self._rpm,
            self._battery,
            self._servos,
            self._rc,
        )
        for step in steps:
            series += step()
        series, strays = without_strays(series)
        if any(entry.time_us.size for entry in series):
            series.append(self._heartbeats(series))
        rest = sorted((set(self._file.tables) - self._used - DESCRIPTIONS) | self._left_out)
        notes = {
            **self._notes,
            "not_mapped": " ".join(rest),
            "skipped_bytes": str(self._file.skipped),
            "unfinished_bytes": str(self._file.unfinished),
            "odd_stamps": str(strays),
            **({"unreadable": " ".join(self._file.unreadable)} if self._file.unreadable else {}),
            **({} if self._armed() is not None else {"armed": "not in the log; HEARTBEAT says disarmed"}),
        }
        return ImportedLog(TEXT if self._file.is_text else FORMAT, self._system(), series, self._utc_offset(), notes)

    def _table(self, name: str, *fields: str) -> Table | None:
        """The messages of that name, if the log has them with these fields."""
        table = self._tables.get(name)
        if table is None or any(field not in table for field in fields):
            return None
        self._used.add(name)
        return table

    def _first(self, name: str, *fields: str) -> Table | None:
        """As `_table`, of several instances the one that the autopilot used most if logged, else the lowest."""
        table = self._table(name, *fields)
        instance = next((field for field in _INSTANCE_FIELDS if table is not None and field in table), None)
        if table is None or instance is None:
            return table
        number = whole(table.values(instance), "int64")
        chosen = _most_used(table, number)
        self._left_out.update(f"{name}[{other}]" for other in np.unique(number).tolist() if other != chosen)
        return table.only(number == chosen)

    def _system(self) -> int:
        table = self._tables.get("PARM")
        if table is not None and "Name" in table:
            for name, value in zip(table.texts("Name"), table.values("Value").tolist(), strict=True):
                if name in _SYSTEM_PARAMETERS and 1 <= value <= 255:
                    return int(value)
        return 1

    def _parameters(self) -> list[Series]:
        table = self._table("PARM", "Name", "Value")
        if table is None:
            return []
        values = table.values("Value").astype(np.float32)
        return [make.parameters(table.time_us.tolist(), table.texts("Name"), values, [REAL32] * len(table))]

    def _texts(self) -> list[Series]:
        table = self._table("MSG", "Message")
        if table is None:
            return []
        texts = zip(table.time_us.tolist(), table.texts("Message"), strict=True)
        return [make.status_texts([(time, make.INFO, text) for time, text in texts])]

    def _imu(self) -> list[Series]:
        parts: list[tuple[int, Table]] = []
        for name, number in (("IMU", 0), ("IMU2", 1), ("IMU3", 2)):
            table = self._table(name, "GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ")
            if table is None:
                continue
            instances = whole(table.values("I"), "uint8") if "I" in table else np.full(len(table), number)
            parts += [(instance, table.only(instances == instance)) for instance in np.unique(instances).tolist()]
        if parts and parts[0][0] > 0:
            self._notes["imu"] = f"instance {parts[0][0]} is the first that was logged, and given as 0"
        series = []
        for instance, (_, part) in enumerate(parts):
            given = {f"{axis.lower()}acc": part.values(f"Acc{axis}") for axis in "XYZ"}
            given |= {f"{axis.lower()}gyro": part.values(f"Gyr{axis}") for axis in "XYZ"}
            if instance == 0:
                given |= self._healthy(given, parts)
            bits = make.ACCELERATION | make.ROTATION
            series.append(make.highres_imu(part.time_us, bits, int(instance), **given))
        return series

    def _healthy(self, given: dict[str, Values], parts: list[tuple[int, Table]]) -> dict[str, Values]:
        """What of the first unit's readings its autopilot called unhealthy, by another unit that was healthy then."""
        (number, first), *others = parts
        found = dict(given)
        for sensor, flag, name in (("Gyr", "GH", "gyroscope"), ("Acc", "AH", "accelerometer")):
            bad = first.values(flag) == 0.0
            if not bad.any():
                continue
            begin, count, left = first.time_us[bad][0], int(bad.sum()), bad.copy()
            used = []
            for other, table in others:
                good = table.only(table.values(flag) != 0.0)
                near = left & _is_near(first.time_us, good.time_us)
                if near.any():
                    used.append(str(other))
                for axis in "XYZ" if near.any() else "":
                    key = f"{axis.lower()}{sensor.lower()}".replace("gyr", "gyro")
                    found[key] = found[key].copy()
                    found[key][near] = np.interp(first.time_us[near], good.time_us, good.values(f"{sensor}{axis}"))
                left &= ~near
            instead = f"{name} {' and '.join(used)} stands there" if used else "no other was healthy: taken as it is"
            self._notes[f"{IMPORT_WARNING}{name}"] = (
                f"{name} {number} was unhealthy by its own flag (IMU.{flag} = 0) in {count} of {len(first)} samples,"
                f" from {(begin - first.time_us[0]) / 1e6:.1f} s on: {instead}"
            )
        return found

    def _magnetometer(self) -> list[Series]:
        table = self._first("MAG", "MagX", "MagY", "MagZ")
        if table is None:
            return []
        given = {f"{axis.lower()}mag": 1e-3 * table.values(f"Mag{axis}") for axis in "XYZ"}
        return [make.highres_imu(table.time_us, make.MAGNETISM, 0, **given)]

    def _barometer(self) -> list[Series]:
        table = self._first("BARO", "Press", "Temp")
        if table is None:
            return []
        temperature = self._air_temperature(table.time_us)
        if not np.isfinite(temperature).any():
            temperature = make.celsius(table.values("Temp"))
            self._notes["temperature"] = make.OF_THE_BAROMETER
        return make.static_pressure(table.time_us, table.values("Press"), temperature, table.values("AltAMSL"))

    def _air_temperature(self, time_us: Ints) -> NDArray[np.float64]:
        """(N,) degC by the airspeed sensor at these times; NaN where there is none that has a thermometer."""
        table = self._first("ARSP", "Temp")
        known = np.empty(0) if table is None else make.celsius(table.values("Temp"))
        if table is None or not known.any():  # 0 throughout is ArduPilot's "unknown"
            return np.full(time_us.size, np.nan)
        return make.at_times(time_us, table.time_us, known)

    def _airspeed(self) -> list[Series]:
        table = self._first("ARSP", "Airspeed", "DiffPress")
        if table is None:
            return []
        pressure = table.values("DiffPress")
        healthy = ~(table.values("H", "Health") == 0.0)
        temperature = self._air_temperature(table.time_us)
        reading = make.airspeed(table.time_us, table.values("Airspeed"), pressure, temperature, healthy)
        bits = make.DIFFERENTIAL_PRESSURE
        return [reading, make.highres_imu(table.time_us, bits, 0, diff_pressure=pressure / 100.0)]

    def _attitude(self) -> list[Series]:
        table = self._table("ATT", "Roll", "Pitch", "Yaw")
        if table is None:
            return []
        roll, pitch, yaw = (np.radians(table.values(name)) for name in ("Roll", "Pitch", "Yaw"))
        return [make.attitude(table.time_us, roll, pitch, yaw)]

    def _angles_of_flow(self) -> list[Series]:
        table = self._table("AOA", "AOA", "SSA")
        if table is None:
            return []
        fields = {"aoa": table.values("AOA").astype(np.float32), "ssa": table.values("SSA").astype(np.float32)}
        return [Series("AOA_SSA", table.time_us, {"time_usec": table.time_us.astype(np.uint64), **fields})]

    def _gps(self) -> list[Series]:
        table = self._first("GPS", "Status", "Lat", "Lng", "Alt", "Spd", "GCrs")
        if table is None:
            return []
        fixes = make.gps(
            table.time_us,
            fix=table.values("Status"),
            latitude=table.values("Lat"),
            longitude=table.values("Lng"),
            altitude=table.values("Alt"),
            speed=table.values("Spd"),
            course=np.radians(table.values("GCrs")),
            hdop=table.values("HDop"),
            vdop=np.full(len(table), np.nan),
            satellites=table.values("NSats"),
        )
        times, utc = self._gps_time()
        return [fixes, make.system_time(times, utc)]

    def _gps_time(self) -> tuple[Ints, Ints]:
        """Times in us at which the GPS knew UTC, and that UTC in us."""
        table = self._tables.get("GPS")
        week, milliseconds = next(
            (pair for pair in (("GWk", "GMS"), ("Week", "TimeMS")) if table is not None and pair[0] in table), ("", "")
        )
        if table is None or any(field not in table for field in ("Status", week, milliseconds)):
            return np.empty(0, np.int64), np.empty(0, np.int64)
        known = table.only((table.rows["Status"] >= FIX_3D) & (table.rows[week] > 0))
        return known.time_us, _utc_us(whole(known.values(week), "uint16"), whole(known.values(milliseconds), "uint32"))

    def _utc_offset(self) -> int | None:
        return utc_offset(*self._gps_time())

    def _local_position(self) -> list[Series]:
        for name in ("XKF1", "NKF1", "EKF1"):
            table = self._table(name, "PN", "PE", "PD", "VN", "VE", "VD")
            if table is None:
                continue
            if "C" in table:
                table = table.only(table.rows["C"] == self._core(name, table))
            position = [table.values(field) for field in ("PN", "PE", "PD")]
            velocity = [table.values(field) for field in ("VN", "VE", "VD")]
            return [make.local_position(table.time_us, position, velocity)]
        return []

    def _core(self, name: str, table: Table) -> int:
        """The estimator's core that was the primary one for longest, else the lowest that is in the log."""
        cores = np.unique(table.rows["C"])
        estimator = self._tables.get(f"{name[:-1]}4")
        primary = np.empty(0) if estimator is None else estimator.values("PI")
        primary = primary[np.isin(primary, cores)].astype(np.int64)
        return int(np.bincount(primary).argmax() if primary.size else cores.min())

    def _range(self) -> list[Series]:
        table = self._first("RFND", "Dist", "Orient")
        if table is None:
            return []
        good = table.only(table.rows["Stat"] == GOOD_RANGE) if "Stat" in table else table
        none = np.zeros(len(good))
        return [make.distance(good.time_us, good.values("Dist"), none, none, good.values("Orient"))]

    def _rpm(self) -> list[Series]:
        table = self._table("RPM", "rpm1", "rpm2") or self._first("RPM", "RPM") or self._first("ESC", "RPM")
        if table is None:
            return []
        speeds = {"rpm1": table.values("rpm1", "RPM")}
        if "rpm2" in table:
            speeds["rpm2"] = table.values("rpm2")
        if table.name == "RPM":  # -1 where the sensor is not healthy
            unhealthy = table.values("H") == 0.0
            speeds = {name: np.where((rpm < 0.0) | unhealthy, np.nan, rpm) for name, rpm in speeds.items()}
        return [Series("RPM", table.time_us, {name: rpm.astype(np.float32) for name, rpm in speeds.items()})]

    def _battery(self) -> list[Series]:
        table = self._first("BAT", "Volt", "Curr")
        return [] if table is None else [make.battery(table.time_us, table.values("Volt"), table.values("Curr"))]

    def _servos(self) -> list[Series]:
        table = self._table("RCOU")
        return [] if table is None else [make.servo_outputs(table.time_us, _channels(table), 0)]

    def _rc(self) -> list[Series]:
        table = self._table("RCIN")
        return [] if table is None else [make.rc_channels(table.time_us, _channels(table))]

    def _armed(self) -> list[tuple[int, int]] | None:
        """(time in us, 1 or 0) from then on; None where the log does not say."""
        for name, field in (("ARM", "ArmState"), ("EV", "Id"), ("STAT", "Armed")):
            table = self._table(name, field)
            if table is None:
                continue
            states = table.values(field)
            if name == "EV":
                changes = (states == EV_ARMED) | (states == EV_DISARMED)
                table, states = table.only(changes), states[changes] == EV_ARMED
            armed = [(time, int(state != 0)) for time, state in zip(table.time_us.tolist(), states, strict=True)]
            if armed and name != "STAT":
                # The log has changes only; before the first it was the other way round.
                armed.insert(0, (min(t.time_us.min() for t in self._tables.values()), 1 - armed[0][1]))
            if armed:
                return armed
        return None

    def _heartbeats(self, series: list[Series]) -> Series:
        times = np.concatenate([entry.time_us for entry in series])
        texts = self._tables["MSG"].texts("Message") if "MSG" in self._tables else []
        vehicle = next((kind for text in texts for name, kind in _VEHICLES.items() if text.startswith(name)), 0)
        modes = self._table("MODE")
        mode: list[tuple[int, int]] = []
        if modes is not None:
            numbers = whole(modes.values("ModeNum", "Mode"), "uint8")
            mode = list(zip(modes.time_us.tolist(), numbers.tolist(), strict=True))
        return make.heartbeats(
            times,
            vehicle=vehicle,
            autopilot=AUTOPILOT,
            armed=self._armed() or [],
            mode=mode,
        )


def _most_used(table: Table, number: Ints) -> int:
    """The instance that the messages themselves name as primary, or that a GPS was used from; else the lowest."""
    votes = np.empty(0, np.int64)
    primary = next((field for field in _PRIMARY_FIELDS if field in table), None)
    if primary is not None:
        votes = whole(table.values(primary), "uint8").astype(np.int64)
        votes = votes[np.isin(votes, number)]
    elif table.name == "GPS" and "U" in table:
        votes = number[table.values("U") == 1.0]
    return int(np.bincount(votes).argmax() if votes.size else number.min())


def _is_near(time_us: Ints, known_us: Ints) -> NDArray[np.bool_]:
    """(N,) whether another sensor's readings lie about a moment, none of them further than two of its intervals."""
    if known_us.size < 2:
        return np.zeros(time_us.size, bool)
    reach = 2 * int(np.median(np.diff(known_us)))
    place = np.clip(np.searchsorted(known_us, time_us), 1, known_us.size - 1)
    away = np.minimum(np.abs(known_us[place] - time_us), np.abs(time_us - known_us[place - 1]))
    return np.asarray(away <= reach)


def _channels(table: Table) -> list[NDArray[np.float64]]:
    """Pulses of channels 1, 2, …; older logs call them Ch1 or Chan1."""
    found = []
    for number in range(1, 19):
        names = (f"C{number}", f"Ch{number}", f"Chan{number}")
        if not any(name in table for name in names):
            break
        found.append(table.values(*names))
    return found


__all__ = ["import_dataflash", "import_mission_planner"]
