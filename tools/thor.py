"""A flight log of the University of Minnesota's Ultra Stick 25e (.mat) becomes a recording and a vehicle file.

    python tools/thor.py thor_flight75.mat -o thor.mcap --vehicle thor.toml
    gcs identify thor.mcap --vehicle thor.toml

The log is of their insgnss_tools repository (MIT licence): a structure `flight_data` of columns at 50 Hz. Nothing is
made up: what the log does not hold, or holds as a stand-in, is left out of the recording. Left out are the surfaces and
the throttle while the pilot flies (the columns then repeat one value), GPS samples between two fixes (the columns
repeat the last), and everything that the log's own filter derives but the attitude. The vehicle file takes surfaces
from the named values that carry them, as commands in rad, and says what else the log leaves open:
docs/explanation/real-flights.md.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from gcs.errors import GcsError, ImportFileError
from gcs.importers import messages as make
from gcs.importers.synthesis import ImportedLog, Ints, Series, whole, write_recording

Values = NDArray[np.float64]

FIXED_WING, GENERIC_AUTOPILOT = 1, 0
AUTOPILOT_FLIES = 2  # flight_data.mode
FIX_3D = 3
NAMED = {"de": "de", "dr": "dr", "throttle": "dthr"}
COLUMNS = (
    *("time", "mode", "p", "q", "r", "ax", "ay", "az", "phi", "theta", "psi", "ias", "aoa", "aos", "Ps", "h"),
    *("lat", "lon", "alt", "vn", "ve", "vd", "GPS_TOW", "satVisible", "de", "da_l", "da_r", "dr", "dthr"),
    *("motor_time", "motor_throttle", "motor_RPM"),
)  # fmt: skip
_MOTOR_INTERVAL_S = 0.5
_LARGEST_SHIFT_S = 30.0

VEHICLE = """# Ultra Stick 25e "Thor" in the flight of {name}: written by tools/thor.py;
# see docs/explanation/real-flights.md.

name = "thor"

[mass]                 # published with the aircraft's simulation, not weighed for this flight
mass = 1.959
Ixx = 0.07151
Iyy = 0.08636
Izz = 0.15364
Ixz = 0.014

[geometry]
S = 0.3097
b = 1.27
c = 0.25

[controls.elevator]    # the log holds commands in rad, no pulses: [signals] below
servo = 2
pwm = [1000, 1500, 2000]
deflection = [-0.436, 0.0, 0.436]

[controls.aileron]
servo = 1
pwm = [1000, 1500, 2000]
deflection = [-0.436, 0.0, 0.436]

[controls.rudder]
servo = 4
pwm = [1000, 1500, 2000]
deflection = [-0.436, 0.0, 0.436]

[controls.throttle]
servo = 3
pwm = [1000, 2000]
deflection = [0.0, 1.0]

[propulsion]           # published motor and propeller (APC 12 x 6E)
line = [0.297, 0.0, -0.046]
diameter = 0.3048
rotation = "cw"
max_thrust = 7.86
max_rpm = 9634
tau = 0.169
CT = [
    [0.0, 0.0604], [0.1, 0.06336686], [0.2, 0.05428976], [0.3, 0.03809566], [0.4, 0.01867616], [0.5, -0.0011125],
    [0.6, -0.01944944],
]
CQ = [
    [0.0, 0.00354916], [0.1, 0.00380319], [0.2, 0.00379448], [0.3, 0.00330612], [0.4, 0.00231421], [0.5, 0.00098795],
    [0.6, -0.00031044],
]

[sensors]              # places of the probe published
accelerometer = {{ position = [0.0, 0.0, 0.0] }}
alpha_vane = {{ position = [0.197, 0.356, 0.0] }}
beta_vane = {{ position = [0.197, 0.356, 0.0], kind = "sideslip" }}
airspeed = {{ kind = "calibrated" }}

