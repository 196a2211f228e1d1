"""A vehicle that is switched on again within its flight, from another port: its clock begins anew."""

from __future__ import annotations

from traffic import SECOND, Vehicle, batch

from gcs.live.vehiclefile import WatchedVehicle
from gcs.live.worker import LiveProcess
from gcs.mavlink.dialect import Dialect

START = 1_800_000_000 * SECOND


def test_signals_and_estimates_begin_anew_with_the_vehicles_clock() -> None:
    live = LiveProcess(Dialect.load(), WatchedVehicle("iitb-mav"))
    vehicle, again = Vehicle(), Vehicle()
    vehicle.boot_ms = 60_000
    for second in range(20):
        live.take([batch(vehicle.second(), START + second * SECOND)])
    estimates = live._estimates
    live.take([batch(again.second(), START + 21 * SECOND)])
    assert live._estimates is not estimates
    assert live._messages.newest_s is not None
    assert live._messages.newest_s < 1.5
    assert "phi" in live._newest  # what comes is not held to be late
