"""Positions of surfaces that the log measured: what the simulations of the books make of what lies between samples."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from field_flight import field_flight
from field_inputs import inputs_of
from field_plant import Servo, fly_field
from field_sensors import sense
from field_stock import textbook
from field_truth import projection
from jsbsim_flight import linear_aircraft
from one_record import make_record
from own_bars import own_bar

from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.identify import identify
from sysid.signals.flight import FlightData
from sysid.signals.record import position_doubt

pytestmark = pytest.mark.whole_flight

INTERVAL = 0.02
TIME = INTERVAL * np.arange(300)


def vehicle(signal: str) -> Vehicle:
    plane = load_vehicle("iitb-mav")
    controls = {name: replace(one, signal=signal) for name, one in plane.controls.items()}
    return replace(plane, controls=controls)


def flight(de: np.ndarray) -> FlightData:
    columns = {"de": de, "thrust": np.full(TIME.size, 2.0) + 0.01 * np.sin(TIME), "airspeed": np.full(TIME.size, 12.0)}
    return FlightData("f", INTERVAL, TIME, columns)


def test_a_position_counts_by_its_mean_from_sample_to_sample_and_a_command_as_it_is_held() -> None:
    omega = 2.0 * np.pi * 3.0
    de = 0.1 * np.sin(omega * TIME)
    held = make_record(flight(de), vehicle("command"), 0, TIME.size)
    joined = make_record(flight(de), vehicle("position"), 0, TIME.size)
    assert (held.joined, joined.joined) == (False, True)
    np.testing.assert_array_equal(held.commands[:, 0], de)
    mean = 0.1 * (np.cos(omega * TIME) - np.cos(omega * (TIME + INTERVAL))) / (omega * INTERVAL)
    line = 0.5 * (de[:-1] + de[1:])
    off, by_line = (float(np.std((one - mean[: one.size])[5:-5])) for one in (joined.commands[:, 0], line))
    assert off < 0.5 * by_line
    assert off < 0.1 * 0.005


def test_output_error_of_an_aircraft_that_is_not_ours_with_its_positions_logged(tmp_path: Path) -> None:
    """A glider of JSBSim's own at 50 Hz. Held from sample to sample the same positions gave 4.5 %."""
    flown = field_flight("stock-50-hz", 3, tmp_path)
    found = identify([flown.signals], flown.vehicle, method="oe", systematic=False).model.coefficients
    off = []
    for name in flown.excited:
        value, (low, high) = found[name].value, flown.truth[name]
        assert value is not None, name
        off.append(max(low - value, value - high, 0.0) / abs(0.5 * (low + high)))
    assert float(np.median(off)) < 0.003


def test_equation_error_knows_its_surfaces_no_better_than_their_linkages_and_stamps(tmp_path: Path) -> None:
    """What a bench does not know of a linkage moved commands, and no position: bars of logs of positions lacked it."""
    flown = field_flight("stock-50-hz", 3, tmp_path)
    elevator = replace(flown.vehicle.controls["elevator"], gain_std=0.3)
    plane = replace(flown.vehicle, controls={**flown.vehicle.controls, "elevator": elevator})
    found = identify([flown.signals], plane, method="ee", systematic=False)
    moment = found.model.coefficients["Cm_de"]
    assert moment.value is not None
    assert moment.std is not None
    # What bars add up to is never less than one of their parts.
    assert 0.29 * abs(moment.value) < moment.std < 0.4 * abs(moment.value)
    roll = found.model.coefficients["Cl_da"]
    assert roll.value is not None
    assert abs(roll.extra["systematic"]["surface_clock"]) > 1e-3 * abs(roll.value)


def test_what_positions_leave_open_is_what_the_means_are_off_by() -> None:
    """An edge anywhere between two samples, positions in whole microseconds, and a wave that leaves next to nothing."""
    random = np.random.default_rng(3)
    fine, elevator = 200, vehicle("position").controls["elevator"]
    omega = 2.0 * np.pi * 0.17
    off, doubt = [], []
    for _ in range(400):
        place = random.uniform(4.0, 5.0)
        true = np.where(np.arange(10 * fine) / fine < place, 0.0, 0.1)
        means = true.reshape(10, fine).mean(axis=1)
        off.append(means[4] - make_record(flight_of(true[::fine]), vehicle("position"), 0, 10).commands[4, 0])
        doubt.append(position_doubt(true[::fine], elevator)[4])
    assert float(np.std(off)) == pytest.approx(float(np.mean(doubt)), rel=0.1)

    true = 0.1 * np.sin(omega * np.arange(4000 * fine) * INTERVAL / fine)
    read = np.round(true[::fine] / elevator.microsecond) * elevator.microsecond
    off_of_all = true.reshape(-1, fine).mean(axis=1)[:-1] - 0.5 * (read[1:] + read[:-1])
    told = position_doubt(read, elevator)
    # Errors of both ends of a step are halved there, and each acts on two steps: the sum of all is the same.
    together = off_of_all.reshape(-1, 31).sum(axis=1)
    assert float(np.std(together)) == pytest.approx(float(np.sqrt(31.0 * np.mean(told**2))), rel=0.15)
    assert float(np.max(position_doubt(true[::fine], elevator))) < 3e-3 * 0.1
    assert not position_doubt(np.zeros(50), elevator).any()
    assert not make_record(flight(true[::fine][:300]), vehicle("command"), 0, 300).surface_doubt.size


def flight_of(de: np.ndarray) -> FlightData:
    columns = {"de": de, "thrust": np.full(de.size, 2.0), "airspeed": np.full(de.size, 12.0)}
    return FlightData("f", INTERVAL, TIME[: de.size], columns)


def test_filter_error_knows_that_an_edge_lies_somewhere_between_two_samples(tmp_path: Path) -> None:
    """JSBSim flies 3-2-1-1s. With positions taken as exact 14 of 24 intervals held, 9.7 standard errors at worst."""
    aircraft = linear_aircraft()
    controls = {name: replace(one, signal="position") for name, one in aircraft.vehicle.controls.items()}
    plane = replace(aircraft.vehicle, controls=controls)
    log = fly_field(tmp_path, aircraft, inputs_of("3211", 24.0, np.random.default_rng(0)), 0, servo=Servo())
    field = replace(textbook(), positions=True, pulse=controls["elevator"].microsecond, command_hz=50.0)
    truth = projection(log, plane.geometry)
    found = identify([sense(log, plane, field, 0, "edges")], plane, method="fe").model.coefficients
    z = [
        abs(one.value - truth[name]) / own_bar(one)
        for name, one in found.items()
        if one.value is not None and one.std is not None and abs(truth[name]) > 1e-3
    ]
    assert len(z) >= 22
    assert float(np.mean(np.array(z) < 1.96)) > 0.85
    assert max(z) < 3.5


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_what_a_reading_sees_goes_from_the_mean_before_to_the_mean_after(share: float) -> None:
    from sim_vehicle.model.model_file import read_model
    from sim_vehicle.vehicle.packed_model import flatten
    from sysid.problem.coefficient_residuals import along_path
    from sysid.problem.free_run import Fixed

    plane = vehicle("position")
    record = make_record(flight(0.05 * np.sign(np.sin(5.0 * TIME))), plane, 0, TIME.size)
    path = np.tile([12.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.04, 0.0], (TIME.size, 1))
    flat = flatten(plane, read_model("iitb-mav"))
    lift = {one: along_path(record, path, Fixed(flat, {}, one))[:, 0] for one in (0.0, 1.0, share)}
    np.testing.assert_allclose(lift[share], lift[0.0] + share * (lift[1.0] - lift[0.0]), atol=1e-12)
