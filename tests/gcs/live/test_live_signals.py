"""Signals while a flight comes in, against those taken from its recording afterwards."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from traffic import SECOND, Vehicle, batch, ground_station_heartbeat

from gcs.flights.signals import ESTIMATED_VANES, extract
from gcs.flights.streams import Stream
from gcs.formats.conversion import import_file
from gcs.links.datagrams import Batch
from gcs.live.messages import VehicleMessages
from gcs.live.protocol import Flight, Unpacker, pack_batch, pack_flight
from gcs.live.reception import Reception
from gcs.live.signals import SignalStream
from gcs.mavlink.dialect import Dialect
from gcs.recording.reader import Recording
from sim_vehicle.cli.main import main as sim_vehicle
from sim_vehicle.vehicle.vehicle_file import load_vehicle


def datagrams(tlog: Path) -> Iterator[tuple[bytes, int]]:
    """Frames of a .tlog with their UTC ns: eight bytes of stamp, then a MAVLink 2 frame."""
    data = tlog.read_bytes()
    at = 0
    while at < len(data):
        (stamp_us,) = struct.unpack_from(">Q", data, at)
        size = 12 + data[at + 9] + (13 if data[at + 10] & 1 else 0)
        yield data[at + 8 : at + 8 + size], stamp_us * 1000
        at += 8 + size


def attitude_of(streams: list[Stream]) -> Stream:
    return next(stream for stream in streams if stream.message == "ATTITUDE")


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("flight") / "flight.tlog"
    sim_vehicle(["fly", "--manoeuvre", "multisine", "--duration", "4", "--record", str(path)])
    return path


def test_signals_are_those_of_the_recording_in_whatever_pieces_and_however_often_they_come(flight: Path) -> None:
    vehicle = load_vehicle("iitb-mav")
    import_file(flight, flight.with_suffix(".mcap"))
    recorded = extract(Recording(flight.with_suffix(".mcap")), vehicle).signals
    messages, stream = VehicleMessages(Dialect.load(), SignalStream(vehicle).messages), SignalStream(vehicle)
    told: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    sent = list(datagrams(flight))
    random = np.random.default_rng(3)
    at = 0
    while at < len(sent):
        part = sent[at : at + random.integers(1, 30)]
        at += len(part)
        for source in ("radio", "modem"):  # the second link brings everything once more
            streams = messages.take([Batch.of(part, source)])
            for name, samples in stream.take(streams, messages.autopilot).items():
                told.setdefault(name, []).append((samples.time_s, samples.values))
    assert set(told) == set(recorded)
    for name, pieces in told.items():
        time_s = np.concatenate([piece[0] for piece in pieces])
        values = np.concatenate([piece[1] for piece in pieces])
        offset = recorded[name].time_s[-1] - time_s[-1]  # the recording's first second may hold more than ours
        assert np.all(np.diff(time_s) > 0.0)
        assert time_s.size >= 0.9 * recorded[name].time_s.size
        assert abs(offset) < 0.1
        np.testing.assert_allclose(values, recorded[name].values[-values.size :], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("pace", [0.3, 1.0, 2.0, 5.0, 10.0])
def test_messages_without_a_stamp_follow_a_stream_of_any_pace(tmp_path: Path, pace: float) -> None:
    """A replay, and a simulation that flies faster than time goes by; what comes is held for a tenth of a second."""
    path = tmp_path / "flight.tlog"
    sim_vehicle(["fly", "--manoeuvre", "multisine", "--duration", "20", "--record", str(path)])
    sent = list(datagrams(path))
    first = sent[0][1]
    random = np.random.default_rng(5)
    late = [round(random.uniform(0.0, 200_000.0)) for _ in sent]
    placed = {}
    for speed in (1.0, pace):
        received = np.maximum.accumulate(
            [first + round((at - first) / speed) + delay for (_, at), delay in zip(sent, late, strict=True)]
        )
        messages = VehicleMessages(Dialect.load(), ["HIGHRES_IMU", "AIRSPEED"])
        streams: list[Stream] = []
        for turn in np.unique(received // (SECOND // 10)):
            inside = np.flatnonzero(received // (SECOND // 10) == turn)
            streams += messages.take([Batch.of([(sent[i][0], int(received[i])) for i in inside], "radio")])
        times = [one.time_s for one in streams if one.message == "AIRSPEED"]
        placed[speed] = np.concatenate(times)
    lost = placed[1.0].size - placed[pace].size
    assert lost < 15
    off = placed[pace] - placed[1.0][lost:]
    # What came before the pace was known is placed by a clock's.
    known = placed[1.0][lost:] > {0.3: 0.4, 1.0: 0.0, 2.0: 1.8}.get(pace, 0.6 * pace)
    assert known.mean() > 0.65
    np.testing.assert_allclose(off[known], 0.0, atol=0.001 + 0.0004 * max(pace, 1.0))


def test_a_link_that_stalls_is_no_other_pace() -> None:
    """A board's clock at a radio that holds everything for a second and a half, and brings it then at once."""
    reception, rate = Reception(), 50
    raw = np.arange(30 * rate) * (SECOND // rate)
    log = raw + 7 * SECOND
    log[400:475] = log[475]
    for begin in range(0, raw.size, 5):
        reception.add(log[begin : begin + 5], raw[begin : begin + 5])
        assert reception.pace() == 1.0
        assert abs(int(reception.at(np.array([log[begin]]))[0]) - (int(log[begin]) - 7 * SECOND)) < 1_000


def test_a_delay_that_grows_is_believed_after_half_a_minute() -> None:
    reception = Reception()
    for second in range(120):
        delay = SECOND // 2 if second > 60 else 0
        reception.add(np.array([second * SECOND + delay]), np.array([second * SECOND]))
        assert reception.pace() == 1.0
    off = int(reception.at(np.array([119 * SECOND + SECOND // 2]))[0]) - 119 * SECOND
    assert abs(off) < 1_000


def test_what_one_link_loses_another_brings_and_a_turn_takes_both(flight: Path) -> None:
    messages = VehicleMessages(Dialect.load(), ["ATTITUDE"])
    sent = list(datagrams(flight))
    whole = attitude_of(messages.take([Batch.of(sent, "radio")]))
    messages.restart()
    halves = [[one for i, one in enumerate(sent) if i % 7 != lost] for lost in (2, 5)]
    batches = [Batch.of(half[a : a + 40], source) for a in range(0, len(sent), 40) for source, half in zip(
        ("radio", "modem"), halves, strict=True) if half[a : a + 40]]  # fmt: skip
    joined = attitude_of(messages.take(batches))
    assert np.all(np.diff(joined.log_ns) >= 0)
    time_s, first = np.unique(joined.time_s, return_index=True)
    np.testing.assert_allclose(time_s, whole.time_s, atol=1e-9)
    np.testing.assert_array_equal(joined.records["pitch"][first], whole.records["pitch"])


def test_a_vehicle_that_starts_anew_begins_at_zero_and_a_ground_station_is_none() -> None:
    messages = VehicleMessages(Dialect.load(), ["ATTITUDE"])
    assert messages.take([batch([ground_station_heartbeat()], SECOND)]) == []
    assert messages.system is None
    vehicle = Vehicle(7)
    vehicle.boot_ms = 60_000
    (streams,) = [messages.take([batch(vehicle.second(), 10 * SECOND)])]
    assert messages.system == 7
    attitude = attitude_of(streams)
    np.testing.assert_allclose(attitude.time_s, 0.02 * np.arange(50), atol=1e-9)
    vehicle.boot_ms = 1_000
    streams = messages.take([batch(vehicle.second(), 12 * SECOND)])
    attitude = attitude_of(streams)
    np.testing.assert_allclose(attitude.time_s, 0.02 * np.arange(50), atol=1e-9)


def test_clocks_of_one_vehicle_that_stand_apart_end_nothing() -> None:
    messages, vehicle = VehicleMessages(Dialect.load(), ["ATTITUDE", "SCALED_PRESSURE"]), Vehicle(7)
    vehicle.boot_ms = 60_000
    late = [vehicle.frame(mavlink.MAVLink_scaled_pressure_message(ms, 1013.0, 0.0, 2000)) for ms in (40_000, 40_020)]
    for turn in range(3):
        streams = messages.take([batch([*vehicle.second(), *late], (10 + turn) * SECOND)])
        assert {stream.message for stream in streams} >= {"ATTITUDE", "SCALED_PRESSURE"}
        assert np.all(np.diff(attitude_of(streams).time_s) > 0.0)


def test_a_vehicle_that_is_bound_is_the_only_one_whoever_is_heard_first() -> None:
    messages, other, own = VehicleMessages(Dialect.load(), ["ATTITUDE"]), Vehicle(1), Vehicle(2)
    assert messages.bind(2)
    assert messages.take([batch(other.second(), SECOND)]) == []
    assert messages.system is None
    assert messages.take([batch(own.second(), 2 * SECOND)])
    assert messages.system == 2
    assert messages.bind(None)
    assert not messages.bind(1)


def test_records_come_out_of_the_pipe_as_they_went_in() -> None:
    sent = batch([b"one", b"", b"three"], 5 * SECOND)
    data = pack_flight(Flight("f1", 7)) + pack_batch("udpin:1", sent) + pack_flight(Flight())
    unpacker = Unpacker()
    found = [record for i in range(len(data)) for record in unpacker.feed(data[i : i + 1])]
    assert found[0] == Flight("f1", 7)
    assert found[2] == Flight()
    taken = found[1]
    assert isinstance(taken, Batch)
    assert (taken.source, taken.data, taken.ends.tolist()) == ("udpin:1", sent.data, sent.ends.tolist())
    assert taken.received_ns.tolist() == sent.received_ns.tolist()


@pytest.mark.parametrize("frames", [1, 16, 1000])
def test_values_of_several_names_at_one_time_are_all_taken(frames: int) -> None:
    """A board sends its vanes and its thrust one after the other under the same stamp."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    sent = [sender.heartbeat_encode(1, 3, 0, 0, 4).pack(sender)]
    for stamp in range(20):
        for name in ("alpha2", "beta2", "thrust"):
            told = sender.named_value_float_encode(1000 + 20 * stamp, name.encode(), 0.1 * stamp)
            sent += [told.pack(sender)]
    vehicle = load_vehicle("iitb-mav")
    messages, stream = VehicleMessages(Dialect.load(), SignalStream(vehicle).messages), SignalStream(vehicle)
    counted: dict[str, int] = {}
    for at in range(0, len(sent), frames):
        part = [(frame, SECOND + 20_000_000 * (at + k)) for k, frame in enumerate(sent[at : at + frames])]
        for name, samples in stream.take(messages.take([Batch.of(part, "radio")]), messages.autopilot).items():
            counted[name] = counted.get(name, 0) + samples.time_s.size
    assert {name: counted.get(name) for name in ("alpha2", "beta2", "thrust")} == {
        "alpha2": 20,
        "beta2": 20,
        "thrust": 20,
    }


def test_an_air_density_of_the_vehicle_file_comes_with_the_accelerometer(flight: Path) -> None:
    vehicle = load_vehicle("iitb-mav")
    vehicle = replace(vehicle, environment=replace(vehicle.environment, air_density=1.1))
    messages, signals = VehicleMessages(Dialect.load(), SignalStream(vehicle).messages), SignalStream(vehicle)
    found = signals.take(messages.take([Batch.of(list(datagrams(flight)), "radio")]), messages.autopilot)
    np.testing.assert_array_equal(found["air_density"].time_s, found["az"].time_s)
    np.testing.assert_array_equal(found["air_density"].values, 1.1)


def test_vanes_that_ardupilot_estimates_are_not_taken_and_that_is_said() -> None:
    messages, vehicle = VehicleMessages(Dialect.load(), ["ATTITUDE", "AOA_SSA"]), Vehicle(7)
    vanes = [vehicle.frame(mavlink.MAVLink_aoa_ssa_message(10_000 * k, 5.0, -2.0)) for k in range(1, 9)]
    streams = messages.take([batch([*vehicle.second(), *vanes], SECOND)])
    assert "AOA_SSA" in {stream.message for stream in streams}
    signals = SignalStream(load_vehicle("iitb-mav"))
    assert "alpha" not in signals.take(streams, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    assert signals.notes == (ESTIMATED_VANES,)
    other = SignalStream(load_vehicle("iitb-mav"))
    assert "alpha" in other.take(streams, mavlink.MAV_AUTOPILOT_PX4)
    assert other.notes == ()
