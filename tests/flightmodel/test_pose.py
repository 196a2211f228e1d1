"""A flight that was seen from outside: the motion of the simulator, with what cameras leave open."""

from __future__ import annotations

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
