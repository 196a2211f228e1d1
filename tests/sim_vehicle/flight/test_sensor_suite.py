"""Sensor errors against the figures of the paper's Table II and closed forms."""

import json
from pathlib import Path

import numpy as np
import pytest

from sim_vehicle.errors import SimVehicleError, VehicleFileError
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.vehicle.adc_curves import AnalogueBoard, AnalogueChannel, load_analogue
from sim_vehicle.vehicle.bench_points import write_bench_files
from sim_vehicle.vehicle.vehicle_file import load_vehicle

DT = 0.02
DEG = np.pi / 180.0
IDEAL = {
    "airspeed": 15.0, "alpha": 0.07, "beta": 0.02, "p": 0.1, "q": -0.2, "r": 0.05, "phi": 0.1, "theta": 0.06,
    "psi": 1.0, "ax": 0.7, "ay": 0.1, "az": -9.8, "thrust": 3.7, "altitude": 100.0, "vn": 12.0, "ve": 8.0,
    "vd": -1.0, "north": 250.0, "east": -40.0, "rpm": 6000.0, "rho": 1.2133,
}  # fmt: skip


def run(count: int, noise: str = "table2", seed: int = 3, **options: object) -> tuple[SensorSuite, list[dict]]:
    suite = SensorSuite(load_vehicle("iitb-mav"), noise=noise, generator=np.random.default_rng(seed), dt=DT, **options)
    return suite, [dict(suite.sample(k * DT, IDEAL).values) for k in range(count)]


@pytest.fixture(scope="module")
def samples() -> dict[str, np.ndarray]:
    _, rows = run(8000)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


# Table II: name, scale factor, bias, 1 sigma.
TABLE = [
    ("airspeed", 0.0, 0.0, 0.02),
    ("alpha", 0.005, 0.0, 0.3 * DEG),
    ("beta", 0.005, 0.0, 0.3 * DEG),
    ("p", 0.0, 0.25 * DEG, 0.03 * DEG),
    ("q", 0.0, 0.25 * DEG, 0.03 * DEG),
    ("r", 0.0, 0.25 * DEG, 0.03 * DEG),
    ("ax", 0.0, 0.1962, 0.008 * 9.81),
    ("ay", 0.0, 0.1962, 0.008 * 9.81),
    ("az", 0.0, 0.1962, 0.008 * 9.81),
    ("phi", 0.0, 0.0, 0.05 * DEG),
    ("theta", 0.0, 0.0, 0.05 * DEG),
    ("psi", 0.0, 0.0, 0.05 * DEG),
]


@pytest.mark.parametrize(("name", "scale", "bias", "sigma"), TABLE)
def test_table_ii(samples: dict[str, np.ndarray], name: str, scale: float, bias: float, sigma: float) -> None:
    read = samples[name]
    four_sigma_of_the_mean = 4.0 * sigma / np.sqrt(read.size)
    assert np.mean(read) == pytest.approx((1.0 + scale) * IDEAL[name] + bias, abs=four_sigma_of_the_mean)
    # Resolution adds step / sqrt(12): at most 3 % here.
    assert np.std(read) == pytest.approx(sigma, rel=0.06)


def test_noise_is_white_and_independent(samples: dict[str, np.ndarray]) -> None:
    rows = np.array([samples[name] - samples[name].mean() for name, *_ in TABLE])
    assert np.abs(np.corrcoef(rows) - np.eye(len(TABLE))).max() < 0.05
    following = (rows[:, 1:] * rows[:, :-1]).mean(axis=1) / (rows**2).mean(axis=1)
    assert np.abs(following).max() < 0.05


def test_true_errors_are_what_the_readings_hide() -> None:
    suite, _ = run(1)
    errors = suite.true_errors()
    assert errors["accel_bias_z"] == pytest.approx(0.1962)
    assert errors["gyro_bias_q"] == pytest.approx(0.25 * DEG)
    assert errors["alpha_scale"] == 0.005
    assert errors["theta_scale"] == 0.0


def test_without_noise_readings_are_exact() -> None:
    suite, rows = run(3, noise="none")
    for name, value in IDEAL.items():
        if name in rows[0]:
            assert rows[2][name] == pytest.approx(value, abs=1e-14)
    assert set(suite.true_errors().values()) == {0.0}
    # 0.5 * 1.225 * 15^2, and the pressure of the standard atmosphere at 100 m (ICAO: 100129.4 Pa).
    assert rows[0]["differential_pressure"] == pytest.approx(137.8125)
    assert rows[0]["static_pressure"] == pytest.approx(100129.4, rel=1e-5)
    assert rows[0]["temperature"] == pytest.approx(287.5)


def test_gps_comes_at_5_hz_and_the_rest_at_50() -> None:
    suite, _ = run(0)
    taken: dict[str, int] = {}
    for k in range(500):
        for group in suite.sample(k * DT, IDEAL).due:
            taken[group] = taken.get(group, 0) + 1
    assert taken["gps"] == 50
    assert {taken[group] for group in taken if group != "gps"} == {500}


