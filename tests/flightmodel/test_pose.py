"""A flight that was seen from outside: the motion of the simulator, with what cameras leave open."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated import fly_mav

from flightmodel import Aircraft, Flight, identify
from flightmodel.errors import FlightModelError
from sim_vehicle.model.model_file import read_model
from sysid.errors import TableError

RATE_HZ = 100.0


@pytest.fixture(scope="module")
def seen() -> dict[str, np.ndarray]:
    """Poses at 100 Hz, 1 mm and 0.1 deg of noise, the paper's aircraft in still air."""
    _, flown = fly_mav("multisine", 5, duration=40.0)
    time = np.arange(0.0, flown.time_s[-1], 1.0 / RATE_HZ)
    truth = {name: np.interp(time, flown.time_s, values) for name, values in flown.truth.items() if name != "psi"}
    truth["psi"] = np.interp(time, flown.time_s, np.unwrap(flown.truth["psi"]))
    noise = np.random.default_rng(1)
    place = np.column_stack([truth[name] for name in ("north", "east", "down")])
    turned = Rotation.from_euler("ZYX", np.column_stack([truth[name] for name in ("psi", "theta", "phi")]))
    turned = turned * Rotation.from_rotvec(np.radians(0.1) * noise.standard_normal((time.size, 3)))
    held = np.searchsorted(flown.time_s, time, side="right") - 1
    return {
        "time": time, "position": place + 1e-3 * noise.standard_normal(place.shape),
        "quaternion": turned.as_quat()[:, [3, 0, 1, 2]],
        **{f"in_{name}": flown.command[held, i] for i, name in enumerate(("de", "da", "dr", "throttle"))},
        "in_thrust": truth["thrust"], **{f"true_{name}": values for name, values in truth.items()},
    }  # fmt: skip


def flight_of(seen: dict[str, np.ndarray], **changed: np.ndarray) -> Flight:
    inputs = {name[3:]: values for name, values in seen.items() if name.startswith("in_")}
    given = seen | changed
    return Flight.from_pose(given["time"], given["position"], given["quaternion"], inputs=inputs)


def test_what_sensors_would_have_read_follows_from_the_pose(seen: dict[str, np.ndarray]) -> None:
    flight = flight_of(seen)
    inner = slice(100, -100)
    for name, within in (("p", 0.05), ("q", 0.05), ("alpha", 0.004), ("ax", 0.25), ("az", 0.6), ("vn", 0.02)):
        stamps, values = flight[name]
        off = values - np.interp(stamps, seen["time"], seen[f"true_{name}"])
        assert np.std(off[inner]) < within, name
        assert abs(np.mean(off[inner])) < 0.2 * within, name


def test_the_model_follows_within_its_intervals(seen: dict[str, np.ndarray]) -> None:
    aircraft = Aircraft.read("iitb-mav")
    found = identify(flight_of(seen), aircraft, progress=False)
    truth = read_model("iitb-mav").values()
    held, off = 0, []
    for name in ("CL_alpha", "Cm_alpha", "Cm_de", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "CY_beta"):
        entry = found.model.coefficients[name]
        assert entry.value is not None, name
        assert entry.std is not None
        off.append(abs(entry.value - truth[name]) / entry.std)
        held += off[-1] <= 2.0
    assert held >= 7
    assert max(off) < 3.5


def test_axes_of_ros_give_the_same(seen: dict[str, np.ndarray]) -> None:
    earth, body = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.diag([1, -1, -1])
    rows = earth.T @ Rotation.from_quat(seen["quaternion"][:, [1, 2, 3, 0]]).as_matrix() @ body
    turned = Rotation.from_matrix(rows).as_quat()[:, [3, 0, 1, 2]]
    inputs = {"de": seen["in_de"]}
    ned = Flight.from_pose(seen["time"], seen["position"], seen["quaternion"], inputs=inputs)
    enu = Flight.from_pose(seen["time"], seen["position"] @ earth, turned, inputs=inputs, frame="enu")
    for name in ("q", "az", "alpha", "psi"):
        assert enu[name][1] == pytest.approx(ned[name][1], abs=1e-6)
    with pytest.raises(TableError, match='try frame="enu"'):
        Flight.from_pose(seen["time"], seen["position"] @ earth, turned, inputs=inputs)


