"""The standard atmosphere against the printed tables of ICAO Doc 7488 (geopotential altitude)."""

import numpy as np
import pytest

from sim_vehicle.physics import atmosphere

TABLE = [  # m, K, Pa, kg/m^3
    (-1000.0, 294.650, 113929.0, 1.34700),
    (0.0, 288.150, 101325.0, 1.22500),
    (1000.0, 281.650, 89874.6, 1.11164),
    (5000.0, 255.650, 54019.9, 0.736116),
    (10000.0, 223.150, 26436.3, 0.412707),
    (11000.0, 216.650, 22632.1, 0.363918),
    (15000.0, 216.650, 12044.6, 0.193674),
    (20000.0, 216.650, 5474.89, 0.0880349),
]


@pytest.mark.parametrize(("altitude", "kelvin", "pascal", "kg_m3"), TABLE)
def test_table_values(altitude: float, kelvin: float, pascal: float, kg_m3: float) -> None:
    assert atmosphere.temperature(altitude) == pytest.approx(kelvin, abs=5e-4)
    assert atmosphere.pressure(altitude) == pytest.approx(pascal, rel=1e-5)
    assert atmosphere.density(altitude) == pytest.approx(kg_m3, rel=1e-5)
    assert atmosphere.air_at(altitude) == pytest.approx((kelvin, pascal, kg_m3), rel=1e-5)
    assert atmosphere.pressure_altitude(pascal) == pytest.approx(altitude, abs=0.2)


def test_hydrostatic_balance() -> None:
    altitude = np.linspace(100.0, 19100.0, 20)  # none of them at the kink of the tropopause
    slope = (atmosphere.pressure(altitude + 0.5) - atmosphere.pressure(altitude - 0.5)) / 1.0
    np.testing.assert_allclose(slope, -atmosphere.density(altitude) * 9.80665, rtol=1e-6)


def test_pressure_altitude_inverts_pressure() -> None:
    altitude = np.linspace(-500.0, 19500.0, 41)
    np.testing.assert_allclose(atmosphere.pressure_altitude(atmosphere.pressure(altitude)), altitude, atol=1e-6)


def test_dynamic_pressure_is_odd() -> None:
    # 0.5 * 1.225 * 15^2
    assert atmosphere.dynamic_pressure(15.0) == pytest.approx(137.8125)
    assert atmosphere.dynamic_pressure(-15.0) == pytest.approx(-137.8125)
