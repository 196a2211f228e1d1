"""Telemetry as another program, pymavlink's parser, reads it."""

from collections import Counter, defaultdict

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import Reading, SensorSuite
from sim_vehicle.flight.tick import Tick
from sim_vehicle.manoeuvres.plan import plan_of
from sim_vehicle.mavlink.boot_clock import BOOT_S, VehicleClock
from sim_vehicle.mavlink.telemetry import Telemetry
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle

EPOCH_US = 1_760_000_000_000_000
Messages = dict[str, list[mavlink.MAVLink_message]]


def parsed(data: bytes) -> list[mavlink.MAVLink_message]:
    parser = mavlink.MAVLink(None)
    return list(parser.parse_buffer(data) or [])


@pytest.fixture(scope="module")
def flight() -> tuple[FlownFlight, Messages, list[mavlink.MAVLink_message]]:
    vehicle = load_vehicle("iitb-mav")
    plant = Plant(vehicle, read_model("iitb-mav"))
    telemetry, data = Telemetry(epoch_us=EPOCH_US), bytearray()
    flown = fly(
        plant,
        plan_of(["multisine"]),
        suite=SensorSuite(vehicle, generator=np.random.default_rng(1)),
        generator=np.random.default_rng(2),
        on_tick=lambda tick: data.extend(b"".join(telemetry.frames(tick))),
    )
    found: Messages = defaultdict(list)
    everything = parsed(bytes(data))
    for message in everything:
        found[message.get_type()].append(message)
    return flown, found, everything


def test_every_byte_is_mavlink_2_and_no_message_is_lost(flight: tuple) -> None:
    _, _, messages = flight
    assert not any(message.get_type() == "BAD_DATA" for message in messages)
    sequence = np.array([message.get_seq() for message in messages])
    assert set(np.diff(sequence) % 256) == {1}
    assert {message.get_msgbuf()[0] for message in messages} == {0xFD}


def test_rates(flight: tuple) -> None:
    _, found, messages = flight
    counts = Counter(message.get_type() for message in messages)
    for name in ("HIGHRES_IMU", "ATTITUDE", "AOA_SSA", "AIRSPEED", "SERVO_OUTPUT_RAW", "RPM", "DEBUG_FLOAT_ARRAY"):
        assert counts[name] == 1001
    assert counts["NAMED_VALUE_FLOAT"] == 1001
    assert counts["GPS_RAW_INT"] == counts["GLOBAL_POSITION_INT"] == counts["LOCAL_POSITION_NED"] == 101
    assert counts["HEARTBEAT"] == counts["SYSTEM_TIME"] == 21
    assert found["HEARTBEAT"][0].type == mavlink.MAV_TYPE_FIXED_WING
    assert found["HEARTBEAT"][0].autopilot == mavlink.MAV_AUTOPILOT_GENERIC
    assert all(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED for m in found["HEARTBEAT"])


@pytest.mark.parametrize(
    ("message", "field", "signal", "factor"),
    [
        ("HIGHRES_IMU", "xacc", "ax", 1.0),
        ("HIGHRES_IMU", "zgyro", "r", 1.0),
        ("HIGHRES_IMU", "abs_pressure", "static_pressure", 0.01),
        ("HIGHRES_IMU", "diff_pressure", "differential_pressure", 0.01),
        ("HIGHRES_IMU", "pressure_alt", "altitude", 1.0),
        ("ATTITUDE", "pitch", "theta", 1.0),
        ("ATTITUDE", "rollspeed", "p", 1.0),
        ("AOA_SSA", "AOA", "alpha", 180.0 / np.pi),
        ("AOA_SSA", "SSA", "beta", 180.0 / np.pi),
        ("AIRSPEED", "airspeed", "airspeed", 1.0),
        ("NAMED_VALUE_FLOAT", "value", "thrust", 1.0),
        ("RPM", "rpm1", "rpm", 1.0),
        ("SERVO_OUTPUT_RAW", "servo2_raw", "servo2", 1.0),
        ("LOCAL_POSITION_NED", "vx", "vn", 1.0),
        ("GPS_RAW_INT", "lat", "lat", 1e7),
    ],
)
def test_a_message_carries_what_was_measured(
    flight: tuple, message: str, field: str, signal: str, factor: float
) -> None:
    flown, found, _ = flight
    told = np.array([getattr(item, field) for item in found[message]], dtype=np.float64)
    expected = flown.measured[signal][1] * factor
    np.testing.assert_allclose(told, expected, rtol=1.2e-7, atol=0.5 if signal == "lat" else 1e-9)


def test_temperature_is_told_in_celsius(flight: tuple) -> None:
    flown, found, _ = flight
    told = np.array([item.temperature for item in found["HIGHRES_IMU"]])
    np.testing.assert_allclose(told, flown.measured["temperature"][1] - 273.15, atol=1e-5)


def test_analogue_channels(flight: tuple) -> None:
    flown, found, _ = flight
    for index in (0, 1, 3, 5):
        told = np.array([item.data[index] for item in found["DEBUG_FLOAT_ARRAY"]])
        np.testing.assert_allclose(told, flown.measured[f"adc{index}"][1], rtol=1e-7)
        steps = told / (5.0 / 4096)
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    assert found["DEBUG_FLOAT_ARRAY"][0].name == "adc"


def test_clock(flight: tuple) -> None:
    flown, found, _ = flight
    stamps = np.array([item.time_usec for item in found["HIGHRES_IMU"]])
    np.testing.assert_allclose(stamps * 1e-6, BOOT_S + flown.time_s, atol=1e-6)
    assert [item.time_usec for item in found["SERVO_OUTPUT_RAW"]] == stamps.tolist()
    clock = found["SYSTEM_TIME"][0]
    assert clock.time_unix_usec - clock.time_boot_ms * 1000 == EPOCH_US


def small(telemetry: Telemetry, time_s: float, armed: bool = True) -> list[mavlink.MAVLink_message]:
    values = dict.fromkeys(("vn", "ve", "vd", "psi", "airspeed", "altitude"), 0.0)
    frames = telemetry.frames(Tick(time_s, Reading(values, frozenset()), {1: 1500}, 0.5, armed))
    return parsed(b"".join(frames))


def test_servo_stamp_wraps_at_32_bits() -> None:
    telemetry = Telemetry(epoch_us=EPOCH_US, clock=VehicleClock(boot_s=4294.96))
    before = small(telemetry, 0.0)[-1].time_usec
    after = small(telemetry, 0.02)[-1].time_usec
    assert before == 4_294_960_000
    assert after == 4_294_980_000 - 2**32


def test_a_change_of_arming_is_told_at_once() -> None:
    telemetry = Telemetry(epoch_us=EPOCH_US)
    told = []
    for k in range(100):
        for message in small(telemetry, k * 0.02, armed=k < 30):
            if message.get_type() == "HEARTBEAT":
                told.append((k, bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)))
    assert told == [(0, True), (30, False), (80, False)]
