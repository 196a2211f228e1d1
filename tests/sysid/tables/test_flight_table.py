"""A table becomes a flight: its time, what repeats, densities and airspeeds."""

from dataclasses import replace

import numpy as np
import pytest

from sim_vehicle.vehicle.sensors import Sensor
from sim_vehicle.vehicle.vehicle_file import Environment, Vehicle
from sysid.errors import SignalError, TableError
from sysid.signals.flight import FlightSignals
from sysid.tables.columns import match_columns
from sysid.tables.flight_table import flight_from_table, with_airspeed_of
from sysid.tables.sidpac import aircraft_of_fdata, fdata_columns, looks_like_fdata

T = 1000.0 + 0.02 * np.arange(200)


def made(units: object = "SI", **columns: object) -> FlightSignals:
    table = {"time": T, **columns}
    return flight_from_table("t", table, match_columns(list(table), None, units))  # type: ignore[arg-type]


def test_signals_begin_at_zero_in_si_units() -> None:
    flight = made({"alpha": "deg"}, alpha=3.0 + np.sin(T))
    alpha = flight.signals["alpha"]
    assert alpha.time_s[0] == 0.0
    assert alpha.time_s[-1] == pytest.approx(199 * 0.02)
    assert alpha.values == pytest.approx(np.radians(3.0 + np.sin(T)))
    assert (alpha.unit, alpha.source) == ("rad", "table.alpha")


def test_a_sensor_slower_than_the_table_keeps_the_rows_in_which_it_changes() -> None:
    held = np.repeat(np.arange(20.0), 10)
    flight = made(vn=held, de=0.01 * held)
    assert flight.signals["vn"].time_s == pytest.approx(0.2 * np.arange(20))
    assert flight.signals["de"].time_s.size == 200  # an input is held
    assert "mostly repeats its last value; the 20 rows" in flight.warnings[0]


def test_a_dead_column_is_left_to_the_checks_and_an_empty_one_left_out() -> None:
    flight = made(q=np.zeros(200), alpha=np.full(200, np.nan))
    assert flight.signals["q"].time_s.size == 200
    assert "alpha" not in flight.signals
    assert "holds no value" in flight.warnings[0]


def test_rows_without_time_and_rows_twice_are_left_out() -> None:
    time = T.copy()
    time[[5, 9]] = np.nan
    time[20] = time[19]
    flight = flight_from_table("t", {"time": time, "q": np.sin(T)}, match_columns(["time", "q"], None, "SI"))
    assert flight.signals["q"].time_s.size == 197
    assert [warning.split()[0] for warning in flight.warnings] == ["2", "1"]


@pytest.mark.parametrize(
    ("time", "words"),
    [
        (1e3 * T, "give units = {'time': 'ms'}"),
        (1e6 * T, "give units = {'time': 'us'}"),
        (T[::-1], "goes back at row 2"),
        (np.full(200, np.nan), "0 rows have a time"),
        (1e-9 * T, "a flight has 0.5 to 10,000 rows"),
    ],
)
def test_what_is_no_time_of_a_flight_is_said(time: np.ndarray, words: str) -> None:
    with pytest.raises(TableError) as refused:
        flight_from_table("t", {"time": time, "q": np.sin(T)}, match_columns(["time", "q"], None, "SI"))
    assert words in str(refused.value)


def test_words_in_a_column_are_said() -> None:
    with pytest.raises(TableError, match="holds what is no number"):
        made(q=["a"] * 200)


def test_density_follows_from_pressure_and_temperature() -> None:
    flight = made(pressure=101325.0 + 0.0 * T + np.sin(T), temperature=288.15 + 0.001 * np.sin(T))
    assert flight.signals["air_density"].values == pytest.approx(1.225, rel=1e-4)


def vehicle(kind: str, density: float | None = None) -> Vehicle:
    unknown = Vehicle.unknown()
    sensors = replace(unknown.sensors, airspeed=Sensor(kind=kind))
    return replace(unknown, sensors=sensors, environment=Environment(density))