def test_what_no_aircraft_does_is_said(seen: dict[str, np.ndarray]) -> None:
    w, x, y, z = seen["quaternion"].T
    with pytest.raises(TableError, match="does not fly along its nose"):
        flight_of(seen, quaternion=np.column_stack([x, y, z, w]))
    mirrored = seen["position"] * np.array([1.0, -1.0, 1.0])
    with pytest.raises(TableError, match=r"along its nose|mirrored"):
        flight_of(seen, position=mirrored, quaternion=np.column_stack([w, x, y, -z]))
    lost = seen["position"].copy()
    lost[1000:1060] = np.nan
    with pytest.raises(TableError, match=r"s without a pose from 9\.99 s on"):
        flight_of(seen, position=lost)
    with pytest.raises(TableError, match="do not go together"):
        flight_of(seen, quaternion=seen["quaternion"][:-1])
    stray = seen["time"].copy()
    stray[500] += 0.05
    assert flight_of(seen, time=stray)["q"][1] == pytest.approx(flight_of(seen)["q"][1], abs=0.1)
    with pytest.raises(TableError, match="0 poses are known"):
        Flight.from_pose(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 4)), inputs={})
    with pytest.raises(TableError, match="is no velocity"):
        Flight.from_pose(seen["time"], seen["position"], seen["quaternion"], inputs={}, wind=(1.0, float("nan"), 0.0))
    with pytest.raises(FlightModelError, match="inputs: de has the shape"):
        Flight.from_pose(seen["time"], seen["position"], seen["quaternion"], inputs={"de": seen["in_de"][:9]})


def table_of(seen: dict[str, np.ndarray], places: str, frame: str = "ned") -> dict[str, np.ndarray]:
    """Columns as motion capture writes them."""
    position, turned = seen["position"], Rotation.from_quat(seen["quaternion"][:, [1, 2, 3, 0]])
    if frame == "enu":
        earth, body = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.diag([1, -1, -1])
        position = position @ earth
        turned = Rotation.from_matrix(earth.T @ turned.as_matrix() @ body)
    columns = {"time (s)": seen["time"], **dict(zip(places.split(), position.T, strict=True))}
    columns |= dict(zip(("qx", "qy", "qz", "qw"), turned.as_quat().T, strict=True))
    inputs = {"elevator (rad)": "de", "aileron (rad)": "da", "rudder (rad)": "dr", "throttle": "throttle"}
    return {**columns, **{header: seen[f"in_{name}"] for header, name in inputs.items()}}


@pytest.mark.parametrize(
    ("places", "frame"),
    [
        ("x y z", "ned"),
        ("pos_x pos_y pos_z", "enu"),
        ("pn pe pd", "ned"),
        ("rigid_body_tx rigid_body_ty rigid_body_tz", "enu"),
    ],
)
def test_a_table_of_poses_is_the_same_flight(
    places: str, frame: str, seen: dict[str, np.ndarray], tmp_path: Path
) -> None:
    table = table_of(seen, places, frame)
    path = tmp_path / "hall.csv"
    np.savetxt(path, np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments="")
    units = {"throttle": "1"}
    read, own = Flight.read(path, units=units), flight_of(seen)
    for name in ("p", "q", "ax", "az", "alpha", "true_airspeed"):
        assert read[name][1] == pytest.approx(own[name][1], abs=1e-5), name
    for name in ("de", "da", "throttle"):
        assert read[name][1] == pytest.approx(own[name][1], abs=1e-9), name
    assert any(
        line.startswith("alpha: column 'alpha of position and quaternion, in still air") for line in read.columns
    )


def test_arrays_of_numpy_are_a_table(seen: dict[str, np.ndarray], tmp_path: Path) -> None:
    path = tmp_path / "hall.npz"
    arrays = {"time": seen["time"], "position": seen["position"], "quaternion": seen["quaternion"]}
    np.savez_compressed(path, **arrays, de=seen["in_de"], note=np.array(["flown in a hall"] * 2))
    read = Flight.read(path, units="SI")
    assert read["q"][1] == pytest.approx(flight_of(seen)["q"][1], abs=1e-9)
    np.savez(path, time=np.array([{}, {}]), de=seen["in_de"])
    with pytest.raises(TableError, match=r"no \.npz of arrays of numbers"):
        Flight.read(path)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(TableError, match=r"no \.npz of arrays of numbers"):
        Flight.read(path)


def test_units_of_a_table_of_poses(seen: dict[str, np.ndarray], tmp_path: Path) -> None:
    table = table_of(seen, "x y z")
    milli = {"time (ms)": 1e3 * table.pop("time (s)")}
    milli |= {f"{axis} (mm)": 1e3 * table.pop(axis) for axis in "xyz"}
    path = tmp_path / "hall.csv"
    table = {**milli, **table}
    np.savetxt(path, np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments="")
    read = Flight.read(path, units={"throttle": "1"})
    assert read["true_airspeed"][1] == pytest.approx(flight_of(seen)["true_airspeed"][1], abs=1e-4)