def test_own_sample_rate() -> None:
    suite, _ = run(0, rates_hz={"vanes": 25.0})
    due = [k for k in range(100) if "vanes" in suite.sample(k * DT, IDEAL).due]
    assert due == list(range(0, 100, 2))


@pytest.mark.whole_flight
def test_gps_position_wanders_slowly() -> None:
    _, rows = run(20_000, seed=8)
    error = np.array([row["gps_north"] for row in rows]) - IDEAL["north"]
    assert 0.5 < np.std(error) < 3.0
    assert np.abs(np.diff(error)).max() < 0.8
    degrees_per_metre = 180.0 / np.pi / 6378137.0
    assert rows[0]["lat"] - 19.1334 == pytest.approx(rows[0]["gps_north"] * degrees_per_metre, abs=1e-12)


def test_lag_is_a_first_order_step_response() -> None:
    suite, _ = run(0, noise="none", changes={"alpha.lag": 0.1})
    suite.sample(0.0, {**IDEAL, "alpha": 0.0})
    read = [suite.sample(k * DT, {**IDEAL, "alpha": 1.0}).values["alpha"] for k in range(1, 26)]
    np.testing.assert_allclose(read, 1.0 - np.exp(-np.arange(1, 26) * DT / 0.1), rtol=1e-12)


def test_single_errors_can_be_changed() -> None:
    suite, rows = run(1, noise="none", changes={"accel_bias_x": 0.5, "airspeed_scale": 0.1})
    assert rows[0]["ax"] == pytest.approx(IDEAL["ax"] + 0.5)
    assert rows[0]["airspeed"] == pytest.approx(16.5)
    assert suite.true_errors()["airspeed_scale"] == 0.1


@pytest.mark.parametrize("name", ["accel_bias_w", "alpha.colour", "flux.noise", "alpha"])
def test_an_unknown_error_is_told(name: str) -> None:
    with pytest.raises(SimVehicleError, match="no sensor error"):
        run(1, changes={name: 1.0})


def test_unknown_noise_is_told() -> None:
    with pytest.raises(SimVehicleError, match="table2, none"):
        run(1, noise="loud")


def test_same_seed_same_readings() -> None:
    assert run(5, seed=4)[1] == run(5, seed=4)[1]
    assert run(5, seed=4)[1] != run(5, seed=5)[1]


def test_converter_has_its_steps_and_its_ends() -> None:
    board = AnalogueBoard(5.0, 12, ())
    step = 5.0 / 4096
    volts = board.converted(np.array([-1.0, 0.4 * step, 0.6 * step, 2.5, 7.0]))
    np.testing.assert_allclose(volts, [0.0, 0.0, step, 2.5, 4095 * step])


def test_pitot_curve_is_odd_about_its_zero() -> None:
    channel = AnalogueChannel(3, "airspeed", "pitot", (0.6, 0.005))
    np.testing.assert_allclose(channel.volts([0.0, 10.0, -10.0]), [0.6, 1.1, 0.1])


def test_bench_points_lie_on_the_true_curves(tmp_path: Path) -> None:
    vehicle = load_vehicle("iitb-mav")
    board = load_analogue(vehicle.path)
    assert board is not None
    copy = tmp_path / "iitb-mav.toml"
    copy.with_suffix(".analogue.json").write_text(
        vehicle.path.with_suffix(".analogue.json").read_text(encoding="utf-8"), encoding="utf-8"
    )
    written = write_bench_files(copy)
    assert [path.name for path in written] == [f"iitb-mav-{channel.signal}.csv" for channel in board.channels]
    for path in written:
        assert path.read_bytes() == vehicle.path.with_name(path.name).read_bytes()
    airspeed = np.loadtxt(vehicle.path.with_name("iitb-mav-airspeed.csv"), delimiter=",", skiprows=1, usecols=(0, 1))
    # 2 q / rho = V^2, volts = zero + k V^2: a straight line in pascals.
    slope, zero = np.polyfit(airspeed[:, 0], airspeed[:, 1], 1)
    true = next(channel for channel in board.channels if channel.signal == "airspeed").coefficients
    assert zero == pytest.approx(true[0], abs=0.005)
    assert slope * 0.5 * 1.225 == pytest.approx(true[1], rel=0.005)


NO_SUCH_INPUT = {"adc": 99, "signal": "alpha", "form": "pitot", "coefficients": [1]}
WRONG_BOARDS = [
    "{",
    json.dumps({"schema": "x"}),
    json.dumps({"schema": "analogue/1", "supply": 5}),
    json.dumps({"schema": "analogue/1", "supply": 5, "bits": 12, "channels": [NO_SUCH_INPUT]}),
]


@pytest.mark.parametrize("text", WRONG_BOARDS)
def test_a_wrong_analogue_file_is_told_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.analogue.json").write_text(text)
    with pytest.raises(VehicleFileError) as caught:
        load_analogue(tmp_path / "a.toml")
    assert "\n" not in str(caught.value)
