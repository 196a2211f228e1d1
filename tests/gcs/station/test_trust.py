"""Who is believed: forged clocks, unsigned frames, ground data behind a flight, and what may reach the vehicles."""

import struct
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from recorder_rig import LINK, Rig
from traffic import SECOND, Vehicle

from gcs.errors import LinkUrlError
from gcs.mavlink.dialect import Dialect
from gcs.station.forwardrules import ForwardRule, parse_forward

KEY = bytes(range(32))
DIALECT = Dialect.load()


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


def signed(vehicle: Vehicle, at_ns: int, key: bytes = KEY) -> Vehicle:
    """A vehicle whose frames are signed from that instant on."""
    vehicle.mav.signing.secret_key = key
    vehicle.mav.signing.sign_outgoing = True
    vehicle.mav.signing.timestamp = (at_ns - 1_420_070_400 * SECOND) // 10_000
    return vehicle


def moving(vehicle: Vehicle, speed: float) -> bytes:
    return vehicle.frame(mavlink.MAVLink_vfr_hud_message(speed, speed, 0, 50, 100.0, 0.0))


@pytest.mark.parametrize("forged_ms", [5_000, 500_000, 3_600_000], ids=["behind", "ahead", "an-hour-ahead"])
def test_a_clock_that_somebody_forges_once_a_second_cuts_a_flight_twice_at_most_and_is_said(
    rig: Rig, forged_ms: int
) -> None:
    vehicle, stranger = Vehicle(), Vehicle()
    vehicle.boot_ms = 100_000
    for _ in range(40):
        seconds = vehicle.second()
        stranger.boot_ms = forged_ms
        rig.feed([*seconds[:25], stranger.attitude(), *seconds[25:]])
    assert "the clock of system 1 starts again and again" in rig.recorder.state.suspicion
    for _ in range(125):
        rig.feed(vehicle.second()[:5])
        vehicle.boot_ms += 900
    assert rig.recorder.state.suspicion == ""  # nobody has given cause since
    flights = rig.finish()
    assert len(flights) <= 3
    assert rig.stream() == rig.sent[LINK]


def test_a_vehicle_that_restarts_twice_makes_three_flights_as_it_always_did(rig: Rig) -> None:
    vehicle = Vehicle()
    for _ in range(3):
        vehicle.boot_ms = 0
        for _ in range(4):
            rig.feed(vehicle.second())
    assert [flight.end_reason for flight in rig.finish()] == ["clock reset", "clock reset", "service stopped"]
    assert rig.recorder.state.suspicion == ""


def test_unsigned_frames_are_recorded_and_believed_in_nothing(tmp_path: Path) -> None:
    rig = Rig(tmp_path, KEY, require_signed=True)
    vehicle = signed(Vehicle(), rig.now)
    vehicle.boot_ms = 100_000
    stranger, other = Vehicle(), Vehicle(7)
    for second in range(20):
        frames = vehicle.second()
        stranger.boot_ms = 1000 * (second % 3)
        rig.feed([*frames, stranger.attitude(), stranger.heartbeat(armed=False), *other.second()[:5]])
    (flight,) = rig.finish()
    assert flight.system == 1
    assert rig.recorder.state.vehicles == {1}
    assert rig.stream() == rig.sent[LINK]
    assert rig.recorder.statistics(LINK, rig.now)["unsigned"] == 20 * 7  # type: ignore[comparison-overlap]


def test_a_wrong_key_is_no_signature(tmp_path: Path) -> None:
    rig = Rig(tmp_path, KEY, require_signed=True)
    stranger = signed(Vehicle(), rig.now, bytes(32))
    rig.feed(stranger.second())
    rig.feed(stranger.second())
    (recording,) = rig.finish()
    assert recording.system is None
    assert rig.catalogue.flights() == []  # it is kept, and no flight
    assert rig.recorder.state.vehicles == set()


def test_the_signed_vehicle_makes_a_flight_of_what_began_unsigned(tmp_path: Path) -> None:
    rig = Rig(tmp_path, KEY, require_signed=True)
    rig.feed(Vehicle().second())
    rig.feed(signed(Vehicle(), rig.now).second(armed=False))
    rig.finish()
    assert [flight.system for flight in rig.catalogue.flights()] == [1]


