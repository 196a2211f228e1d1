"""What is left of an output beside its sensor's noise: of white noise of a known size, both are known."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim_vehicle.vehicle.sensors import Sensor, Sensors
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.posterior.observations import Channel, common_grid, joined_at
from sysid.posterior.reported_spectrum import noise_spectra
from sysid.posterior.residual_spectrum import residual_spectrum

STD, LENGTH_S, HIGHEST_HZ = 0.013, 600.0, 8.4
VEHICLE = replace(Vehicle.unknown(), sensors=Sensors(gyro=Sensor(noise=STD)))


def left(stamps: Array) -> list[Any]:
    """White noise in q and az at these stamps, as the estimator has it."""
    grid = common_grid(0.0, LENGTH_S, 0.02, [(200.0, 201.0)], 0.5)
    white = STD * np.random.default_rng(0).standard_normal((2, stamps.size))
    residual = np.asarray(white @ grid.bridged(joined_at(stamps, grid.points)).T)
    spectrum, _ = residual_spectrum([residual], [np.zeros_like(residual)], [grid], misfit=0.0)
    channels = {name: Channel(name, stamps, white[i]) for i, name in enumerate(("q", "az"))}
    part: Any = SimpleNamespace(
        flight="white", channels=channels, common=grid, highest_hz=lambda name, whole: HIGHEST_HZ
    )
    return list(noise_spectra(("q", "az"), {"white": spectrum}, [part], VEHICLE))


@pytest.mark.parametrize("interval_s", [0.02, 0.04, 0.1])
def test_white_noise_is_found_at_its_own_density_and_the_sensors_line_is_there(interval_s: float) -> None:
    q, az = left(np.arange(0.0, LENGTH_S + 0.2, interval_s))
    expected = STD * np.sqrt(2.0 * interval_s)
    assert q.sensor == pytest.approx(expected, rel=0.01)
    assert az.sensor is None
    slow = (q.frequencies > 0.2) & (q.frequencies < 0.1 / interval_s)
    for one in (q, az):
        assert np.sqrt(np.mean(one.density[slow] ** 2)) == pytest.approx(expected, rel=0.05)
        np.testing.assert_allclose(one.density[slow], expected, rtol=0.25)
    assert 0.0 < q.frequencies[0] < 0.2
    assert HIGHEST_HZ - 0.2 < q.frequencies[-1] <= HIGHEST_HZ


def test_the_line_of_a_sensor_faster_than_the_grid_is_where_its_folded_noise_is() -> None:
    even = np.arange(0.0, LENGTH_S + 0.1, 0.004)
    jittered = np.sort(even + np.random.default_rng(1).uniform(-0.002, 0.002, even.size))
    for stamps, share in ((even, 1.0), (jittered, 0.8)):
        q, _ = left(stamps)
        assert q.sensor == pytest.approx(STD * np.sqrt(2.0 * 0.02) * share, rel=0.05 if share == 1.0 else 0.2)
        assert np.sqrt(np.mean(q.density[2:] ** 2)) == pytest.approx(q.sensor, rel=0.05)


def test_the_file_holds_four_digits_and_null_for_a_sensor_of_unknown_noise() -> None:
    q, az = (one.to_json() for one in left(np.arange(0.0, LENGTH_S, 0.02)))
    assert (q["flight"], q["output"], q["unit"], az["unit"]) == ("white", "q", "rad/s/sqrt(Hz)", "m/s^2/sqrt(Hz)")
    assert q["sensor"] == 0.0026
    assert az["sensor"] is None
    assert all(one == float(f"{one:.4g}") for one in (*q["density"], *q["frequency_hz"]))