def test_airspeed_is_of_the_kind_that_the_aircraft_s_sensor_reads() -> None:
    true = made(tas=20.0 + np.sin(T), rho=0.9 + 0.0 * T + 0.001 * np.sin(T))
    factor = np.sqrt(true.signals["air_density"].values / 1.225)
    calibrated = with_airspeed_of(true, vehicle("calibrated"))
    assert calibrated.signals["airspeed"].values == pytest.approx(true.signals["true_airspeed"].values * factor)
    assert "true_airspeed" not in calibrated.signals
    assert with_airspeed_of(true, vehicle("true")).signals["airspeed"].values == pytest.approx(20.0 + np.sin(T))
    # A column called airspeed holds what the vehicle file says that the sensor reads; a pressure gives calibrated.
    read = made(airspeed=20.0 + np.sin(T))
    assert with_airspeed_of(read, vehicle("true", 0.9)).signals["airspeed"].values == pytest.approx(20.0 + np.sin(T))
    pressure = made(qbar=0.5 * 1.225 * (20.0 + np.sin(T)) ** 2)
    turned = with_airspeed_of(pressure, vehicle("true", 0.9)).signals["airspeed"].values
    assert turned == pytest.approx((20.0 + np.sin(T)) * np.sqrt(1.225 / 0.9))
    with pytest.raises(SignalError, match="the air density is not known"):
        with_airspeed_of(pressure, vehicle("true"))


def test_dynamic_pressure_stands_in_for_an_airspeed() -> None:
    flight = made(qbar=0.5 * 1.225 * (20.0 + np.sin(T)) ** 2)
    assert with_airspeed_of(flight, vehicle("calibrated")).signals["airspeed"].values == pytest.approx(20.0 + np.sin(T))


def fdata() -> np.ndarray:
    array = np.zeros((200, 90))
    array[:, 0] = T
    array[:, 1] = 60.0
    array[:, 3] = 2.0 + np.sin(T)
    array[:, 12] = -1.0
    array[:, 13] = -3.0
    array[:, 37] = 2.0 + 0.1 * np.sin(T)
    array[:, 38] = 1.0
    array[:, 47] = 0.1342
    array[:, 48:51] = [0.0527, 0.0637, 0.1133]
    array[:, 76:79] = [3.3336, 4.1667, 0.8202]
    return array


def test_sidpac_s_array_is_read_by_its_columns() -> None:
    table, matched = fdata_columns(fdata())
    flight = flight_from_table("f", table, matched)
    assert set(flight.signals) == {"true_airspeed", "alpha", "az", "de", "thrust"}
    assert flight.signals["true_airspeed"].values == pytest.approx(60.0 * 0.3048)
    assert flight.signals["az"].values == pytest.approx(-9.80665)
    assert flight.signals["alpha"].values == pytest.approx(np.radians(2.0 + np.sin(T)))
    assert flight.signals["thrust"].values == pytest.approx((3.0 + 0.1 * np.sin(T)) * 4.4482216)  # of both engines


def test_sidpac_s_array_describes_the_aircraft() -> None:
    found = aircraft_of_fdata(fdata())
    assert found.mass == pytest.approx(1.959, rel=1e-3)
    assert (found.Ixx, found.Iyy, found.Izz) == pytest.approx((0.07151, 0.08636, 0.15364), rel=2e-3)
    assert (found.S, found.b, found.c) == pytest.approx((0.3097, 1.27, 0.25), rel=1e-3)
    lacking = fdata()
    lacking[:, 47] = 0.0
    with pytest.raises(TableError, match="columns 48 \\(mass, inertia, wing\\) are empty"):
        aircraft_of_fdata(lacking)


def test_what_is_no_such_array_is_none() -> None:
    assert looks_like_fdata(fdata())
    assert not looks_like_fdata(fdata()[:, :20])
    with pytest.raises(TableError, match="is no flight data array of SIDPAC"):
        fdata_columns(np.zeros((10, 5)))


