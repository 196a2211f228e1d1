"""TIMESYNC: the station asks over a real socket, a vehicle with a clock of its own answers, all of it is recorded."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from patience import PATIENCE_S
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from traffic import Vehicle, decode, wait_until

from gcs.catalogue.store import Catalogue
from gcs.clock.timesync import RoundTrips, own_replies, request
from gcs.inspection.clocks import clock_text, clocks
from gcs.links.opening import open_link
from gcs.mavlink.dialect import Dialect
from gcs.recording.reader import Recording
from gcs.station.recorder import FlightRecorder
from gcs.station.station import RecordingStation

BOOT_S = 1000.0  # what the vehicle's clock shows more than time.monotonic() does
MS = 1_000_000
UTC = 1_790_000_000 * 10**9


class Answering:
    """A vehicle on a UDP socket: ATTITUDE at 50 Hz, HEARTBEAT at 1 Hz, and an answer to each TIMESYNC request."""

    def __init__(self, port: int) -> None:
        self.vehicle = Vehicle(3)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.settimeout(0.02)
        self.heard: list[mavlink.MAVLink_message] = []
        self.answers: list[tuple[int, int]] = []
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    @staticmethod
    def now_ns() -> int:
        return time.monotonic_ns() + round(BOOT_S * 1e9)

    def _run(self) -> None:
        beat = 0.0
        while not self._stopping.is_set():
            if time.monotonic() >= beat:
                beat = time.monotonic() + 1.0
                self.socket.send(self.vehicle.heartbeat())
            self.vehicle.boot_ms = self.now_ns() // MS
            self.socket.send(self.vehicle.attitude())
            try:
                data = self.socket.recv(2048)
            except TimeoutError:
                continue
            for message in decode(data):
                self.heard.append(message)
                if message.get_type() == "TIMESYNC" and message.tc1 == 0:
                    answer = (self.now_ns(), message.ts1)
                    self.socket.send(self.vehicle.frame(mavlink.MAVLink_timesync_message(*answer)))
                    self.answers.append(answer)

    @contextmanager
    def flying(self) -> Iterator[None]:
        self._thread.start()
        try:
            yield
        finally:
            self._stopping.set()
            self._thread.join(PATIENCE_S)
            self.socket.close()


@pytest.mark.whole_flight
def test_the_station_asks_each_second_and_knows_offset_and_way_from_the_answers(tmp_path: Path) -> None:
    catalogue = Catalogue(tmp_path / "catalogue.sqlite")
    recorder = FlightRecorder(tmp_path / "flights", Dialect.load(), catalogue, silence_s=120.0)
    link = open_link("udpin:127.0.0.1:0")
    station = RecordingStation([link], recorder)
    station.start()
    vehicle = Answering(link.port)  # type: ignore[attr-defined]

    def told() -> dict[str, float] | None:
        systems = [s for s in station.link_status()[0]["systems"] if s["system"] == 3]  # type: ignore[attr-defined]
        enough = systems and len(vehicle.answers) >= 5 and systems[0]["round_trip_s"] is not None
        return systems[0] if enough else None

    with vehicle.flying():
        system = wait_until(told)
        truth = time.time() - (time.monotonic() + BOOT_S)
    station.stop()
    assert 0.0 < system["delay_s"] <= system["round_trip_s"] < 5.0
    assert system["clock_offset_s"] == pytest.approx(truth, abs=system["clock_offset_bound_s"] + 2e-3)

    own = [message for message in vehicle.heard if message.get_srcSystem() == 255]
    assert {message.get_type() for message in own} == {"HEARTBEAT", "TIMESYNC", "COMMAND_LONG"}
    asked = [message for message in own if message.get_type() == "COMMAND_LONG"]
    # Which board it has; one that does not say is asked ever more rarely.
    assert {(message.target_system, message.command, message.param1) for message in asked} == {(3, 512, 148.0)}
    assert len(asked) <= 8
    counters = np.array([message.get_seq() for message in own])
    assert np.all(np.diff(counters) % 256 == 1)  # one sender, one counter
    assert sum(message.get_type() == "TIMESYNC" for message in own) == len(vehicle.answers)

    (flight,) = catalogue.flights()
    recording = Recording(tmp_path / "flights" / flight.file)
    (replies,) = recording.columns("TIMESYNC")
    assert replies.system == 3  # what the station sent itself it did not receive
    recorded = list(zip(replies.fields["tc1"].tolist(), replies.fields["ts1"].tolist(), strict=True))
    assert recorded == vehicle.answers[: len(recorded)]
    assert len(recorded) >= 5
    assert own_replies(replies.log_time, replies.fields["tc1"], replies.fields["ts1"]).all()
    (clock,) = clocks(recording)
    assert clock["offset_s"] == pytest.approx(truth, abs=clock["offset_bound_s"] + 2e-3)
    assert (clock["system"], clock["resets"], clock["knows_utc"]) == (3, 0, False)
    assert "round trip" in clock_text(clock)


def test_a_request_says_whose_it_is_and_when() -> None:
    asked = request(UTC + 123_456_789)
    assert asked.tc1 == 0
    assert asked.ts1 == UTC + 123_456_255
    log = np.array([asked.ts1 + 5 * MS] * 5)
    tc1 = np.array([7, 0, 7, 7, 7])
    ts1 = np.array([asked.ts1, asked.ts1, asked.ts1 + 1, asked.ts1 + 1000 * 10 * MS, asked.ts1 - 11 * 10**9])
    assert own_replies(log, tc1, ts1).tolist() == [True, False, False, False, False]


def exchange(seed: int, there_ms: float = 4.0, back_ms: float = 4.0, count: int = 300) -> RoundTrips:
    """Round trips of a vehicle 50 s after boot at UTC, whose clock loses 80 ppm, over ways with 20 ms of waiting."""
    rng = np.random.default_rng(seed)
    asked = UTC + np.arange(count) * 10**9
    arrived = asked + np.rint((there_ms + rng.exponential(20, count)) * MS).astype(np.int64)
    log = arrived + np.rint((back_ms + rng.exponential(20, count)) * MS).astype(np.int64)
    tc1 = np.rint((50 * 10**9 + (arrived - UTC)) * (1 - 80e-6)).astype(np.int64)
    return RoundTrips(log, tc1, asked, drift=1 / (1 - 80e-6) - 1)


def truth_at(vehicle_ns: int) -> int:
    return UTC - 50 * 10**9 + round(vehicle_ns / (1 - 80e-6)) - vehicle_ns


def test_the_midpoint_of_the_quickest_trips_is_the_offset_and_its_error_is_honest() -> None:
    inside = 0
    for seed in range(100):
        trips = exchange(seed)
        at = 150 * 10**9
        error = (trips.offset_ns(at) - truth_at(at)) / 1e9
        assert abs(error) < 5e-3
        inside += abs(error) < 1.96 * trips.offset_std_s
        assert 0.008 <= trips.smallest_s < 0.02
        assert trips.median_s == pytest.approx(0.008 + 0.02 * 1.678, abs=0.008)  # of the sum of two waits
    assert 85 <= inside <= 100


def test_what_one_way_takes_longer_stays_within_the_bound() -> None:
    trips = exchange(1, there_ms=90.0, back_ms=2.0)
    error = abs(trips.offset_ns(150 * 10**9) - truth_at(150 * 10**9)) / 1e9
    assert error == pytest.approx(0.044, abs=0.005)
    assert error < trips.asymmetry_s
    assert trips.asymmetry_s == pytest.approx(trips.delay_s, abs=2e-3)


def test_a_few_trips_of_which_one_was_quick_are_bounded_by_that_one() -> None:
    there = np.array([1, 200, 300]) * MS
    back = np.array([1, 1, 1]) * MS
    sent = UTC + np.arange(3) * 10**9
    vehicle = sent + there - UTC
    trips = RoundTrips(sent + there + back, vehicle, sent)
    assert abs(trips.offset_ns(10**9) - UTC) / 1e9 <= trips.asymmetry_s
