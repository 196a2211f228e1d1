"""Second sensors: moved to the first one's place, averaged by noise, doubted where they disagree."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_vehicle.errors import VehicleFileError
from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import TABLE_II, SensorSuite
from sim_vehicle.manoeuvres.plan import plan_of
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.sensors import Sensor
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.signals.flight import FlightData
from sysid.signals.redundant_sensors import combined_sensors

Array = NDArray[np.float64]
N, DT, SPEED = 3000, 0.02, 14.0
TIME = DT * np.arange(N)
ALPHA, BETA = 0.08 + 0.04 * np.sin(2.0 * TIME), 0.06 * np.sin(1.3 * TIME)
P, Q, R = 0.8 * np.cos(1.7 * TIME), 0.5 * np.cos(2.0 * TIME), 0.4 * np.sin(1.1 * TIME)


def vehicle(**places: Sensor) -> Vehicle:
    packaged = load_vehicle("iitb-mav")
    second = {key: place for key, place in places.items() if "2" in key}
    first = {key: place for key, place in places.items() if "2" not in key}
    return replace(packaged, sensors=replace(packaged.sensors, **first, second=second))


def vane(kind: str, place: tuple[float, float, float], noise: float, seed: int) -> Array:
    """What a vane there reads, by the rigid body's velocity at its place (to first order in rate over speed)."""
    x, y, z = place
    jitter = noise * np.random.default_rng(seed).standard_normal(N)
    if kind == "alpha":
        return np.asarray(ALPHA + (-x * Q + y * P) / SPEED + jitter)
    return np.asarray(BETA + (x * R - z * P) / SPEED + jitter)


def flight(**columns: Array) -> FlightData:
    basic = {"airspeed": np.full(N, SPEED), "p": P, "q": Q, "r": R}
    return FlightData("f", DT, TIME, basic | columns)


LEFT, RIGHT = (0.1, -0.5, 0.02), (0.15, 0.5, -0.01)


@pytest.mark.parametrize("kind", ["alpha", "beta"])
def test_two_vanes_at_two_places_give_the_first_ones_angle_with_less_noise(kind: str) -> None:
    plane = vehicle(**{f"{kind}_vane": Sensor(LEFT, kind="sideslip"), f"{kind}2_vane": Sensor(RIGHT, kind="sideslip")})
    data = flight(**{kind: vane(kind, LEFT, 0.006, 1), f"{kind}2": vane(kind, RIGHT, 0.003, 2)})
    both, shares = combined_sensors(data, plane)
    error = both[kind] - vane(kind, LEFT, 0.0, 0)
    # Noise of 6 and 3 mrad: weights 0.2 and 0.8, together 2.7 mrad.
    assert shares[kind] == pytest.approx(0.2, abs=0.03)
    assert np.std(error) == pytest.approx(0.0027, rel=0.06)
    assert abs(np.mean(error)) < 3e-4
    assert both.warnings == ()


def test_a_flank_vane_and_a_sideslip_vane_tell_the_same_angle() -> None:
    plane = vehicle(beta_vane=Sensor(kind="sideslip"), beta2_vane=Sensor(kind="flank"))
    alpha = np.full(N, 0.3)
    flank = np.arctan2(np.sin(BETA), np.cos(BETA) * np.cos(alpha))
    jitter = 1e-3 * np.random.default_rng(3).standard_normal((2, N))
    both, _ = combined_sensors(flight(alpha=alpha, beta=BETA + jitter[0], beta2=flank + jitter[1]), plane)
    assert np.std(both["beta"] - BETA) < 9e-4


@pytest.mark.parametrize(
    ("wrong", "told"),
    [(lambda x: x + 0.06, r"\+3\.[45] deg more"), (lambda x: 1.4 * x - 0.032, r"scale is 1\.(39|40)")],
)
def test_vanes_that_disagree_are_told_and_the_first_counts_alone(wrong: object, told: str) -> None:
    assert callable(wrong)
    plane = vehicle(alpha_vane=Sensor(LEFT), alpha2_vane=Sensor(RIGHT))
    data = flight(alpha=vane("alpha", LEFT, 0.003, 1), alpha2=wrong(vane("alpha", RIGHT, 0.003, 2)))
    kept, shares = combined_sensors(data, plane)
    np.testing.assert_array_equal(kept["alpha"], data["alpha"])
    assert shares["alpha"] == 1.0
    assert "alpha2" not in shares
    (warning,) = kept.warnings
    assert re.search(told, warning), warning