def test_what_a_vehicle_sends_on_the_ground_after_landing_belongs_to_its_flight(rig: Rig) -> None:
    vehicle = Vehicle()
    for armed in (True, True, True, False, False, False, False, False):
        rig.feed(vehicle.second(armed))
    assert rig.recorder.landed() == rig.ended[0].id
    assert rig.recorder.silent() is None
    flight, ground = rig.finish()
    assert (flight.follows, ground.follows) == (None, flight.id)
    assert [one.id for one in rig.catalogue.flights()] == [flight.id]
    assert [one.id for one in rig.catalogue.ground_after(flight.id)] == [ground.id]
    assert rig.stream() == rig.sent[LINK]


def test_a_late_answer_is_no_flight_of_its_own(rig: Rig) -> None:
    vehicle = Vehicle()
    rig.feed(vehicle.second())
    assert rig.recorder.silent() is None
    rig.wait(11.0)
    assert rig.recorder.landed() is None  # it fell silent, and nobody knows where
    assert rig.recorder.silent() == rig.catalogue.flights()[0].id
    rig.feed([vehicle.frame(mavlink.MAVLink_timesync_message(1, 2))])
    rig.finish()
    (flight,) = rig.catalogue.flights()
    assert [one.messages for one in rig.catalogue.ground_after(flight.id)] == [1]


def test_another_vehicle_on_the_ground_is_not_hidden_behind_a_flight_that_is_not_its_own(rig: Rig) -> None:
    first, other = Vehicle(1), Vehicle(2)
    rig.feed(first.second())
    rig.wait(11.0)
    rig.feed([*(other.attitude() for _ in range(20)), *other.second(False)])
    flights = rig.finish()
    assert [(flight.system, flight.follows) for flight in flights] == [(1, None), (2, None)]


@pytest.mark.parametrize("armed", [True, False])
def test_a_restart_in_flight_begins_a_flight_at_once_and_one_on_the_ground_none(rig: Rig, armed: bool) -> None:
    vehicle = Vehicle()
    vehicle.boot_ms = 100_000
    rig.feed(vehicle.second(armed))
    vehicle.boot_ms = 0
    rig.feed([vehicle.attitude() for _ in range(20)])
    assert (rig.recorder.live_vehicles() == {}) == (not armed)


def test_what_begins_on_the_ground_long_after_a_flight_is_not_hidden_behind_it(rig: Rig) -> None:
    vehicle = Vehicle()
    rig.feed(vehicle.second())
    rig.wait(700.0)
    rig.feed(vehicle.second(False))
    assert [flight.follows for flight in rig.finish()] == [None, None]


@pytest.mark.parametrize("takes_off", ["armed", "moves"])
def test_what_began_on_the_ground_and_takes_off_is_a_flight(rig: Rig, takes_off: str) -> None:
    vehicle = Vehicle()
    for armed in (True, True, False, False, False, False):
        rig.feed(vehicle.second(armed))
    assert rig.recorder.landed() is not None
    for _ in range(4):
        frames = vehicle.second(takes_off == "armed")
        rig.feed([*frames, moving(vehicle, 15.0)] if takes_off == "moves" else frames)
    assert rig.recorder.landed() is None
    assert [flight.follows for flight in rig.finish()] == [None, None]


@pytest.mark.parametrize(
    ("speed", "seconds", "flies"), [(15.0, 2, False), (15.0, 3, True), (4.0, 30, False), (float("nan"), 30, False)]
)
def test_a_gust_through_the_pitot_tube_is_no_take_off(rig: Rig, speed: float, seconds: int, flies: bool) -> None:
    vehicle = Vehicle()
    for armed in (True, True, False, False, False, False):
        rig.feed(vehicle.second(armed))
    for _ in range(seconds):
        rig.feed([*vehicle.second(False), moving(vehicle, speed)])
    assert (rig.finish()[-1].follows is None) == flies


@pytest.mark.parametrize("flies", [True, False])
def test_speeds_of_gps_count_and_an_unknown_one_does_not(rig: Rig, flies: bool) -> None:
    vehicle = Vehicle()
    for armed in (True, True, False, False, False, False):
        rig.feed(vehicle.second(armed))
    speed = 1500 if flies else 65535
    for _ in range(4):
        fix = mavlink.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 0, 0, speed, 0, 9)
        rig.feed([*vehicle.second(False), vehicle.frame(fix)])
    assert (rig.finish()[-1].follows is None) == flies


# what may pass to the vehicles


