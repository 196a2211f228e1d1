"""Live identification of what real links and real airfields give: the ground, lost messages, readings of no sense."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from live_flights import pieces
from simulated import fly_mav, signals_of

from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.manoeuvres.plan import plan_of
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.live.identifier import LiveIdentifier, LiveReport
from sysid.live.signals.airborne import Airborne
from sysid.live.signals.row_alignment import Rows
from sysid.signals.flight import FlightSignals

pytestmark = pytest.mark.whole_flight

TRUTH = {
    **{"CL_alpha": 2.453, "Cm_alpha": -0.5998, "Cm_de": 1.5894, "CD_0": 0.0871},
    **{"Cl_p": -0.45, "Cl_da": 0.15, "Cn_beta": 0.08},
}
# What comes in one message is lost with it.
MESSAGES = (
    ("ax", "ay", "az", "p", "q", "r", "static_pressure", "temperature", "air_density"),
    *(("alpha", "beta"), ("phi", "theta", "psi"), ("de", "da", "dr", "throttle"), ("airspeed",), ("thrust",)),
)


@pytest.fixture(scope="module")
def flight() -> FlightSignals:
    return fly_mav("multisine", 905, duration=21.0)[0]


def identified(signals: FlightSignals) -> LiveReport:
    live = LiveIdentifier(load_vehicle("iitb-mav"))
    for samples in pieces(signals, 0.1):
        live.take(samples)
    return live.report()


def misses(report: LiveReport) -> np.ndarray:
    told = {name: report.coefficients[name] for name in TRUTH}
    assert all(one.known for one in told.values())
    return np.array([(one.value - TRUTH[name]) / one.std for name, one in told.items()])


def test_standing_and_rolling_on_the_ground_tell_nothing_of_the_aircraft() -> None:
    vehicle = load_vehicle("iitb-mav")
    generator = np.random.default_rng(3)
    suite = SensorSuite(vehicle, noise="table2", generator=generator)
    plant = Plant(vehicle, read_model("iitb-mav"), max_step=0.0021)
    flown = fly(plant, plan_of(["multisine"]), suite=suite, generator=generator, taxi=True)
    live = LiveIdentifier(vehicle)
    stood = False
    for samples in pieces(signals_of(flown, vehicle, "taxi"), 0.1):
        live.take(samples)
        report = live.report()
        lift = report.coefficients["CL_alpha"]
        stood |= lift.why == "the aircraft is not in the air"
        # Before the air is excited nothing is known; and no roll on the ground is taken for lift.
        assert not lift.known or abs(lift.value - TRUTH["CL_alpha"]) < 5.0 * lift.std
        assert report.changes == ()
        assert report.warnings == ()
    assert stood
    assert np.sqrt(np.mean(misses(report) ** 2)) < 2.0


def test_a_height_that_never_changes_hides_no_flight() -> None:
    gate = Airborne(load_vehicle("iitb-mav"))
    count = 2000
    speed = np.where(np.arange(count) < 500, 0.5, 15.0)
    columns = {"airspeed": speed, "altitude": np.full(count, 30.0)}
    rows = Rows(0.02, 0.02 * np.arange(count), columns, False, np.ones(count, np.bool_))
    (flown,) = gate.flown([rows])
    assert 10.0 < flown.time_s[0] < 25.0
    assert flown.time_s[-1] == rows.time_s[-1]
    assert not flown.continues


def test_who_is_fast_from_the_beginning_has_been_flying() -> None:
    gate = Airborne(load_vehicle("iitb-mav"))
    columns = {"airspeed": np.full(100, 15.0)}
    pieces_of = [
        Rows(0.02, 0.02 * np.arange(100) + start, columns, start > 0.0, np.ones(100, np.bool_)) for start in (0.0, 2.0)
    ]
    first, second = gate.flown(pieces_of)
    assert first.time_s.size == second.time_s.size == 100
    assert second.continues


@pytest.mark.parametrize("share", [0.1, 0.2])
def test_lost_messages_widen_bars_and_move_nothing(flight: FlightSignals, share: float) -> None:
    generator = np.random.default_rng(11)
    kept = dict(flight.signals)
    for group in MESSAGES:
        arrived = generator.random(max(flight.signals[name].time_s.size for name in group)) > share
        for name in group:
            signal = kept[name]
            some = arrived[: signal.time_s.size]
            kept[name] = replace(signal, time_s=signal.time_s[some], values=signal.values[some])
    report = identified(FlightSignals("lossy", kept))
    # A lost command that is held reads 4 to 8 standard errors off in the control derivatives.
    assert np.sqrt(np.mean(misses(report) ** 2)) < 2.0
    assert report.changes == ()


@pytest.mark.parametrize(
    ("name", "value"), [("alpha", 3.1), ("airspeed", 0.0), ("az", 300.0), ("air_density", 1e-3), ("q", 30.0)]
)
def test_one_reading_of_no_sense_is_left_out_and_told(flight: FlightSignals, name: str, value: float) -> None:
    signal = flight.signals[name]
    values = signal.values.copy()
    values[np.searchsorted(signal.time_s, 12.0)] = value
    spoiled = FlightSignals("spoiled", {**flight.signals, name: replace(signal, values=values)})
    report = identified(spoiled)
    clean = identified(flight)
    for one, told in report.coefficients.items():
        assert abs(told.value - clean.coefficients[one].value) < 0.3 * told.std + 1e-12, one
    assert report.changes == ()
    assert report.warnings == (f"readings left out that no motion makes: {name} (1)",)


def test_no_reading_of_a_sound_flight_is_left_out(flight: FlightSignals) -> None:
    assert identified(flight).warnings == ()


@pytest.mark.parametrize("name", ["alpha", "beta"])
def test_a_vane_that_sticks_is_told_and_spoils_little(flight: FlightSignals, name: str) -> None:
    signal = flight.signals[name]
    stuck = signal.time_s > 12.0
    values = np.where(stuck, signal.values[np.argmax(stuck)], signal.values)
    report = identified(FlightSignals("stuck", {**flight.signals, name: replace(signal, values=values)}))
    assert report.warnings == (f"the {name} vane does not move: nothing is identified meanwhile",)
    # Of the second and a half that it takes to tell.
    assert np.abs(report.coefficients["CL_alpha"].value / TRUTH["CL_alpha"] - 1.0) < 0.1
    assert np.abs(report.coefficients["Cn_beta"].value / TRUTH["Cn_beta"] - 1.0) < 0.3


@pytest.mark.parametrize(
    ("manoeuvres", "duration"),
    [
        ("elevator-3211,aileron-3211,rudder-3211,cruise", 90.0),
        ("aileron-doublet,elevator-doublet,rudder-doublet", 40.0),
    ],
)
def test_a_quiet_stretch_is_no_change_of_the_aircraft(manoeuvres: str, duration: float) -> None:
    live = LiveIdentifier(load_vehicle("iitb-mav"))
    for samples in pieces(fly_mav(manoeuvres, 501, duration=duration)[0], 0.1):
        live.take(samples)
        report = live.report()
    assert report.changes == ()
    assert report.warnings == ()


def test_more_throttle_is_no_change_of_an_aircraft_that_its_propeller_twists() -> None:
    """The torque of its propeller, and no wing, rolls it from then on."""
    vehicle = load_vehicle("ultrastick25e")
    generator = np.random.default_rng(134)
    plan = plan_of(["multisine", "throttle-step"])
    suite, plant = SensorSuite(vehicle, generator=generator), Plant(vehicle, read_model("ultrastick25e"), 0.0021)
    flown = fly(plant, plan, suite=suite, generator=generator, duration=36.0)
    live = LiveIdentifier(vehicle)
    for samples in pieces(signals_of(flown, vehicle, "step"), 0.1):
        live.take(samples)
        report = live.report()
    assert report.changes == ()
    assert report.failures == ()