def test_a_gap_of_one_vane_is_bridged_by_the_other() -> None:
    plane = vehicle(alpha_vane=Sensor(LEFT), alpha2_vane=Sensor(RIGHT))
    first = vane("alpha", LEFT, 0.003, 1)
    first[400:900] = np.nan
    both, _ = combined_sensors(flight(alpha=first, alpha2=vane("alpha", RIGHT, 0.003, 2)), plane)
    assert np.isfinite(both["alpha"]).all()
    assert np.std((both["alpha"] - vane("alpha", LEFT, 0.0, 0))[400:900]) == pytest.approx(0.003, rel=0.1)


def test_a_second_vane_alone_stands_in_for_the_first() -> None:
    plane = vehicle(alpha_vane=Sensor(LEFT), alpha2_vane=Sensor(RIGHT))
    alone, shares = combined_sensors(flight(alpha2=vane("alpha", RIGHT, 0.0, 1)), plane)
    np.testing.assert_allclose(alone["alpha"], vane("alpha", LEFT, 0.0, 0), atol=1e-12)
    assert (shares["alpha"], shares["alpha2"]) == (0.0, 1.0)
    assert "only the second sensor" in alone.warnings[0]


def test_a_second_pitot_tube_on_the_other_wing_gives_the_firsts_airspeed_with_less_noise() -> None:
    plane = vehicle(airspeed=Sensor(LEFT, kind="calibrated"), airspeed2=Sensor(RIGHT, kind="calibrated"))
    jitter = 0.1 * np.random.default_rng(5).standard_normal((2, N))
    # The velocity at a place is that of the centre of gravity plus rates cross place.
    left, right = (SPEED + Q * z - R * y for _, y, z in (LEFT, RIGHT))
    both, shares = combined_sensors(flight(airspeed=left + jitter[0], airspeed2=right + jitter[1]), plane)
    assert shares["airspeed"] == pytest.approx(0.5, abs=0.1)
    assert np.std(both["airspeed"] - left) == pytest.approx(0.1 / np.sqrt(2.0), rel=0.1)
    doubted, _ = combined_sensors(flight(airspeed=left, airspeed2=right + 3.0), plane)
    assert "airspeed2 disagrees with airspeed: it reads +3.0 m/s more" in doubted.warnings[0]
    np.testing.assert_array_equal(doubted["airspeed"], left)


def test_second_sensors_leave_what_the_others_read_as_it_is() -> None:
    plane, plan = load_vehicle("iitb-mav"), plan_of(["multisine"])
    two = replace(plane, sensors=replace(plane.sensors, second={"airspeed2": Sensor((0.0, 0.3, 0.0))}))
    flown = [
        fly(Plant(one, read_model("iitb-mav")), plan, suite=SensorSuite(one, generator=4), generator=5, duration=2.0)
        for one in (plane, two)
    ]
    assert set(flown[1].measured) - set(flown[0].measured) == {"airspeed2"}
    for name, (_, values) in flown[0].measured.items():
        np.testing.assert_array_equal(values, flown[1].measured[name][1], name)
    rest = flown[1].measured["airspeed2"][1] - flown[1].measured["airspeed"][1] + 0.3 * flown[1].measured["r"][1]
    assert 0.02 < np.std(rest) < 0.04


def test_a_second_vane_of_the_other_kind_is_flown_as_it_reads() -> None:
    plane = load_vehicle("iitb-mav")
    kinds = {"beta2_vane": Sensor(plane.sensors.beta_vane.position, kind="flank")}
    plane = replace(plane, sensors=replace(plane.sensors, second=kinds))
    suite = SensorSuite(plane, generator=1, noise="none")
    ideal = dict.fromkeys((*TABLE_II, "north", "east", "rho"), 0.0)
    ideal |= {"alpha": 0.3, "beta": 0.1, "airspeed": 15.0, "altitude": 100.0, "rho": 1.2}
    values = suite.sample(0.0, ideal).values
    assert values["beta2"] == pytest.approx(np.arctan(np.tan(0.1) / np.cos(0.3)), abs=1e-9)
    assert values["beta"] == pytest.approx(0.1, abs=1e-9)


def test_a_pitot_tube_of_another_kind_beside_the_first_is_refused(tmp_path: Path) -> None:
    packaged = load_vehicle("ultrastick25e")
    text = Path(str(packaged.path)).read_text(encoding="utf-8")
    other = "calibrated" if packaged.sensors.airspeed.kind == "true" else "true"
    line = 'airspeed2 = { position = [0.0, 0.3, 0.0], kind = "' + other + '" }'
    changed = re.sub(r"(?m)^\[sensors\].*$", f"[sensors]\n{line}", text)
    assert changed != text
    (tmp_path / "two.toml").write_text(changed, encoding="utf-8")
    with pytest.raises(VehicleFileError, match=r"give it the kind of sensors\.airspeed"):
        load_vehicle(str(tmp_path / "two.toml"))