@pytest.mark.parametrize("signal", ["de", "theta", "alpha", "phi"])
def test_degrees_that_are_said_to_be_radians_are_refused(signal: str) -> None:
    degrees = -30.0 + 5.0 * np.sin(T)
    with pytest.raises(
        TableError, match=f"{signal} reaches 3\\d rad by column '{signal}' in rad, which no aircraft does"
    ):
        made(**{signal: degrees})
    assert made({signal: "deg"}, **{signal: degrees}).signals[signal].values == pytest.approx(np.radians(degrees))


def test_a_thrust_that_steps_stays_a_step_and_so_does_what_changes_now_and_then() -> None:
    step = np.where(T - T[0] < 1.0, 0.0, 20.0)
    seldom = np.zeros(200)
    seldom[[50, 60, 150]] = 1.0
    flight = made(thrust=step, rpm=100.0 * step, height=np.cumsum(seldom))
    for name in ("thrust", "rpm", "height"):
        assert flight.signals[name].time_s.size == 200


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(TableError, match="is it in percent"):
        made(throttle=50.0 + 10.0 * np.sin(T))
    with pytest.raises(TableError, match="has 20 rows, and the time 200"):
        made(q=np.arange(20.0))
    whole = {"timestamp": np.arange(300.0), "q": np.arange(300.0)}
    with pytest.raises(TableError, match="whose unit nobody says"):
        flight_from_table("t", whole, match_columns(["timestamp", "q"], None, {"q": "deg/s"}))
    assert flight_from_table("t", whole, match_columns(["timestamp", "q"], None, {"q": "deg/s", "time": "ms"}))


@pytest.mark.parametrize(
    ("step", "advice"),
    [
        (20_000.0, "give units = {'time': 'us'}$"),
        (20.0, "give units = {'time': 'ms'}$"),
        (2e7, "give units = {'time': 'ns'}$"),
        (1.0, "give units = {'time': 's'}, or 'ms' where they are that$"),
        (1000.0, "give units = {'time': 'ms'}, or 'us' where they are that$"),
    ],
)
def test_a_time_without_a_unit_is_asked_for_in_those_that_make_it_a_flight(step: float, advice: str) -> None:
    rows = {"timestamp": step * np.arange(300.0), "q": np.sin(np.arange(300.0))}

    def read(**time: str) -> object:
        return flight_from_table("t", rows, match_columns(["timestamp", "q"], None, {"q": "rad/s", **time}))

    with pytest.raises(TableError, match="whose unit nobody says: " + advice) as refused:
        read()
    # Who follows it is not asked again.
    assert read(time=str(refused.value).split("'time': '")[1].split("'")[0])


def test_a_wrong_unit_of_time_leads_to_the_right_one() -> None:
    rows = {"timestamp": 20_000.0 * np.arange(300.0), "q": np.sin(np.arange(300.0))}
    with pytest.raises(TableError, match=r"rows are 20 s apart by 'timestamp' in ms: give units = \{'time': 'us'\}$"):
        flight_from_table("t", rows, match_columns(["timestamp", "q"], None, {"q": "rad/s", "time": "ms"}))


def test_a_column_called_rpm_is_in_rpm() -> None:
    flight = flight_from_table("t", {"t": T, "rpm": 5000.0 + T}, match_columns(["t", "rpm"]))
    np.testing.assert_allclose(flight.signals["rpm"].values, 5000.0 + T)


def test_columns_of_one_signal_may_be_in_several_units() -> None:
    table = {"t": T, "left_aileron_deg": 10.0 * np.sin(T), "right_aileron_rad": -np.radians(10.0) * np.sin(T)}
    flight = flight_from_table("t", table, match_columns(list(table)))
    assert flight.signals["da"].values == pytest.approx(np.radians(10.0) * np.sin(T))
