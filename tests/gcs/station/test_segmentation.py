"""Where flights begin and end, on a clock that the test holds."""

import os
import threading
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from recorder_rig import LINK, START, Rig
from traffic import SECOND, Vehicle, batch, ground_station_heartbeat
from wire_streams import wire_streams

from gcs.links.datagrams import Batch


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


def test_disarming_ends_a_flight_two_seconds_later_and_the_next_bytes_begin_another(rig: Rig) -> None:
    vehicle = Vehicle()
    for armed in (True, True, True, False, False, False, False):
        rig.feed(vehicle.second(armed))
    first, second = rig.finish()
    assert first.end_reason == "disarmed"
    assert 2 * SECOND <= first.end_ns - (START + 3 * SECOND) < 2.2 * SECOND
    assert first.system == second.system == 1
    assert 0 < second.start_ns - first.end_ns < SECOND // 10
    assert rig.stream() == rig.sent[LINK]


def test_arming_again_at_once_keeps_the_flight(rig: Rig) -> None:
    vehicle = Vehicle()
    for armed in (True, False, True, True, True, True):
        rig.feed(vehicle.second(armed))
    (flight,) = rig.finish()
    assert flight.messages == 6 * 52


def test_silence_ends_a_flight(rig: Rig) -> None:
    vehicle = Vehicle()
    rig.feed(vehicle.second())
    rig.wait(9.5)
    assert not rig.ended
    rig.wait(1.0)
    assert [flight.end_reason for flight in rig.ended] == ["silence"]
    rig.feed(vehicle.second())
    assert len(rig.finish()) == 2


def test_a_ground_station_or_radio_does_not_keep_a_silent_vehicles_flight_open(rig: Rig) -> None:
    vehicle = Vehicle()
    radio = Vehicle(51, 68)
    rig.feed(vehicle.second())
    for _ in range(25):
        status = mavlink.MAVLink_radio_status_message(100, 100, 90, 30, 30, 0, 0)
        rig.feed([ground_station_heartbeat(), radio.frame(status)])
    assert [flight.end_reason for flight in rig.ended] == ["silence"]
    rig.feed(vehicle.second())
    flights = rig.finish()
    # The radio's and the ground station's frames without a vehicle are one recording, not one every ten seconds.
    assert [flight.system for flight in flights] == [1, None, 1]
    assert rig.stream() == rig.sent[LINK]


def test_a_reboot_splits_exactly_at_the_first_stamp_of_the_new_boot(rig: Rig) -> None:
    vehicle = Vehicle()
    vehicle.boot_ms = 100_000
    for _ in range(3):
        rig.feed(vehicle.second())
    vehicle.boot_ms = 0
    rig.feed([vehicle.attitude(), *vehicle.second()])
    first, second = rig.finish()
    assert first.end_reason == "clock reset"
    assert (first.messages, second.messages) == (3 * 52, 53)
    stamps = rig.recording(second).columns("ATTITUDE")[0]["time_boot_ms"]
    assert stamps[0] == 0
    assert all(later >= earlier for earlier, later in pairwise(stamps.tolist()))
    assert rig.stream() == rig.sent[LINK]


OTHER_PORT = f"{LINK}#2"


@pytest.mark.parametrize(("flown_ms", "silent_s"), [(100_000, 1.5), (3_000, 2.0), (100_000, 9.0)])
def test_a_vehicle_that_comes_back_from_another_port_with_a_new_clock_is_another_flight(
    rig: Rig, flown_ms: int, silent_s: float
) -> None:
    vehicle, again = Vehicle(), Vehicle()
    vehicle.boot_ms = flown_ms
    for _ in range(2):
        rig.feed(vehicle.second())
    rig.wait(silent_s)
    for _ in range(3):
        rig.feed(again.second(), OTHER_PORT)
    first, second = rig.finish()
    assert first.end_reason == "clock reset"
    # HEARTBEAT carries no stamp: the one in front of the first that does cannot tell.
    assert (first.messages, second.messages) == (2 * 52 + 1, 3 * 52 - 1)
    assert rig.recording(second).columns("SYSTEM_TIME")[0]["time_boot_ms"].tolist() == [0, 1000, 2000]
    assert rig.stream(OTHER_PORT) == rig.sent[OTHER_PORT]


def test_another_vehicle_of_the_same_number_from_another_port_is_another_flight(rig: Rig) -> None:
    vehicle, other = Vehicle(), Vehicle()
    vehicle.boot_ms, other.boot_ms = 100_000, 60_000
    rig.feed(vehicle.second())
    rig.wait(3.0)
    rig.feed(other.second(), OTHER_PORT)
    assert len(rig.finish()) == 2


@pytest.mark.parametrize("lag_ms", [0, 2_500, 4_500])
def test_a_vehicle_whose_port_changes_goes_on_with_its_flight(rig: Rig, lag_ms: int) -> None:
    """As behind a router; a modem may bring what is some seconds old."""
    vehicle = Vehicle()
    vehicle.boot_ms = 100_000
    rig.feed(vehicle.second())
    rig.wait(1.5)
    vehicle.boot_ms -= lag_ms
    for _ in range(3):
        rig.feed(vehicle.second(), OTHER_PORT)
    assert len(rig.finish()) == 1


