"""A vehicle that restarts: where one flight ends and the next begins while messages and links interleave."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.reader import make_reader
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from traffic import SECOND, Vehicle

from gcs.catalogue.flight_table import Flight
from gcs.catalogue.store import Catalogue
from gcs.links.datagrams import Batch
from gcs.mavlink.dialect import Dialect
from gcs.recording.reader import Recording
from gcs.station.recorder import FlightRecorder

START = 1_800_000_000 * SECOND
UP_MS = 900_000  # for how long the vehicle had been on


def told(vehicle: Vehicle, seconds: int) -> list[bytes]:
    """Telemetry in which four messages with stamps of their own interleave, ten times a second."""
    frames = []
    for tenth in range(10 * seconds):
        if tenth % 10 == 0:
            frames += [vehicle.heartbeat(), vehicle.system_time()]
        frames.append(vehicle.attitude())
        position = mavlink.MAVLink_local_position_ned_message(vehicle.boot_ms - 60, *[0.0] * 6)
        frames.append(vehicle.frame(position))
        frames.append(vehicle.frame(mavlink.MAVLink_named_value_float_message(vehicle.boot_ms - 900, b"thrust", 1.0)))
        vehicle.boot_ms += 100
    return frames


def reboots(flight_s: int = 10) -> list[tuple[int, bytes]]:
    """(ns after the start, frame): a flight, two seconds of silence, a flight since boot."""
    vehicle = Vehicle()
    vehicle.boot_ms = UP_MS
    before = told(vehicle, flight_s)
    vehicle.boot_ms = 1_000
    after = told(vehicle, flight_s)
    step = flight_s * SECOND // len(before)
    sent = [(i * step, frame) for i, frame in enumerate(before)]
    return sent + [((flight_s + 2) * SECOND + i * step, frame) for i, frame in enumerate(after)]


def fly(folder: Path, arrivals: list[tuple[int, str, bytes]], size: int) -> list[tuple[Flight, list[int]]]:
    """Feed a recorder; each flight with its ATTITUDE stamps, ms."""
    catalogue = Catalogue(folder / "catalogue.sqlite")
    recorder = FlightRecorder(folder, Dialect.load(), catalogue)
    arrivals.sort(key=lambda arrival: arrival[0])
    first = 0
    while first < len(arrivals):
        link, last = arrivals[first][1], first + 1
        while last < len(arrivals) and last - first < size and arrivals[last][1] == link:
            last += 1
        recorder.feed(link, Batch.of([(frame, START + at) for at, _, frame in arrivals[first:last]]))
        recorder.tick(START + arrivals[last - 1][0])
        first = last
    recorder.close(START + arrivals[-1][0] + SECOND)
    flights = []
    for flight in reversed(catalogue.flights()):
        columns = Recording(folder / flight.file).columns("ATTITUDE")
        flights.append((flight, [stamp for entry in columns for stamp in entry.fields["time_boot_ms"].tolist()]))
    return flights


@pytest.mark.parametrize("size", [1, 7, 64])
def test_one_restart_cuts_one_flight_while_messages_interleave(tmp_path: Path, size: int) -> None:
    (first, before), (second, after) = fly(tmp_path, [(at, "radio", frame) for at, frame in reboots()], size)
    assert (first.end_reason, second.end_reason) == ("clock reset", "service stopped")
    assert before == list(range(UP_MS, UP_MS + 10_000, 100))
    assert after == list(range(1_000, 11_000, 100))
    for flight, boot_s in ((first, UP_MS / 1e3), (second, 1.0)):
        with (tmp_path / flight.file).open("rb") as file:
            clocks = [entry.metadata for entry in make_reader(file).iter_metadata() if entry.name == "clock/1/radio"]
        (clock,) = clocks  # each flight's own, though the next one's stamps had been read when it ended
        start = START / 1e9 if flight is first else START / 1e9 + 12.0
        assert float(clock["clock_offset_s"]) == pytest.approx(start - boot_s, abs=0.1)


@pytest.mark.parametrize("lag_s", [0.0, 0.3, 1.5, 4.0])
def test_a_link_that_lags_behind_does_not_restart_the_vehicle_again(tmp_path: Path, lag_s: float) -> None:
    sent = reboots()
    late = round(lag_s * SECOND)
    flights = fly(tmp_path, [(at, "radio", f) for at, f in sent] + [(at + late, "wire", f) for at, f in sent], 8)
    assert [flight.end_reason for flight, _ in flights] == ["clock reset", "service stopped"]
    assert set(range(UP_MS, UP_MS + 10_000, 100)) <= set(flights[0][1])
    assert set(range(1_000, 11_000, 100)) <= set(flights[1][1])


def test_a_link_that_tells_no_time_hides_no_restart(tmp_path: Path) -> None:
    sent = [(at, "radio", frame) for at, frame in reboots()]
    silent = Vehicle()
    beats = [(at * SECOND, "wire", silent.heartbeat()) for at in range(22)]
    flights = fly(tmp_path, sent + beats, 8)
    assert [flight.end_reason for flight, _ in flights] == ["clock reset", "service stopped"]


def test_a_restart_soon_after_another_is_seen_over_both_links(tmp_path: Path) -> None:
    vehicle = Vehicle()
    arrivals: list[tuple[int, str, bytes]] = []
    at = 0
    for _ in range(3):
        vehicle.boot_ms = 1_000
        for i, frame in enumerate(frames := told(vehicle, 8)):
            arrived = at + i * 8 * SECOND // len(frames)
            arrivals += [(arrived, "radio", frame), (arrived + SECOND // 5, "wire", frame)]
        at += 10 * SECOND
    flights = fly(tmp_path, arrivals, 8)
    assert [flight.end_reason for flight, _ in flights] == ["clock reset", "clock reset", "service stopped"]
