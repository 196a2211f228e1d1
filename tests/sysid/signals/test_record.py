"""Records: which samples, inputs and masses an estimator gets."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from one_record import make_record

from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.errors import SignalError
from sysid.signals.flight import FlightData
from sysid.signals.record import OUTPUTS
from sysid.signals.thrust.source import thrust_source

Array = NDArray[np.float64]

N, DT = 400, 0.02
TIME = DT * np.arange(N)


def vehicle(**propulsion: float | None) -> Vehicle:
    packaged = load_vehicle("iitb-mav")
    assert packaged.propulsion is not None
    return replace(packaged, propulsion=replace(packaged.propulsion, **propulsion))


def flight(**changes: Array | None) -> FlightData:
    columns: dict[str, Array] = {name: np.sin(TIME + j) for j, name in enumerate(OUTPUTS)}
    columns |= {
        "de": 0.1 * np.sin(TIME), "da": 0.1 * np.cos(TIME), "dr": 0.05 * np.sin(2.0 * TIME),
        "throttle": np.full(N, 0.4), "thrust": np.full(N, 3.0), "air_density": np.full(N, 1.15),
    }  # fmt: skip
    for name, values in changes.items():
        if values is None:
            del columns[name]
        else:
            columns[name] = values
    return FlightData("f", DT, TIME, columns)


def test_a_record_holds_the_samples_asked_for_and_the_commands_before_them() -> None:
    data = flight()
    record = make_record(data, vehicle(), 100, 250)
    assert record.length == 150
    # 0.6 s of commands before the start may still be under way in the actuators.
    assert record.start == 30
    np.testing.assert_array_equal(record.time_s, TIME[100:250])
    for j, name in enumerate(("de", "da", "dr", "throttle")):
        np.testing.assert_array_equal(record.commands[:, j], data[name][70:250])
    for j, name in enumerate(OUTPUTS):
        np.testing.assert_array_equal(record.z[:, j], data[name][100:250])
    for values in (record.commands, record.thrust, record.rho):
        assert values.flags.c_contiguous
        assert values.shape[0] == 180
    np.testing.assert_allclose(record.rho, 1.15)


def test_at_the_beginning_of_a_flight_there_is_nothing_before() -> None:
    record = make_record(flight(), vehicle(), 10, 60)
    assert record.start == 10
    np.testing.assert_array_equal(record.commands[:, 0], flight()["de"][:60])


def test_a_window_of_a_record_is_the_record_of_the_window() -> None:
    data = flight(thrust=np.full(N, 3.0), ax=np.zeros(N))
    part = make_record(data, vehicle(), 100, 300).window(40, 90)
    whole = make_record(data, vehicle(), 100, 300)
    assert part.length == 50
    np.testing.assert_array_equal(part.z, whole.z[40:90])
    np.testing.assert_array_equal(part.time_s, TIME[140:190])
    assert part.commands.shape[0] == part.start + part.length == part.thrust.size == part.rho.size
    np.testing.assert_array_equal(part.commands[part.start :], whole.commands[whole.start + 40 : whole.start + 90])


def test_thrust_is_what_the_cell_reads_and_what_accelerates_the_motor() -> None:
    """0.08 kg hang on the cell: at 2 m/s2 the propeller pulls 0.16 N more than the cell shows."""
    record = make_record(flight(ax=np.full(N, 2.0)), vehicle(moving_mass=0.08), 100, 300)
    np.testing.assert_allclose(record.thrust, 3.16, rtol=1e-12)
    assert record.moving_mass == 0.08
    bare = make_record(flight(ax=np.full(N, 2.0)), vehicle(moving_mass=0.0), 100, 300)
    np.testing.assert_allclose(bare.thrust, 3.0, rtol=1e-12)


def test_without_a_thrust_signal_thrust_follows_from_the_throttle() -> None:
    record = make_record(flight(thrust=None), vehicle(), 100, 300)
    assert np.isnan(record.thrust).all()
    assert record.moving_mass == 0.0
    assert str(thrust_source(flight(thrust=None), vehicle())) == "from throttle by max_thrust"
    assert str(thrust_source(flight(), vehicle())) == "measured"
    mostly_missing = np.where(np.arange(N) % 3 == 0, 3.0, np.nan)
    assert thrust_source(flight(thrust=mostly_missing), vehicle()).signal == "throttle"


def test_without_a_surface_there_is_no_record_and_one_line_says_so() -> None:
    with pytest.raises(SignalError, match="no control surface") as caught:
        make_record(flight(de=None, da=None, dr=None), vehicle(), 0, N)
    assert str(caught.value).startswith("f: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("data", "plane", "told"),
    [
        (flight(thrust=None), vehicle(max_thrust=None), r"the vehicle file no law for it: give \[propulsion\]"),
        (flight(thrust=None, throttle=None), vehicle(), "neither a thrust signal nor rpm nor a throttle"),
    ],
)
def test_thrust_that_nothing_tells_is_unknown_and_one_line_says_why(
    data: FlightData, plane: Vehicle, told: str
) -> None:
    record = make_record(data, plane, 0, N)
    assert str(record.thrust_source) == "unknown"
    assert re.search(told, record.thrust_source.missing)


def test_a_gap_in_a_command_keeps_the_last_one() -> None:
    command = 0.1 * np.sin(TIME)
    broken = command.copy()
    broken[150:160] = np.nan
    broken[:3] = np.nan
    record = make_record(flight(de=broken), vehicle(), 0, N)
    wanted = command.copy()
    wanted[150:160] = command[149]
    wanted[:3] = command[3]
    np.testing.assert_array_equal(record.commands[:, 0], wanted)


def test_a_surface_or_an_output_that_is_not_there_is_nothing() -> None:
    record = make_record(flight(dr=None, beta=None), vehicle(), 0, N)
    np.testing.assert_array_equal(record.commands[:, 2], 0.0)
    assert np.isnan(record.z[:, OUTPUTS.index("beta")]).all()
    assert np.isfinite(record.z[:, OUTPUTS.index("alpha")]).all()


def test_density_comes_from_the_file_then_from_the_air_then_from_the_standard() -> None:
    fixed = replace(vehicle(), environment=replace(vehicle().environment, air_density=1.1))
    np.testing.assert_array_equal(make_record(flight(), fixed, 0, N).rho, 1.1)
    np.testing.assert_allclose(make_record(flight(), vehicle(), 0, N).rho, 1.15)
    np.testing.assert_array_equal(make_record(flight(air_density=None), vehicle(), 0, N).rho, 1.225)
