"""Positions of surfaces that the log measured: what the simulations of the books make of what lies between samples."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from field_flight import field_flight

from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.identify import identify
from sysid.signals.flight import FlightData
from sysid.signals.record import make_record

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


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_what_a_reading_sees_goes_from_the_mean_before_to_the_mean_after(share: float) -> None:
    from sim_vehicle.model.model_file import read_model
    from sim_vehicle.vehicle.flat_model import flatten
    from sysid.problem.coefficient_residuals import along_path
    from sysid.problem.free_run import Fixed

    plane = vehicle("position")
    record = make_record(flight(0.05 * np.sign(np.sin(5.0 * TIME))), plane, 0, TIME.size)
    path = np.tile([12.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.04, 0.0], (TIME.size, 1))
    flat = flatten(plane, read_model("iitb-mav"))
    lift = {one: along_path(record, path, Fixed(flat, {}, one))[:, 0] for one in (0.0, 1.0, share)}
    np.testing.assert_allclose(lift[share], lift[0.0] + share * (lift[1.0] - lift[0.0]), atol=1e-12)