@pytest.mark.parametrize(
    ("url", "speaks"),
    [
        ("udpout:127.0.0.1:14551", True),
        ("udpout:localhost:14551", True),
        ("tcpin:[::1]:5760", True),
        ("/dev/ttyUSB0,57600", True),
        ("udpin:0.0.0.0:14551", False),
        ("udpout:192.168.1.20:14550", False),
        ("tcp:ground.example:5760", False),
        ("mcast:", False),
        ("udpin:0.0.0.0:14551,commands", True),
        ("udpin:127.0.0.1:14551,receive-only", False),
        ("/dev/ttyUSB0,57600,receive-only", False),
    ],
)
def test_others_than_this_machine_only_listen_unless_it_is_said(url: str, speaks: bool) -> None:
    link, rule = parse_forward(url, DIALECT)
    assert link == url.removesuffix(",commands").removesuffix(",receive-only")
    command = Vehicle(255, 190).frame(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    assert rule.passes(command) == speaks


@pytest.mark.parametrize("version", [1, 2])
def test_lists_of_systems_and_commands_say_what_passes(version: int) -> None:
    _, rule = parse_forward("udpin:0.0.0.0:1,systems=255+254,allow=MAV_CMD_COMPONENT_ARM_DISARM+176+param_set", DIALECT)

    def passes(message: mavlink.MAVLink_message, system: int = 255) -> bool:
        sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
        return rule.passes(bytes(message.pack(sender, force_mavlink1=version == 1)))

    def command(number: int) -> mavlink.MAVLink_message:
        return mavlink.MAVLink_command_long_message(1, 1, number, 0, 0, 0, 0, 0, 0, 0, 0)

    assert passes(command(400))
    assert passes(command(400), 254)
    assert not passes(command(400), 253)
    assert passes(command(176))
    assert not passes(command(22))
    assert not passes(command(0))
    assert passes(mavlink.MAVLink_command_int_message(1, 1, 0, 400, 0, 0, 0, 0, 0, 0, 0, 0, 0))
    assert not passes(mavlink.MAVLink_command_int_message(1, 1, 0, 192, 0, 0, 0, 0, 0, 0, 0, 0, 0))
    assert passes(mavlink.MAVLink_param_set_message(1, 1, b"X", 1.0, 9))
    assert passes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    assert not passes(mavlink.MAVLink_set_mode_message(1, 1, 4))
    assert not passes(mavlink.MAVLink_rc_channels_override_message(1, 1, *[1500] * 8))


@pytest.mark.parametrize(
    ("url", "words"),
    [
        (
            "udpin:0.0.0.0:1,recieve-only",
            "'recieve-only' is no option of a forward link; there are receive-only",
        ),
        ("udpin:0.0.0.0:1,systems=300", "'300' is no system"),
        ("udpin:0.0.0.0:1,systems=", "'systems=' is no option"),
        ("udpin:0.0.0.0:1,commands=1", "'commands=1' is no option"),
        ("udpin:0.0.0.0:1,allow=MAV_CMD_FLY", "'MAV_CMD_FLY' is neither a command"),
        ("udpin:0.0.0.0:1,receive-only,systems=1", "nothing passes"),
        ("udpin:0.0.0.0,commands", "needs HOST:PORT"),
    ],
)
def test_an_option_that_is_none_is_refused_in_words(url: str, words: str) -> None:
    with pytest.raises(LinkUrlError) as error:
        parse_forward(url, DIALECT)
    assert words in str(error.value)


def test_a_command_that_is_cut_short_is_one_of_trailing_zeros() -> None:
    rule = ForwardRule(messages=frozenset(), commands=frozenset({1}))
    payload = bytes(28) + struct.pack("<H", 1)[:1]
    frame = bytes([0xFD, len(payload), 0, 0, 0, 255, 190, 76, 0, 0]) + payload + b"\0\0"
    assert rule.passes(frame)


def test_what_is_not_signed_reaches_no_live_figure_where_signatures_are_demanded(tmp_path: Path) -> None:
    rig = Rig(tmp_path, KEY, require_signed=True)
    heard: list[tuple[str, bytes]] = []
    rig.recorder.hear_believed = lambda source, batch: heard.append((source, batch.data))
    vehicle, stranger = signed(Vehicle(), rig.now), Vehicle()
    sent = []
    for _ in range(3):
        honest = vehicle.second()
        sent += honest
        rig.feed([frame for pair in zip(honest, stranger.second(), strict=True) for frame in pair])
    assert b"".join(data for _, data in heard) == b"".join(sent)
    assert {source for source, _ in heard} == {LINK}
    rig.finish()
    assert rig.stream() == rig.sent[LINK]  # recorded is all of it
