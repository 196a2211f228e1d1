"""An aircraft that changes in flight: flown by the simulator with another model after a second without telemetry."""

from __future__ import annotations

import numpy as np
import pytest
from live_flights import pieces
from simulated import fly_mav

from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.live.identifier import LiveIdentifier, LiveReport
from sysid.signals.flight import FlightSignals, Signal

pytestmark = pytest.mark.whole_flight

CHANGES_S = 20.0


def changed(**factors: float) -> Model:
    model = read_model("iitb-mav")
    for name, factor in factors.items():
        model = model.with_coefficient(name, factor * model.coefficients[name].value)
    return model


def joined(first: FlightSignals, second: FlightSignals) -> FlightSignals:
    """The second flight, without its first second, a second after the first one has ended."""
    signals = {}
    for name, one in first.signals.items():
        other = second.signals[name]
        before, after = one.time_s < CHANGES_S - 1.0, other.time_s > 1.0
        time_s = np.concatenate([one.time_s[before], other.time_s[after] + CHANGES_S - 1.0])
        values = np.concatenate([one.values[before], other.values[after]])
        signals[name] = Signal(time_s, values, one.unit, one.source)
    return FlightSignals("joined", signals)


@pytest.fixture(scope="module")
def sound() -> FlightSignals:
    return fly_mav("multisine", 710, duration=CHANGES_S)[0]


def told(sound: FlightSignals, **factors: float) -> tuple[LiveReport, float]:
    """The last report, and the time of the first that tells a change."""
    other, _ = fly_mav("multisine", 711, duration=14.0, model=changed(**factors))
    live, first = LiveIdentifier(load_vehicle("iitb-mav")), np.inf
    for samples in pieces(joined(sound, other), 0.1):
        live.take(samples)
        report = live.report()
        if report.changes:
            first = min(first, report.time_s)
    return report, first


def test_ice_is_told_by_lift_drag_and_stability(sound: FlightSignals) -> None:
    report, first = told(sound, CL_alpha=0.85, Cm_alpha=0.85, CD_0=1.6)
    assert first < CHANGES_S + 3.0
    (change,) = report.changes
    assert abs(change.time_s - CHANGES_S) < 0.6
    assert change.causes[0].cause.short == "ICE"
    assert change.causes[0].size == pytest.approx(150.0, abs=50.0)
    (text,) = report.sentences()
    assert text.startswith("ice: ")
    drag = report.coefficients["CD_0"]
    assert abs(drag.value - 1.6 * 0.0871) < 4.0 * drag.std


@pytest.mark.parametrize("share", [0.69, 0.8])
def test_a_moved_centre_of_gravity_is_no_fault_of_the_elevator(sound: FlightSignals, share: float) -> None:
    report, first = told(sound, Cm_alpha=share)
    assert first < CHANGES_S + 3.0
    (change,) = report.changes
    assert change.causes[0].cause.name == "the centre of gravity"


def test_the_same_aircraft_after_a_pause_has_not_changed(sound: FlightSignals) -> None:
    report, _ = told(sound)
    assert report.changes == ()