def test_a_table_of_poses_that_no_aircraft_flies_is_said(seen: dict[str, np.ndarray], tmp_path: Path) -> None:
    table = table_of(seen, "x y z")
    table["qx"], table["qw"] = table["qw"], table["qx"]
    path = tmp_path / "hall.csv"
    np.savetxt(path, np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments="")
    with pytest.raises(TableError, match="neither as north, east, down nor as east, north, up"):
        Flight.read(path, units={"throttle": "1"})


def test_axes_that_no_bank_shows_are_asked_for(seen: dict[str, np.ndarray], tmp_path: Path) -> None:
    _, theta, _ = Rotation.from_quat(seen["quaternion"][:, [1, 2, 3, 0]]).as_euler("ZYX").T
    level = Rotation.from_euler("Y", theta[:, None]).as_quat()[:, [3, 0, 1, 2]]
    north = np.linalg.norm(np.diff(seen["position"][:, :2], axis=0), axis=1)
    position = np.column_stack([np.append(0.0, np.cumsum(north)), 0.0 * theta, seen["position"][:, 2]])
    path = tmp_path / "hall.npz"
    np.savez(path, time=seen["time"], position=position, quaternion=level, de=seen["in_de"])
    with pytest.raises(TableError, match="call their columns so"):
        Flight.read(path, units="SI")
    north, east, down = position.T
    table = {"time": seen["time"], "north": north, "east": east, "down": down, "quaternion": level}
    np.savez(path, **table, de=seen["in_de"])
    assert np.mean(Flight.read(path, units="SI")["az"][1]) < -9.0


def written(path: Path, table: dict[str, np.ndarray]) -> Path:
    np.savetxt(path, np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments="")
    return path


def test_what_the_user_says_of_a_table_of_poses_holds(seen: dict[str, np.ndarray], tmp_path: Path) -> None:
    table = table_of(seen, "x y z")
    degrees = {"surface": np.degrees(table.pop("elevator (rad)"))}
    vane = {"alpha (rad)": seen["true_alpha"] + 0.1}
    path = written(tmp_path / "hall.csv", {**table, **degrees, **vane})
    number = len(table)
    read = Flight.read(path, columns={"de": number}, units={"throttle": "1", "de": "deg"})
    assert read["de"][1] == pytest.approx(flight_of(seen)["de"][1], abs=1e-6)
    # What a vane measured is not made from the motion in still air.
    assert np.mean(read["alpha"][1] - flight_of(seen)["alpha"][1]) == pytest.approx(0.1, abs=2e-3)
    named = Flight.read(path, columns={"altitude": {"z": -1.0}}, units={"throttle": "1", "surface": "deg", "z": "m"})
    assert "q" not in named.signals.signals


@pytest.mark.parametrize("short", ["de", "quaternion"])
def test_columns_of_other_lengths_are_said(short: str, seen: dict[str, np.ndarray], tmp_path: Path) -> None:
    table = {"time (s)": seen["time"], **dict(zip("xyz", seen["position"].T, strict=True)), "de": seen["in_de"]}
    table |= dict(zip(("q0", "q1", "q2", "q3"), seen["quaternion"].T, strict=True))
    table["de" if short == "de" else "q0"] = seen["in_de"][:-5]
    with pytest.raises(TableError, match=r"rows, and the time 4"):
        Flight.from_frame(table, units="SI")


def test_archives_made_to_harm_are_refused(seen: dict[str, np.ndarray], tmp_path: Path) -> None:
    path = tmp_path / "bomb.npz"
    np.savez_compressed(path, **{f"a{i}": np.zeros(60_000_000, dtype=np.uint8) for i in range(3)})
    with pytest.raises(TableError, match=r"take more than 1 GB"):
        Flight.read(path)
    np.savez_compressed(path, time=np.arange(30.0), wide=np.zeros((40, 100_000), dtype=np.uint8))
    with pytest.raises(TableError, match="columns"):
        Flight.read(path)
    for header in (b"{[]:1}", b"'''", b"{'descr': '<f8', 'fortran_order': False, 'shape': (10**26,), }"):
        text = header + b" " * (117 - len(header)) + b"\n"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("a.npy", b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text)
        with pytest.raises(TableError):
            Flight.read(path)
    flat = {"time": seen["time"], "position": seen["position"].T, "quaternion": seen["quaternion"].T}
    np.savez(path, **flat, de=seen["in_de"])
    assert Flight.read(path, units="SI")["q"][1] == pytest.approx(flight_of(seen)["q"][1], abs=1e-9)