[signals]
de = {{ message = "NAMED_VALUE_FLOAT", name = "de", field = "value", scale = 1.0 }}
da = {{ message = "NAMED_VALUE_FLOAT", name = "da", field = "value", scale = 1.0 }}
dr = {{ message = "NAMED_VALUE_FLOAT", name = "dr", field = "value", scale = 1.0 }}
throttle = {{ message = "NAMED_VALUE_FLOAT", name = "throttle", field = "value", scale = 1.0 }}
rpm = {{ message = "RPM", field = "rpm1", scale = 2.0 }}    # the controller's log counts half of the turns

[environment]          # no thermometer in the log: static pressure of the flight at the standard atmosphere's 15 degC
air_density = {density:.4f}
"""


def read_log(path: Path) -> dict[str, Values]:
    """Columns of the log, (N,) each, those of the motor (M,). Raises ImportFileError where one is missing."""
    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except (OSError, ValueError, NotImplementedError, TypeError) as error:
        raise ImportFileError(f"{path}: not a MATLAB file that can be read ({error})") from None
    data = content.get("flight_data")
    missing = [name for name in COLUMNS if not hasattr(data, name)]
    if missing:
        raise ImportFileError(f"{path}: no flight log of this kind; flight_data lacks {', '.join(missing)}")
    columns = {name: np.atleast_1d(np.asarray(getattr(data, name), np.float64)) for name in COLUMNS}
    for name, values in columns.items():
        like = "motor_time" if name.startswith("motor_") else "time"
        if values.shape != columns[like].shape:
            raise ImportFileError(f"{path}: {name} has {values.size} samples, {like} has {columns[like].size}")
    return columns


def motor_shift(log: dict[str, Values]) -> float:
    """Seconds to take off the motor log's clock: where its throttle pulse fits the throttle command best.

    Raises ImportFileError where the autopilot never moved the throttle.
    """
    flown = log["mode"] == AUTOPILOT_FLIES
    if flown.sum() < 2 or np.ptp(log["dthr"][flown]) == 0.0:
        raise ImportFileError("the throttle never moved: the motor log cannot be put on the flight's clock")
    first, last = log["time"][flown][[0, -1]]
    moments = np.arange(first, last, _MOTOR_INTERVAL_S)
    command = np.interp(moments, log["time"], log["dthr"])
    shifts = np.arange(-_LARGEST_SHIFT_S, _LARGEST_SHIFT_S, 0.05)
    pulses = (np.interp(moments + shift, log["motor_time"], log["motor_throttle"]) for shift in shifts)
    agreement = [np.corrcoef(command, pulse)[0, 1] if np.ptp(pulse) > 0.0 else -1.0 for pulse in pulses]
    return float(shifts[int(np.argmax(agreement))])


def imported(log: dict[str, Values], command_delay: float = 0.0) -> ImportedLog:
    """The log as standard messages; commands are stamped `command_delay` s later than they stand in the log."""
    time_us = np.rint(1e6 * log["time"]).astype(np.int64)
    unknown = np.full(time_us.size, np.nan)
    motion = make.highres_imu(
        time_us, make.ACCELERATION | make.ROTATION, 0,
        xacc=log["ax"], yacc=log["ay"], zacc=log["az"], xgyro=log["p"], ygyro=log["q"], zgyro=log["r"],
    )  # fmt: skip
    flow = {"aoa": np.degrees(log["aoa"]).astype(np.float32), "ssa": np.degrees(log["aos"]).astype(np.float32)}
    series = [
        motion,
        make.attitude(time_us, log["phi"], log["theta"], log["psi"]),
        Series("AOA_SSA", time_us, {"time_usec": time_us.astype(np.uint64), **flow}),
        make.airspeed(time_us, log["ias"], unknown, unknown, np.ones(time_us.size, np.bool_)),
        *make.static_pressure(time_us, 1e3 * log["Ps"], unknown, log["h"]),
        *_fixes(log, time_us),
        *_commands(log, time_us + round(1e6 * command_delay)),
    ]
    shift = motor_shift(log)
    motor_us = np.rint(1e6 * (log["motor_time"] - shift)).astype(np.int64)
    within = motor_us >= 0
    series.append(Series("RPM", motor_us[within], {"rpm1": log["motor_RPM"][within].astype(np.float32)}))
    stamps = np.concatenate([entry.time_us for entry in series])
    flown = [(int(time_us[0]), 1)]
    series.append(make.heartbeats(stamps, vehicle=FIXED_WING, autopilot=GENERIC_AUTOPILOT, armed=flown, mode=[]))
    surfaces = f"commands where the autopilot flies, stamped {command_delay:g} s late"
    notes = {"motor_log": f"{-shift:+.2f} s put on its clock", "surfaces": surfaces}
    return ImportedLog("mat", 1, series, None, notes)


def _fixes(log: dict[str, Values], time_us: Ints) -> list[Series]:
    """GPS where a new fix has come; before the first one the columns hold defaults."""
    new = (np.diff(log["GPS_TOW"], prepend=log["GPS_TOW"][0]) != 0.0) & (log["GPS_TOW"] > 0.0)
    at, part = time_us[new], {name: values[new] for name, values in log.items() if values.size == time_us.size}
    unknown = np.full(at.size, np.nan)
    fix = make.gps(
        at, fix=np.full(at.size, FIX_3D), latitude=part["lat"], longitude=part["lon"], altitude=part["alt"],
        speed=np.hypot(part["vn"], part["ve"]), course=np.arctan2(part["ve"], part["vn"]), hdop=unknown, vdop=unknown,
        satellites=part["satVisible"],
    )  # fmt: skip
    return [fix, make.local_position(at, [unknown] * 3, [part["vn"], part["ve"], part["vd"]])]


def _commands(log: dict[str, Values], time_us: Ints) -> list[Series]:
    """Surfaces (rad) and throttle (0 to 1) while the autopilot commands them."""
    flown = log["mode"] == AUTOPILOT_FLIES
    values = {name: log[column] for name, column in NAMED.items()} | {"da": 0.5 * (log["da_r"] - log["da_l"])}
    return [_named(name, time_us[flown], entry[flown]) for name, entry in values.items()]


def _named(name: str, time_us: Ints, values: Values) -> Series:
    letters = np.frombuffer(np.array([name], "S10").tobytes(), np.uint8)
    fields: dict[str, NDArray[Any]] = {
        "time_boot_ms": whole(time_us / 1e3, "uint32"),
        "name": np.tile(letters, (time_us.size, 1)),
        "value": values.astype(np.float32),
    }
    return Series("NAMED_VALUE_FLOAT", time_us, fields)


def air_density(log: dict[str, Values]) -> float:
    """kg/m3 at the mean static pressure of the flight, 15 degC."""
    flown = log["mode"] == AUTOPILOT_FLIES
    return float(1e3 * np.mean(log["Ps"][flown]) / (287.05287 * 288.15))


def convert(source: Path, target: Path, vehicle: Path, command_delay: float = 0.0) -> None:
    """Write recording and vehicle file. Raises GcsError subclasses in one line."""
    log = read_log(source)
    for path in (target, vehicle):
        if path.exists():
            raise ImportFileError(f"{path} exists already; choose another name, or remove it first")
    write_recording(imported(log, command_delay), source, target)
    vehicle.write_text(VEHICLE.format(name=source.name, density=air_density(log)), encoding="utf-8")


def main() -> int:
    """Convert one log."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--vehicle", type=Path, required=True)
    parser.add_argument("--command-delay", type=float, default=0.0, help="s by which the surfaces are behind the log")
    options = parser.parse_args()
    try:
        convert(options.source, options.output, options.vehicle, options.command_delay)
    except GcsError as error:
        print(f"thor.py: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
