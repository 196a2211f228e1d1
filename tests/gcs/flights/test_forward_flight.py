"""What hovers and what flies on its wing: parameters, states and pulses of quadplanes and their like."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from field_flight import FieldFlight, Plan, fly_plan, textbook
from field_plant import Air, Hold, Servo
from field_wire import BOOT, START, messages, vehicle_file
from processes import run
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from ulog_writer import BOOT_US
from ulog_writer import a_log as a_px4_log

from gcs.analysis.postflight import read_flights
from gcs.errors import SignalMapError
from gcs.flights.autopilot_settings import filled
from gcs.flights.forward_flight import lift_motors, pushes
from gcs.formats.conversion import import_file
from gcs.recording.reader import Recording
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle

pytestmark = pytest.mark.whole_flight

LIFT = {"Q_ENABLE": 1.0, **{f"SERVO{5 + k}_FUNCTION": 33.0 + k for k in range(4)}}


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> FieldFlight:
    plan = Plan("multisine", 30.0, Servo(), Air(), Hold(hz=50.0), textbook(), 0.0)
    return fly_plan(plan, 2, tmp_path_factory.mktemp("vtol"), "vtol")


def log(
    flight: FieldFlight,
    folder: Path,
    kind: int,
    lift: Any = None,
    parameters: Any = None,
    state: Any = None,
    mode: Any = lambda t: 10,
) -> tuple[Path, Vehicle]:
    """A recording and its vehicle. lift: pulse of motors 5 to 8 at a time of the flight. state: vtol_state then."""
    link, raw = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), bytearray()

    def put(t: float, message: Any) -> None:
        raw.extend(struct.pack(">Q", round((START + t) * 1e6)) + message.pack(link))
        link.seq = (link.seq + 1) % 256

    every = parameters or {}
    for k, (name, value) in enumerate(every.items()):
        put(BOOT, mavlink.MAVLink_param_value_message(name.encode(), value, 9, len(every), k))
    for t, message in messages(flight):
        if message.get_type() == "HEARTBEAT":
            if state is not None:
                put(t, mavlink.MAVLink_extended_sys_state_message(state(t - BOOT), 0))
            autopilot = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
            message = mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, mode(t - BOOT), 4, 3)
        if message.get_type() == "SERVO_OUTPUT_RAW" and lift is not None:
            for n in range(5, 9):
                setattr(message, f"servo{n}_raw", lift(t - BOOT))
        put(t, message)
    (folder / "f.tlog").write_bytes(bytes(raw))
    (folder / "f.toml").write_text(vehicle_file(flight), encoding="utf-8")
    import_file(folder / "f.tlog", folder / "f.mcap")
    return folder / "f.mcap", load_vehicle(folder / "f.toml")


def test_what_is_flown_while_lift_motors_turn_is_left_out_and_that_is_said(flight: FieldFlight, tmp_path: Path) -> None:
    path, craft = log(flight, tmp_path, 1, lambda t: 1600 if t < 8.0 else 1000, LIFT)
    (found,) = read_flights([path], craft)
    assert min(one.time_s[0] for one in found.signals.values()) > 9.5
    assert found.signals["az"].time_s[-1] == pytest.approx(30.0, abs=0.5)
    assert any("10 s of 30 s are not flown on the wing alone" in line for line in found.warnings)


def test_a_transition_in_the_middle_leaves_what_is_before_and_behind(flight: FieldFlight, tmp_path: Path) -> None:
    path, craft = log(flight, tmp_path, 22, state=lambda t: 3 if 12.0 <= t < 15.0 else 4)
    (found,) = read_flights([path], craft)
    stamps = found.signals["q"].time_s
    assert stamps[0] < 0.5
    assert not ((stamps > 12.0) & (stamps < 16.5)).any()
    assert stamps[-1] > 29.0
    done = run("gcs", "check", path, "--vehicle", craft.path)
    assert "are not flown on the wing alone" in done.stdout + done.stderr


def test_where_none_is_left_there_is_one_line(flight: FieldFlight, tmp_path: Path) -> None:
    path, craft = log(flight, tmp_path, 20, lambda t: 1500, LIFT)
    with pytest.raises(SignalMapError, match="never flies on its wing alone for 5 s: of 30 s it hovers"):
        read_flights([path], craft)
    done = run("gcs", "identify", path, "--vehicle", craft.path)
    assert done.returncode == 1
    assert [line for line in done.stderr.splitlines() if "%" not in line[:5]] == [done.stderr.splitlines()[-1]]
    assert "never flies on its wing alone" in done.stderr


def test_an_aircraft_without_lift_motors_is_left_as_it_is(flight: FieldFlight, tmp_path: Path) -> None:
    path, craft = log(flight, tmp_path, 1, lambda t: 1600)
    (found,) = read_flights([path], craft)
    assert found.signals["az"].time_s[0] < 0.5
    assert not any("wing alone" in line for line in found.warnings)


@pytest.mark.parametrize(
    ("fields", "rows"),
    [
        (("uint8_t vehicle_vtol_state",), ((3,), (1,), (4,))),
        (("bool vtol_in_rw_mode", "bool vtol_in_trans_mode"), ((1, 0), (0, 1), (0, 0))),
    ],
)
def test_px4_s_log_says_how_it_flies(
    tmp_path: Path, fields: tuple[str, ...], rows: tuple[tuple[int, ...], ...]
) -> None:
    made = a_px4_log()
    made.topic("vtol_vehicle_status", *fields)
    for k, row in enumerate(rows):
        made.add("vtol_vehicle_status", BOOT_US + 1_000_000 * k, *row)
    (tmp_path / "log.ulg").write_bytes(made.bytes())
    import_file(tmp_path / "log.ulg", tmp_path / "log.mcap")
    (found,) = Recording(tmp_path / "log.mcap").columns("EXTENDED_SYS_STATE", system=9)
    assert found.fields["vtol_state"].tolist() == [3, 1, 4]


def test_a_tailsitter_is_cut_by_its_modes_and_what_is_constant_stays(flight: FieldFlight, tmp_path: Path) -> None:
    parameters = {**LIFT, "Q_TAILSIT_ENABLE": 1.0}
    path, craft = log(flight, tmp_path, 1, lambda t: 1600, parameters, mode=lambda t: 18 if t < 8.0 else 5)
    still = replace(craft, environment=replace(craft.environment, air_density=1.1))
    (found,) = read_flights([path], still)
    assert found.signals["q"].time_s[0] > 9.0
    assert found.signals["q"].time_s[-1] > 29.0
    assert found.signals["air_density"].values.tolist() == [1.1, 1.1]


def test_which_motors_lift_is_what_the_parameters_say() -> None:
    assert set(lift_motors(LIFT)) == {5, 6, 7, 8}
    # Tilting motors push in forward flight; a tailsitter's do too.
    assert set(lift_motors(LIFT | {"Q_TILT_ENABLE": 1.0, "Q_TILT_MASK": 3.0})) == {7, 8}
    assert lift_motors(LIFT | {"Q_TAILSIT_ENABLE": 1.0}) == {}
    # As it was before 4.1.
    assert lift_motors(LIFT | {"Q_TILT_MASK": 15.0}) == {}
    assert lift_motors(LIFT | {"Q_FRAME_CLASS": 10.0}) == {}
    assert lift_motors(LIFT | {"Q_ENABLE": 0.0}) == {}
    px4 = {"CA_AIRFRAME": 2.0, "CA_ROTOR4_AX": 1.0, "CA_ROTOR4_AZ": 0.0, "PWM_AUX_FUNC1": 105.0}
    px4 |= {"PWM_MAIN_FUNC5": 201.0, "CA_SV_CS0_TYPE": 3.0} | {f"PWM_MAIN_FUNC{k + 1}": 101.0 + k for k in range(4)}
    assert set(lift_motors(px4)) == {1, 2, 3, 4}
    assert pushes(px4, 4)
    controls = filled(Vehicle.unknown(), px4).controls
    assert controls["throttle"].servos == (17,)  # never a motor that lifts
    assert controls["elevator"].servos == (5,)
    # Two motors of a fixed wing are one throttle.
    twin = {"CA_AIRFRAME": 1.0, "PWM_MAIN_FUNC1": 101.0, "PWM_MAIN_FUNC2": 102.0}
    assert filled(Vehicle.unknown(), twin).controls["throttle"].servos == (1, 2)
