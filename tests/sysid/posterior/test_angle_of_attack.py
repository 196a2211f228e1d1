"""An angle of attack with an error of its own: of a vane's zero, or of kinematics behind a late airspeed."""

from __future__ import annotations

from dataclasses import replace

import pytest
from own_bars import own_bar
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identify import identify
from sysid.signals.flight import FlightSignals, Signal

pytestmark = pytest.mark.whole_flight

TRUTH = read_model("iitb-mav").values()


def with_signal(flight: FlightSignals, name: str, signal: Signal) -> FlightSignals:
    return replace(flight, signals={**flight.signals, name: signal})


def vane_off_by(flight: FlightSignals, error: float) -> FlightSignals:
    vane = flight.signals["alpha"]
    return with_signal(flight, "alpha", replace(vane, values=vane.values + error))


def without_vanes_and_late_airspeed(flight: FlightSignals, late: float) -> FlightSignals:
    flight = replace(flight, signals={k: v for k, v in flight.signals.items() if k not in ("alpha", "beta")})
    speed = flight.signals["airspeed"]
    return with_signal(flight, "airspeed", replace(speed, time_s=speed.time_s + late))


@pytest.mark.parametrize("case", ["vane 1.1 deg up", "vane 1.1 deg down", "no vane, airspeed 20 ms late"])
def test_lift_and_moment_at_zero_are_known_as_well_as_the_angle_itself(case: str) -> None:
    """Each was 10 to 14 of its standard errors off where the angle that is imposed counted as true."""
    flight = fly_mav("multisine", 21)[0]
    if case.startswith("no vane"):
        flight = without_vanes_and_late_airspeed(flight, 0.02)
    else:
        flight = vane_off_by(flight, 0.02 if case.endswith("up") else -0.02)
    found = identify([flight], load_vehicle("iitb-mav"), method="map", systematic=False, as_recorded=("alpha",))
    for name in ("CL_0", "Cm_0", "CL_alpha", "Cm_alpha", "Cm_de"):
        entry = found.model.coefficients[name]
        assert entry.value is not None, name
        assert entry.std is not None, name
        assert abs(entry.value - TRUTH[name]) < 3.0 * own_bar(entry), name
    # A degree of angle of attack, or of tilt of the accelerometers, is 0.04 of lift here.
    lift = found.model.coefficients["CL_0"].std
    assert lift is not None
    assert 0.005 < lift < 0.04
