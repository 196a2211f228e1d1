"""Signals from recordings made with pymavlink: units, order of sources, whose messages count, calibration."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flight_file import FlightFile, mavlink

from gcs.errors import SignalMapError
from gcs.flights.signals import extract
from sim_vehicle.vehicle.sensors import CalibrationSource, SignalSource
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.signals.flight import FlightSignals

START = 20.0
NAN = math.nan
Message = mavlink.MAVLink_message
UNUSED_SERVOS = [0] * 12


def us(t: float) -> int:
    return round(t * 1e6)


def ms(t: float) -> int:
    return round(t * 1e3)


def heartbeat(kind: int = mavlink.MAV_TYPE_FIXED_WING, autopilot: int = 0) -> Message:
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3)


def highres(t: float, xacc: float = 1.0, updated: int = 0x1E3F, identity: int = 0) -> Message:
    body = (xacc, -2.0, -9.5, 0.1, -0.2, 0.3)
    return mavlink.MAVLink_highres_imu_message(us(t), *body, 0, 0, 0, 1013.25, 1.5, 120.0, 15.0, updated, identity)


def servos(t: float, *pulses: int) -> Message:
    outputs = [*pulses, *[0] * (16 - len(pulses))]
    return mavlink.MAVLink_servo_output_raw_message(us(t) % 2**32, 0, *outputs[:8], *outputs[8:])


def adc(t: float, volts: dict[int, float]) -> Message:
    data = [volts.get(i, 0.0) for i in range(58)]
    return mavlink.MAVLink_debug_float_array_message(us(t), b"adc", 0, data)


def named(t: float, name: bytes, value: float) -> Message:
    return mavlink.MAVLink_named_value_float_message(ms(t), name, value)


def plain_vehicle() -> Vehicle:
    return replace(load_vehicle("iitb-mav"), calibration={})


class Flight:
    """Streams of messages, then their signals."""

    def __init__(self, folder: Path, autopilot: int = 0) -> None:
        self.file = FlightFile(folder / "flight.mcap")
        self.events: list[tuple[float, Message, int, int, str]] = []
        self.stream(1.0, lambda t: heartbeat(autopilot=autopilot))

    def stream(
        self,
        rate: float,
        make: Callable[[float], Message],
        *,
        start: float = START,
        seconds: float = 6.0,
        sender: tuple[int, int] = (1, 1),
        link: str = "radio",
    ) -> Flight:
        for i in range(round(rate * seconds)):
            t = start + i / rate
            self.events.append((t, make(t), *sender, link))
        return self

    def signals(self, vehicle: Vehicle | None = None, system: int | None = None) -> FlightSignals:
        with self.file as file:
            for t, message, sys, comp, link in sorted(self.events, key=lambda event: event[0]):
                file.send(t, message, system=sys, component=comp, link=link)
        return extract(file.open(), vehicle or plain_vehicle(), system)


G = 9.80665
UNITS: dict[str, tuple[Callable[[float], Message], dict[str, float]]] = {
    "HIGHRES_IMU": (
        highres,
        {
            **{"ax": 1.0, "ay": -2.0, "az": -9.5, "p": 0.1, "q": -0.2, "r": 0.3, "altitude": 120.0},
            **{"static_pressure": 101325.0, "differential_pressure": 150.0, "temperature": 288.15},
            "air_density": 1.225,
        },
    ),
    "SCALED_IMU": (
        lambda t: mavlink.MAVLink_scaled_imu_message(ms(t), 1000, -500, -1010, 100, -200, 300, 0, 0, 0),
        {"ax": G, "ay": -G / 2, "az": -1.01 * G, "p": 0.1, "q": -0.2, "r": 0.3},
    ),
    "RAW_IMU": (
        lambda t: mavlink.MAVLink_raw_imu_message(us(t), 1000, -500, -1010, 100, -200, 300, 0, 0, 0),
        {"ax": G, "ay": -G / 2, "az": -1.01 * G, "p": 0.1, "q": -0.2, "r": 0.3},
    ),
    "ATTITUDE": (
        lambda t: mavlink.MAVLink_attitude_message(ms(t), 0.1, 0.2, 3.0, 0.4, 0.5, 0.6),
        {"phi": 0.1, "theta": 0.2, "psi": 3.0, "p": 0.4, "q": 0.5, "r": 0.6},
    ),
    "ATTITUDE_QUATERNION": (
        # a turn of 90 deg to the right, then nose up by 30 deg
        lambda t: mavlink.MAVLink_attitude_quaternion_message(
            ms(t), *(math.sqrt(0.5) * x for x in (math.cos(math.pi / 12), -math.sin(math.pi / 12))),
            *(math.sqrt(0.5) * x for x in (math.sin(math.pi / 12), math.cos(math.pi / 12))), 0, 0, 0,
        ),
        {"phi": 0.0, "theta": math.pi / 6, "psi": math.pi / 2},
    ),
    "AOA_SSA": (
        lambda t: mavlink.MAVLink_aoa_ssa_message(us(t), 5.0, -2.0),
        {"alpha": math.radians(5.0), "beta": math.radians(-2.0)},
    ),
    "AIRSPEED": (lambda t: mavlink.MAVLink_airspeed_message(0, 14.5, 0, 0.0, 0), {"airspeed": 14.5}),
    "VFR_HUD": (
        lambda t: mavlink.MAVLink_vfr_hud_message(13.5, 12.0, 90, 50, 77.0, 0.0),
        {"airspeed": 13.5, "altitude": 77.0},
    ),
    "SCALED_PRESSURE": (
        lambda t: mavlink.MAVLink_scaled_pressure_message(ms(t), 900.0, 0.25, 2000),
        {"static_pressure": 9e4, "differential_pressure": 25.0, "temperature": 293.15,
         "air_density": 9e4 / (287.05287 * 293.15)},
    ),
    "DISTANCE_SENSOR": (
        lambda t: mavlink.MAVLink_distance_sensor_message(ms(t), 10, 900, 432, 0, 0, 25, 0),
        {"height": 4.32},
    ),
    "GPS_RAW_INT": (
        lambda t: mavlink.MAVLink_gps_raw_int_message(us(t), 3, 190_000_000, 720_000_000, 0, 0, 0, 1500, 12000, 9),
        {"lat": 19.0, "lon": 72.0, "vn": -7.5, "ve": 7.5 * math.sqrt(3.0)},
    ),
    "GLOBAL_POSITION_INT": (
        lambda t: mavlink.MAVLink_global_position_int_message(ms(t), 190_000_000, 720_000_000, 0, 0, 110, -220, 330, 0),
        {"lat": 19.0, "lon": 72.0, "vn": 1.1, "ve": -2.2, "vd": 3.3},
    ),
    "LOCAL_POSITION_NED": (
        lambda t: mavlink.MAVLink_local_position_ned_message(ms(t), 0, 0, 0, 1.1, -2.2, 3.3),
        {"vn": 1.1, "ve": -2.2, "vd": 3.3},
    ),
    "NAMED_VALUE_FLOAT": (lambda t: named(t, b"thrust", 3.7), {"thrust": 3.7}),
    "NAMED_VALUE_FLOAT alpha2": (lambda t: named(t, b"alpha2", 0.07), {"alpha2": 0.07}),
    "RPM": (lambda t: mavlink.MAVLink_rpm_message(6500.0, 0.0), {"rpm": 6500.0}),
    "ESC_TELEMETRY_1_TO_4": (
        lambda t: mavlink.MAVLink_esc_telemetry_1_to_4_message(
            bytes(4), [0] * 4, [0] * 4, [0] * 4, [7100, 0, 0, 0], [0] * 4
        ),
        {"rpm": 7100.0},
    ),
    "SERVO_OUTPUT_RAW": (
        lambda t: servos(t, 1500, 1750, 1250, 1000),
        {"servo1": 1500.0, "servo2": 1750.0, "de": 0.218, "da": 0.0, "throttle": 0.25, "dr": -0.436},
    ),
    "DEBUG_FLOAT_ARRAY": (lambda t: adc(t, {0: 2.4, 15: 1.1}), {"adc0": 2.4, "adc15": 1.1}),
}  # fmt: skip


@pytest.mark.parametrize("case", UNITS)
def test_every_message_of_the_table_gives_si_units(tmp_path: Path, case: str) -> None:
    make, wanted = UNITS[case]
    # ATTITUDE at a low rate keeps time where the message itself carries no stamp.
    flight = Flight(tmp_path).stream(50, make)
    if case not in ("ATTITUDE", "ATTITUDE_QUATERNION"):
        flight.stream(2, lambda t: mavlink.MAVLink_attitude_message(ms(t), 0, 0, 0, NAN, NAN, NAN))
    signals = flight.signals().signals
    for name, value in wanted.items():
        np.testing.assert_allclose(signals[name].values, value, rtol=2e-6, atol=1e-7, err_msg=name)
        assert signals[name].time_s.size == 300
        np.testing.assert_allclose(np.diff(signals[name].time_s), 0.02, atol=1e-3)


def test_times_count_from_the_first_stamp_of_the_flight(tmp_path: Path) -> None:
    flight = Flight(tmp_path).stream(50, highres).stream(50, lambda t: servos(t, 1500), start=START + 0.5)
    flight.stream(10, lambda t: mavlink.MAVLink_airspeed_message(0, t, 0, 0.0, 0), start=START + 0.25)
    signals = flight.signals().signals
    assert signals["ax"].time_s[0] == 0.0
    assert signals["servo1"].time_s[0] == pytest.approx(0.5, abs=1e-9)
    # No stamp: by reception, which is as late for all.
    np.testing.assert_allclose(signals["airspeed"].time_s, signals["airspeed"].values - START, atol=1e-4)


def test_the_servos_stamp_may_wrap_in_flight(tmp_path: Path) -> None:
    start = 2**32 / 1e6 - 3.0
    flight = Flight(tmp_path).stream(50, highres, start=start).stream(50, lambda t: servos(t, 1500), start=start)
    signals = flight.signals().signals
    np.testing.assert_allclose(signals["servo1"].time_s, signals["ax"].time_s, atol=2e-6)


def scaled_imu(t: float) -> Message:
    return mavlink.MAVLink_scaled_imu_message(ms(t), 0, 0, -1000, 0, 0, 0, 0, 0, 0)


def test_the_first_source_fast_enough_through_the_flight_counts(tmp_path: Path) -> None:
    both = Flight(tmp_path).stream(25, highres).stream(100, scaled_imu).signals()
    assert both.signals["ax"].source == "HIGHRES_IMU.xacc"
    assert not any("Hz" in line for line in both.warnings)


@pytest.mark.parametrize(("rate", "seconds"), [(10.0, 6.0), (50.0, 4.0)])
def test_a_source_too_slow_or_that_stops_gives_way(tmp_path: Path, rate: float, seconds: float) -> None:
    flight = Flight(tmp_path).stream(rate, highres, seconds=seconds).stream(50, scaled_imu)
    assert flight.signals().signals["ax"].source == "SCALED_IMU.xacc"


def test_a_field_that_nobody_fills_gives_way_to_one_that_moves(tmp_path: Path) -> None:
    def attitude(t: float) -> Message:
        return mavlink.MAVLink_attitude_message(ms(t), 0.1, 0.2, 3.0, 0.0, 0.0, 0.0)

    def slow_imu(t: float) -> Message:
        return mavlink.MAVLink_scaled_imu_message(ms(t), 0, 0, -1000, 100, round(200.0 * np.sin(t)), 0, 0, 0, 0)

    found = Flight(tmp_path).stream(50, attitude).stream(10, slow_imu).signals()
    assert found.signals["q"].source == "SCALED_IMU.ygyro"
    assert found.signals["p"].source == "ATTITUDE.rollspeed"  # neither moves: the first that is fast enough
    assert any("q: SCALED_IMU brings new values at" in line for line in found.warnings)


def test_where_none_is_fast_enough_the_fastest_counts_with_a_warning(tmp_path: Path) -> None:
    found = Flight(tmp_path).stream(5, highres).stream(10, scaled_imu).signals()
    assert found.signals["ax"].source == "SCALED_IMU.xacc"
    assert any(
        line.startswith("ax, ay, az, p, q, r: SCALED_IMU brings new values at 10.") and "and 20 Hz are wanted" in line
        for line in found.warnings
    )


def test_a_source_that_is_fast_enough_but_has_gaps_is_not_called_slow(tmp_path: Path) -> None:
    flight = Flight(tmp_path).stream(50, highres, seconds=4.0).stream(50, UNITS["GLOBAL_POSITION_INT"][0])
    told = next(line for line in flight.signals().warnings if "HIGHRES" in line)
    assert "HIGHRES_IMU has gaps, though it comes at" in told
    assert "Hz on average: 20 Hz are wanted all through" in told


def test_gps_at_two_hertz_is_fast_enough(tmp_path: Path) -> None:
    make = UNITS["GPS_RAW_INT"][0]
    found = Flight(tmp_path).stream(2, make).stream(50, UNITS["GLOBAL_POSITION_INT"][0]).signals()
    assert found.signals["vn"].source == "GPS_RAW_INT.vel"
    assert found.signals["vd"].source == "GLOBAL_POSITION_INT.vz"


def test_ground_stations_and_other_vehicles_are_left_out(tmp_path: Path) -> None:
    flight = Flight(tmp_path).stream(50, highres)
    flight.stream(1, lambda t: heartbeat(mavlink.MAV_TYPE_GCS, 8), sender=(255, 190))
    flight.stream(50, lambda t: highres(t, xacc=99.0), sender=(255, 190))
    np.testing.assert_allclose(flight.signals().signals["ax"].values, 1.0)


def test_several_vehicles_demand_a_choice(tmp_path: Path) -> None:
    flight = Flight(tmp_path).stream(50, highres)
    flight.stream(1, lambda t: heartbeat(), sender=(7, 1)).stream(50, lambda t: highres(t, xacc=7.0), sender=(7, 1))
    with pytest.raises(SignalMapError, match=r"several vehicles, 1, 7; choose one with --system N"):
        flight.signals()
    chosen = extract(flight.file.open(), plain_vehicle(), 7)
    np.testing.assert_allclose(chosen.signals["ax"].values, 7.0)
    with pytest.raises(SignalMapError, match=r"no system 9; vehicles in it: 1, 7"):
        extract(flight.file.open(), plain_vehicle(), 9)


def test_a_recording_without_a_vehicle_says_so(tmp_path: Path) -> None:
    file = FlightFile(tmp_path / "empty.mcap")
    with file:
        file.send(START, highres(START))
    with pytest.raises(SignalMapError, match="no vehicle's HEARTBEAT"):
        extract(file.open(), plain_vehicle())


def test_the_vehicle_of_a_recording_without_heartbeats_is_the_one_that_is_named(tmp_path: Path) -> None:
    file = FlightFile(tmp_path / "mute.mcap")
    with file:
        for i in range(100):
            file.send(START + round(i * 0.02 * 1e9), highres(i * 0.02, xacc=3.0))
    found = extract(file.open(), plain_vehicle(), 1)
    np.testing.assert_allclose(found.signals["ax"].values, 3.0)


@pytest.mark.parametrize("same_frames", [True, False])
def test_what_a_second_link_repeats_counts_once(tmp_path: Path, same_frames: bool) -> None:
    file = FlightFile(tmp_path / "two.mcap")
    with file:
        for i in range(200):
            t = START + 0.02 * i
            for message in (heartbeat(), highres(t), named(t, b"thrust", 3.0), named(t, b"alpha2", 0.1)):
                frame = file.frame(message)
                file.put(t, frame)
                file.put(t, frame if same_frames else file.frame(message, link="wifi"), "wifi", delay_ns=9_000_000)
    signals = extract(file.open(), plain_vehicle()).signals
    assert {signals[name].time_s.size for name in ("ax", "thrust", "alpha2")} == {200}


def test_a_second_imu_and_stale_fields_are_left_out(tmp_path: Path) -> None:
    flight = Flight(tmp_path).stream(50, lambda t: highres(t, updated=0x3F)).stream(25, highres, start=START + 0.005)
    flight.stream(50, lambda t: highres(t, xacc=5.0, identity=1))
    signals = flight.signals().signals
    np.testing.assert_allclose(signals["ax"].values, 1.0)
    assert signals["ax"].time_s.size == 450
    assert signals["static_pressure"].time_s.size == 150


def test_values_that_mavlink_calls_unknown_become_nan(tmp_path: Path) -> None:
    def gps(t: float) -> Message:
        fix, speed = (3, 65535) if t < START + 2 else (3, 1000) if t < START + 4 else (0, 1000)
        return mavlink.MAVLink_gps_raw_int_message(us(t), fix, 190_000_000, 0, 0, 0, 0, speed, 0, 9)

    flight = Flight(tmp_path).stream(5, gps)
    flight.stream(50, lambda t: mavlink.MAVLink_airspeed_message(0, 12.0, 0, 0.0, int(t >= START + 3)))
    signals = flight.signals().signals
    np.testing.assert_array_equal(signals["vn"].values, [NAN] * 10 + [10.0] * 10 + [NAN] * 10)
    np.testing.assert_array_equal(np.isnan(signals["lat"].values), [False] * 20 + [True] * 10)
    assert np.isnan(signals["airspeed"].values).sum() == 150


def test_an_ardupilots_aoa_counts_as_no_vanes_unless_declared(tmp_path: Path) -> None:
    flight = Flight(tmp_path, autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    flight.stream(50, UNITS["AOA_SSA"][0])
    found = flight.signals()
    assert "alpha" not in found.signals
    assert "beta" not in found.signals
    assert any("counts as no vanes" in line for line in found.warnings)
    declared = replace(plain_vehicle(), signals={"alpha": SignalSource("AOA_SSA", field="AOA")})
    again = extract(flight.file.open(), declared)
    np.testing.assert_allclose(again.signals["alpha"].values, math.radians(5.0))
    assert "beta" not in again.signals


def test_a_vehicle_file_names_other_sources(tmp_path: Path) -> None:
    flight = Flight(tmp_path).stream(50, highres).stream(50, UNITS["AOA_SSA"][0])
    flight.stream(50, lambda t: named(t, b"alpha", 5.0)).stream(50, lambda t: named(t, b"alphabet", 77.0))
    flight.stream(50, lambda t: adc(t, {4: 2.0}))
    vehicle = replace(
        plain_vehicle(),
        signals={
            "alpha": SignalSource("NAMED_VALUE_FLOAT", name="alpha", field="value", scale=0.01745, offset=0.001),
            "de": SignalSource("DEBUG_FLOAT_ARRAY", name="adc", field="data[4]", scale=0.1),
            "flap": SignalSource("HIGHRES_IMU", field="zmag"),
            "thrust": SignalSource("NAMED_VALUE_FLOAT", name="pull"),
        },
    )
    found = flight.signals(vehicle)
    np.testing.assert_allclose(found.signals["alpha"].values, 5.0 * 0.01745 + 0.001)
    np.testing.assert_allclose(found.signals["de"].values, 0.2, rtol=1e-6)
    np.testing.assert_allclose(found.signals["flap"].values, 0.0)
    assert "thrust: the recording has no NAMED_VALUE_FLOAT pull" in found.warnings
    wrong = replace(vehicle, signals={"alpha": SignalSource("AOA_SSA", field="alpha")})
    with pytest.raises(SignalMapError, match=r"AOA_SSA has no field alpha; its fields are time_usec, aoa, ssa"):
        extract(flight.file.open(), wrong)


def test_elevons_make_elevator_and_aileron(tmp_path: Path) -> None:
    text = (
        "[mass]\nmass = 1.0\nIxx = 0.02\nIyy = 0.03\nIzz = 0.045\n[geometry]\nS = 0.2\nb = 1.0\nc = 0.2\n"
        "[controls.elevator]\nservo = [1, 2]\nmix = [0.5, 0.5]\npwm = [[1000, 2000], [1000, 2000]]\n"
        "deflection = [[-0.5, 0.5], [-0.5, 0.5]]\n"
        "[controls.aileron]\nsignal = 'position'\nservo = [1, 2]\nmix = [0.5, -0.5]\n"
        "pwm = [[1000, 2000], [1000, 2000]]\ndeflection = [[-0.5, 0.5], [-0.5, 0.5]]\n"
        "[controls.rudder]\nservo = 9\npwm = [1000, 2000]\ndeflection = [-0.3, 0.3]\n"
    )
    path = tmp_path / "wing.toml"
    path.write_text(text, encoding="utf-8")
    found = Flight(tmp_path).stream(50, lambda t: servos(t, 1700, 1600)).signals(load_vehicle(path))
    np.testing.assert_allclose(found.signals["de"].values, 0.15)
    np.testing.assert_allclose(found.signals["da"].values, 0.05)
    assert found.signals["da"].source.endswith("(position)")
    assert "servo3" not in found.signals
    assert any("no servo9, so the rudder is unknown" in line for line in found.warnings)


def test_pulses_beyond_the_calibrated_points_are_told(tmp_path: Path) -> None:
    found = Flight(tmp_path).stream(50, lambda t: servos(t, 1500, 2100 if t < START + 3 else 1500)).signals()
    assert found.signals["de"].values.max() == 0.436
    assert any(line.startswith("de: 50.0% of the pulses") for line in found.warnings)


def calibrated(**sources: CalibrationSource) -> Vehicle:
    return replace(plain_vehicle(), calibration=sources)


def test_a_calibrated_channel_replaces_the_messages_signal(tmp_path: Path) -> None:
    """Points of exact curves: 0.6 V + 0.005 V^2 by airspeed, 2.5 V + 0.01 V per degree."""
    pitot = tuple((p, 0.6 + 0.005 * 2.0 * p / 1.225) for p in (0.0, 50.0, 100.0, 200.0, 300.0))
    vane = tuple((d, 2.5 + 0.01 * d) for d in (-20.0, -10.0, 0.0, 10.0, 20.0))
    vehicle = calibrated(
        airspeed=CalibrationSource("adc3", "pitot", pitot, "Pa"),
        alpha=CalibrationSource("adc0", "linear", vane, "deg"),
        beta=CalibrationSource("adc9", "linear", vane, "deg"),
    )
    flight = Flight(tmp_path).stream(50, UNITS["AOA_SSA"][0]).stream(50, UNITS["AIRSPEED"][0])
    flight.stream(50, lambda t: adc(t, {0: 2.5 + 0.01 * (12.0 if t < START + 3 else 25.0), 3: 0.6 + 0.005 * 225.0}))
    found = flight.signals(vehicle)
    np.testing.assert_allclose(found.signals["airspeed"].values, 15.0, rtol=1e-5)
    assert found.signals["airspeed"].source == "adc3 calibrated (pitot) (calibrated airspeed)"
    np.testing.assert_allclose(found.signals["alpha"].values[:150], math.radians(12.0), rtol=1e-5)
    assert "alpha: 50.0% of adc0 lies beyond its bench points" in found.warnings
    np.testing.assert_allclose(found.signals["beta"].values, math.radians(-2.0), rtol=1e-6)
    assert "beta: the recording has no adc9 to calibrate; AOA_SSA.ssa is used" in found.warnings
    wrong = calibrated(alpha=CalibrationSource("adc0", "linear", vane, "N"))
    with pytest.raises(SignalMapError, match=r"calibration.alpha.unit is 'N', which does not give rad"):
        extract(flight.file.open(), wrong)


def test_calibrated_differential_pressure_is_preferred_to_the_message(tmp_path: Path) -> None:
    pressure = tuple((p, 0.5 + 0.004 * p) for p in (0.0, 100.0, 200.0, 300.0))
    vehicle = calibrated(differential_pressure=CalibrationSource("adc2", "linear", pressure, "Pa"))
    dynamic = 0.5 * 1.225 * 16.0**2
    flight = Flight(tmp_path).stream(50, highres).stream(50, UNITS["AIRSPEED"][0])
    flight.stream(50, lambda t: adc(t, {2: 0.5 + 0.004 * dynamic}))
    signals = flight.signals(vehicle).signals
    np.testing.assert_allclose(signals["airspeed"].values, 16.0, rtol=1e-5)
    assert signals["airspeed"].time_s.size == 300
    # Uncalibrated, the message counts.
    np.testing.assert_allclose(extract(flight.file.open(), plain_vehicle()).signals["airspeed"].values, 14.5)


def test_differential_pressure_alone_gives_airspeed_with_a_warning(tmp_path: Path) -> None:
    found = Flight(tmp_path).stream(50, highres).signals()
    np.testing.assert_allclose(found.signals["airspeed"].values, math.sqrt(2 * 150.0 / 1.225), rtol=1e-6)
    assert any("uncalibrated differential pressure" in line for line in found.warnings)


def test_airspeed_says_which_it_is_and_density_may_be_given(tmp_path: Path) -> None:
    vehicle = plain_vehicle()
    sensors = replace(vehicle.sensors, airspeed=replace(vehicle.sensors.airspeed, kind="true"))
    flight = Flight(tmp_path).stream(50, highres).stream(50, UNITS["AIRSPEED"][0])
    found = flight.signals(replace(vehicle, sensors=sensors, environment=replace(vehicle.environment, air_density=1.1)))
    assert found.signals["airspeed"].source == "AIRSPEED.airspeed (true airspeed)"
    np.testing.assert_array_equal(found.signals["air_density"].values, 1.1)


def test_without_pressure_the_missing_density_is_told(tmp_path: Path) -> None:
    flight = Flight(tmp_path).stream(50, scaled_imu).stream(50, UNITS["AIRSPEED"][0])
    assert any("air density is unknown" in line for line in flight.signals().warnings)
