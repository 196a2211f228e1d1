"""A flight of the bundled simulator as a recording, and the same as tables of other programs."""

from __future__ import annotations

import csv
import math
import pickle
from pathlib import Path

import numpy as np
import pytest
from made_once import made_once
from numpy.typing import NDArray
from scipy.io import savemat

from flightmodel import Aircraft, Flight, Identification, identify
from gcs.flights.signals import extract
from gcs.recording.reader import Recording
from sim_vehicle.cli.main import main
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.signals.flight import FlightSignals

Array = NDArray[np.float64]
VEHICLE = "ultrastick25e"
DEGREE, FOOT, G, POUND, SLUG = math.pi / 180.0, 0.3048, 9.80665, 4.4482216152605, 14.593902937206


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    def make(folder: Path) -> None:
        fly = ["fly", "--vehicle", VEHICLE, "--manoeuvre", "multisine", "--seed", "5", "--duration", "25"]
        assert main([*fly, "--record", str(folder / "flight.mcap")]) == 0

    return made_once(tmp_path_factory, "flight-as-recording", make) / "flight.mcap"


@pytest.fixture(scope="session")
def identified(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Identification:
    """What the library finds in the recording."""

    def make(folder: Path) -> None:
        aircraft = Aircraft.read(VEHICLE)
        found = identify(Flight.read(recording, aircraft), aircraft, progress=False)
        (folder / "found.pickle").write_bytes(pickle.dumps(found))

    folder = made_once(tmp_path_factory, "identification-of-a-recording", make)
    found = pickle.loads((folder / "found.pickle").read_bytes())
    assert isinstance(found, Identification)
    return found


@pytest.fixture(scope="session")
def recorded(recording: Path) -> FlightSignals:
    return extract(Recording([recording]), load_vehicle(VEHICLE))


def on_rows(recorded: FlightSignals, name: str, time_s: Array) -> Array:
    """A signal at the rows of a table, NaN between its samples."""
    one = recorded.signals[name]
    values = np.full(time_s.size, np.nan)
    values[np.searchsorted(time_s, one.time_s - 1e-6)] = one.values
    return values


@pytest.fixture(scope="session")
def jsbsim_csv(recorded: FlightSignals, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The flight with the headers and units of JSBSim's CSV output; thrust, throttle and rpm as properties."""
    headers = {
        "p": ("P (deg/s)", DEGREE), "q": ("Q (deg/s)", DEGREE), "r": ("R (deg/s)", DEGREE),
        "airspeed": ("velocities/vc-kts", 1852.0 / 3600.0), "ax": ("BodyAccel_X", FOOT), "ay": ("BodyAccel_Y", FOOT),
        "az": ("BodyAccel_Z", FOOT), "vn": ("V_{North} (ft/s)", FOOT), "ve": ("V_{East} (ft/s)", FOOT),
        "vd": ("V_{Down} (ft/s)", FOOT), "phi": ("Phi (deg)", DEGREE), "theta": ("Theta (deg)", DEGREE),
        "psi": ("Psi (deg)", DEGREE), "alpha": ("Alpha (deg)", DEGREE), "beta": ("Beta (deg)", DEGREE),
        "static_pressure": ("P_{Ambient} (psf)", POUND / FOOT**2), "temperature": ("Temperature (R)", 5.0 / 9.0),
        "altitude": ("Altitude ASL (ft)", FOOT), "de": ("Elevator Position (deg)", DEGREE),
        "da": ("Aileron Position (deg)", DEGREE), "dr": ("Rudder Position (deg)", DEGREE),
        "thrust": ("propulsion/engine/thrust-lbs", POUND), "rpm": ("propulsion/engine/engine-rpm", 1.0),
        "throttle": ("fcs/throttle-pos", 1.0),
    }  # fmt: skip
    time_s = recorded.signals["q"].time_s
    columns = {header: on_rows(recorded, name, time_s) / factor for name, (header, factor) in headers.items()}
    path = tmp_path_factory.mktemp("jsbsim") / "out.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["Time", "Alpha dot (deg/s)", *columns])
        for row, moment in enumerate(time_s.tolist()):
            values = (float(one[row]) for one in columns.values())
            writer.writerow([repr(moment), "0", *("" if math.isnan(value) else repr(value) for value in values)])
    return path


@pytest.fixture(scope="session")
def sidpac_mat(recorded: FlightSignals, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The flight as SIDPAC's array, U.S. customary units; what it has no column for stands beside it."""
    time_s = recorded.signals["q"].time_s
    vehicle = load_vehicle(VEHICLE)
    fdata = np.zeros((time_s.size, 90))
    fdata[:, 0] = time_s
    density = on_rows(recorded, "air_density", time_s)
    fdata[:, 1] = on_rows(recorded, "airspeed", time_s) * np.sqrt(1.225 / density) / FOOT
    for column, name in zip(
        (2, 3, 4, 5, 6, 7, 8, 9, 13, 14, 15),
        ("beta", "alpha", *"pqr", "phi", "theta", "psi", "de", "da", "dr"),
        strict=True,
    ):
        fdata[:, column] = on_rows(recorded, name, time_s) / DEGREE
    for column, name in zip((10, 11, 12), ("ax", "ay", "az"), strict=True):
        fdata[:, column] = on_rows(recorded, name, time_s) / G
    fdata[:, 28] = density / (SLUG / FOOT**3)
    fdata[:, 29] = on_rows(recorded, "altitude", time_s) / FOOT
    fdata[:, 37] = on_rows(recorded, "thrust", time_s) / POUND
    mass = vehicle.mass
    fdata[:, 47] = mass.mass / SLUG
    fdata[:, 48:52] = np.array([mass.Ixx, mass.Iyy, mass.Izz, mass.Ixz]) / (SLUG * FOOT**2)
    geometry = vehicle.geometry
    fdata[:, 76:79] = geometry.S / FOOT**2, geometry.b / FOOT, geometry.c / FOOT
    path = tmp_path_factory.mktemp("sidpac") / "fdata.mat"
    savemat(path, {"fdata": fdata, "t": time_s})
    return path
