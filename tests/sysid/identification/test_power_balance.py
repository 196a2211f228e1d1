"""What the battery gave beside what was gained, of a motion whose balance is known."""

from __future__ import annotations

import warnings
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sysid.identification.power_balance import power_balance
from sysid.signals.flight import FlightData

TIME = np.arange(0.0, 20.0, 0.02)


def flown(**changed: np.ndarray) -> Any:
    """A steady climb of 1 m/s whose battery, read twice a second, gives 100 W, and 5 W with the throttle shut."""
    closed = TIME > 15.0
    power = np.where(np.arange(TIME.size) % 25 == 0, np.where(closed, 5.0, 100.0), np.nan)
    columns = {
        "airspeed": np.full(TIME.size, 15.0), "altitude": 50.0 + np.minimum(TIME, 15.0), "phi": np.full(TIME.size, 0.2),
        "az": np.full(TIME.size, -10.0), "throttle": np.where(closed, 0.0, 0.6), "battery_power": power, **changed,
    }  # fmt: skip
    data = FlightData("flight", 0.02, TIME, columns, ())
    stretch = SimpleNamespace(data=data, record=SimpleNamespace(rho=np.full(TIME.size, 1.2)))
    return SimpleNamespace(stretches=[stretch], layout=SimpleNamespace(airspeed_factor=1.02))


def test_a_climb_is_its_power_its_speed_and_what_it_gains() -> None:
    found = power_balance([flown()])
    assert found is not None
    assert found["rest"] == 5.0
    middle = found["windows"][10]
    assert middle == pytest.approx(
        {"airspeed": 15.3, "air_density": 1.2, "load": 1.0 / np.cos(0.2), "power": 100.0, "gained": 1.0}, rel=1e-9
    )
    assert 28 <= len(found["windows"]) <= 31  # none with the throttle shut


def test_what_is_lost_banked_or_pulled_is_no_steady_flight() -> None:
    lost = np.where((TIME > 4.0) & (TIME < 6.0), np.nan, 0.2)
    banked = np.where((TIME > 8.0) & (TIME < 9.0), 0.9, lost)
    pulled = np.where((TIME > 10.0) & (TIME < 11.0), -18.0, -10.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = power_balance([flown(phi=banked, az=pulled)])
        assert found is not None
        assert 22 <= len(found["windows"]) <= 24
        assert power_balance([flown(battery_power=np.full(TIME.size, np.nan))]) is None