def test_a_second_link_that_is_far_behind_does_not_split_when_the_first_falls_silent(rig: Rig) -> None:
    near, far = Vehicle(), Vehicle()
    near.boot_ms, far.boot_ms = 100_000, 60_000
    for _ in range(2):
        mixed = near.second()
        rig.feed(mixed[:26], span_ns=SECOND // 4)
        rig.feed(far.second(), OTHER_PORT, span_ns=SECOND // 2)
        rig.feed(mixed[26:], span_ns=SECOND // 4)
    for _ in range(4):
        rig.feed(far.second(), OTHER_PORT)
    assert len(rig.finish()) == 1


def test_a_datagram_overtaken_by_others_does_not_split(rig: Rig) -> None:
    vehicle = Vehicle()
    vehicle.boot_ms = 100_000
    rig.feed(vehicle.second())
    datagrams = vehicle.second()
    datagrams.append(datagrams.pop(5))
    rig.feed(datagrams)
    assert len(rig.finish()) == 1


def test_the_wrap_of_a_32_bit_clock_is_no_reboot(rig: Rig) -> None:
    vehicle = Vehicle()
    vehicle.boot_ms = 2**32 - 1000
    rig.feed(vehicle.second())
    vehicle.boot_ms = 0
    rig.feed(vehicle.second())
    assert len(rig.finish()) == 1


def test_a_companion_computers_reboot_does_not_split(rig: Rig) -> None:
    vehicle, companion = Vehicle(), Vehicle(1, 191)
    vehicle.boot_ms = companion.boot_ms = 100_000
    rig.feed([*vehicle.second(), companion.attitude()])
    companion.boot_ms = 0
    rig.feed([*vehicle.second(), companion.attitude()])
    assert len(rig.finish()) == 1


def test_two_vehicles_on_one_link_are_two_flights(rig: Rig) -> None:
    first, second = Vehicle(1), Vehicle(2)
    for _ in range(3):
        mixed = [frame for pair in zip(first.second(), second.second(), strict=True) for frame in pair]
        rig.feed(mixed)
    flights = rig.finish()
    assert sorted(flight.system or 0 for flight in flights) == [1, 2]
    for flight in flights:
        assert flight.messages == 3 * 52
        recording = rig.recording(flight)
        assert recording.systems() == ((flight.system, 1),)
        assert set(recording.lost().values()) == {0}


def test_one_vehicle_over_two_links_is_one_flight(rig: Rig) -> None:
    vehicle = Vehicle()
    for _ in range(2):
        datagrams = vehicle.second()
        rig.feed(datagrams, span_ns=SECOND // 2)
        rig.feed(datagrams, "/dev/ttyUSB0,57600", span_ns=SECOND // 2)
    (flight,) = rig.finish()
    recording = rig.recording(flight)
    assert recording.links() == (LINK, "/dev/ttyUSB0,57600")
    assert len(recording.columns("ATTITUDE")[0]) == 100
    assert rig.stream(LINK) == rig.stream("/dev/ttyUSB0,57600") == rig.sent[LINK]


def test_bytes_that_are_no_frame_are_recorded_too(rig: Rig) -> None:
    vehicle = Vehicle()
    noise = bytes(range(100, 150))
    rig.feed([noise, *vehicle.second(), noise, vehicle.attitude()[:9]])
    rig.wait(11.0)
    rig.feed([noise])
    rig.finish()
    assert rig.stream() == rig.sent[LINK]


def test_the_file_is_named_by_start_and_system(rig: Rig) -> None:
    rig.feed(Vehicle(7).second())
    (flight,) = rig.finish()
    assert flight.file == "20270115T080000.000Z-7.mcap"
    assert (rig.folder / flight.file).is_file()


def test_a_folder_that_cannot_be_written_is_told_and_recording_goes_on_when_it_can(rig: Rig) -> None:
    vehicle = Vehicle()
    folder, aside = rig.folder, rig.folder.with_name("aside")
    folder.rename(aside)
    folder.write_bytes(b"a file where the folder was")
    rig.feed(vehicle.second())
    assert rig.recorder.state.problem
    assert rig.recorder.state.unrecorded_bytes == len(rig.sent[LINK])
    folder.unlink()
    aside.rename(folder)
    rig.feed(vehicle.second())
    assert rig.recorder.state.problem == ""
    (flight,) = rig.finish()
    assert flight.messages == 52


def test_a_second_vehicles_first_words_are_not_in_the_firsts_flight(rig: Rig) -> None:
    first, second = Vehicle(1), Vehicle(2)
    rig.feed(first.second())
    for _ in range(5):  # attitudes long before its first HEARTBEAT
        rig.feed([first.attitude(), second.attitude()])
    rig.feed([first.heartbeat(), second.heartbeat()])
    flights = rig.finish()
    assert [flight.system for flight in flights] == [1, 2]
    assert [rig.recording(flight).systems() for flight in flights] == [((1, 1),), ((2, 1),)]
    assert flights[1].messages == 6


def test_a_flight_is_named_after_the_autopilot_among_the_first_frames(rig: Rig) -> None:
    radio = Vehicle(51, 68)
    status = mavlink.MAVLink_radio_status_message(100, 100, 90, 30, 30, 0, 0)
    rig.feed([radio.frame(status), *Vehicle(7).second()])
    (flight,) = rig.finish()
    assert flight.id.endswith("-7")


def test_a_clock_set_back_ends_the_flight_and_the_next_has_times_of_its_own(rig: Rig) -> None:
    vehicle = Vehicle()
    rig.feed(vehicle.second())
    rig.feed(vehicle.second(), "/dev/ttyUSB0,57600")
    rig.now -= 3600 * SECOND
    began = rig.now
    rig.feed(vehicle.second())
    rig.feed(vehicle.second(), "/dev/ttyUSB0,57600")
    rig.wait(11.0)
    first, second = sorted(rig.ended, key=lambda flight: -flight.start_ns)
    assert (first.end_reason, second.end_reason) == ("clock set back", "silence")
    assert second.start_ns == began
    log_times = [columns.log_time for columns in rig.recording(second).columns("ATTITUDE")]
    assert np.ptp(np.concatenate(log_times)) > SECOND
    assert min(times[0] for times in log_times) < began + SECOND // 5
    for link in rig.sent:
        pieces = [wire_streams(rig.recording(flight))[link] for flight in (first, second)]
        assert b"".join(data for part in pieces for _, data in part) == rig.sent[link]


def test_a_clock_set_back_by_a_moment_or_one_late_link_ends_nothing(rig: Rig) -> None:
    vehicle = Vehicle()
    rig.feed(vehicle.second())
    rig.now -= SECOND * 9 // 10
    rig.feed(vehicle.second())
    rig.now -= 5 * SECOND  # of another link, whose bytes come late
    rig.recorder.feed("serial", batch([vehicle.attitude()], rig.now))
    assert len(rig.finish()) == 1


def test_ticks_while_halves_of_frames_arrive_neither_lose_nor_double_a_byte(rig: Rig) -> None:
    vehicle = Vehicle()
    frames = [frame for _ in range(8) for frame in vehicle.second()]
    over = threading.Event()
    failed: list[Exception] = []

    def hammer() -> None:
        while not over.is_set():
            try:
                rig.recorder.tick(rig.now + 2 * SECOND)
            except Exception as error:
                failed.append(error)

    threads = [threading.Thread(target=hammer) for _ in range(2)]
    for thread in threads:
        thread.start()
    sent = b""
    try:
        for frame in frames:
            for piece in (frame[:17], frame[17:]):
                rig.recorder.feed(LINK, Batch.of([(piece, rig.now)]))
                rig.now += SECOND // 100
                sent += piece
    finally:
        over.set()
        for thread in threads:
            thread.join()
    rig.finish()
    assert not failed
    assert rig.stream() == sent


def test_the_end_of_one_flight_on_a_slow_disk_does_not_hold_up_another(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = Vehicle(1), Vehicle(2)
    rig.feed(first.second())
    rig.feed(second.second(), "other")
    ready = threading.Event()
    monkeypatch.setattr(os, "fdatasync", lambda handle: ready.wait())

    def go_on() -> None:
        for _ in range(15):  # the first falls silent and ends
            rig.recorder.feed("other", batch(second.second(), rig.now))
            rig.now += SECOND
            rig.recorder.tick(rig.now)

    thread = threading.Thread(target=go_on, daemon=True)
    thread.start()
    thread.join(30.0)
    held_up = thread.is_alive()
    assert len(rig.recorder.live_flights()) == 1
    assert [flight.id for flight in rig.ended] == []
    ready.set()
    assert not held_up
    thread.join()
    flights = rig.finish()
    assert [flight.end_reason for flight in flights] == ["silence", "service stopped"]
    assert flights[1].messages == 16 * 52


def test_many_systems_at_once_are_not_so_many_files_and_none_is_lost(rig: Rig) -> None:
    vehicles = [Vehicle(system) for system in range(1, 61)]
    for _ in range(2):
        rig.feed([vehicle.heartbeat() for vehicle in vehicles])
    assert len(rig.recorder.live_flights()) == 32
    flights = rig.finish()
    assert sum(flight.messages for flight in flights) == 120
    assert max(flight.messages for flight in flights) == 2 * 29


def test_what_comes_after_the_end_is_counted_as_not_recorded(rig: Rig) -> None:
    vehicle = Vehicle()
    rig.feed(vehicle.second())
    (flight,) = rig.finish()
    late = vehicle.attitude()
    rig.recorder.feed(LINK, batch([late], rig.now))
    rig.recorder.tick(rig.now + SECOND)
    assert rig.recorder.live_flights() == []
    assert rig.recorder.state.unrecorded_bytes == len(late)
    assert [path.stem for path in rig.folder.glob("*.mcap")] == [flight.id]
