"""Faults, several vehicles, signatures and MAVLink 1 in whole flights, read back by pymavlink."""

import itertools
import struct
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.cli.main import main

Flight = list[tuple[int, bytes]]


def record(path: Path, *arguments: str) -> Flight:
    """A flight of 3 s as (us, bytes) entries of a .tlog, whose bytes may be no frame."""
    assert main(["fly", "--duration", "3", "--seed", "4", *arguments, "--record", str(path)]) == 0
    return entries(path)


def entries(path: Path) -> Flight:
    """Undamaged .tlog entries: eight bytes of time, one frame."""
    data, at, found = path.read_bytes(), 0, []
    while at < len(data):
        extra = (13 if data[at + 10] & 1 else 0) + 12 if data[at + 8] == 0xFD else 8
        length = data[at + 9] + extra
        found.append((struct.unpack_from(">Q", data, at)[0], data[at + 8 : at + 8 + length]))
        at += 8 + length
    return found


def messages(flight: Flight) -> list[tuple[int, mavlink.MAVLink_message]]:
    parser = mavlink.MAVLink(None)
    return [(when, parser.decode(bytearray(frame))) for when, frame in flight]


def comparable(flight: Flight) -> list[bytes]:
    """Frames without SYSTEM_TIME, which tells when the simulation was started."""
    return [frame for _, frame in flight if frame[7:10] != b"\x02\x00\x00"]


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return record(tmp_path_factory.mktemp("good") / "f.tlog")


def test_delay_shifts_the_time_of_arrival_and_nothing_else(tmp_path: Path, good: Flight) -> None:
    late = record(tmp_path / "f.tlog", "--fault", "delay=0.25")
    assert comparable(late) == comparable(good)
    # The first frame of the good flight leaves at its start, which the vehicle's SYSTEM_TIME tells.
    for flight, delay_us in ((good, 0), (late, 250_000)):
        clock = next((when, m) for when, m in messages(flight) if m.get_type() == "SYSTEM_TIME")
        assert clock[0] - clock[1].time_unix_usec == pytest.approx(delay_us, abs=2)


def test_loss_reorder_and_duplicates_in_a_recording(tmp_path: Path, good: Flight) -> None:
    arguments = ("--fault", "loss=0.1,duplicate=0.05,reorder=0.05,jitter=0.03,outage=1:1.5")
    first = record(tmp_path / "a.tlog", *arguments)
    again = record(tmp_path / "b.tlog", *arguments)
    assert comparable(first) == comparable(again)
    times = [when for when, _ in first]
    assert times == sorted(times)
    whole, left = Counter(comparable(good)), Counter(comparable(first))
    assert set(left) <= set(whole)
    assert max(left.values()) == 2
    stamps = [m.time_usec * 1e-6 - 12.0 for _, m in messages(first) if m.get_type() == "HIGHRES_IMU"]
    assert not [stamp for stamp in stamps if 1.0 <= stamp < 1.5]
    assert comparable(first) != sorted(comparable(first), key=lambda frame: comparable(good).index(frame))


def test_noise_on_the_link_costs_frames_but_moves_no_byte_of_the_others(tmp_path: Path, good: Flight) -> None:
    path = tmp_path / "f.tlog"
    assert (
        main([*["fly", "--duration", "3", "--seed", "4", "--fault", "corrupt=2e-4,garbage=0.1", "--record"], str(path)])
        == 0
    )
    data = path.read_bytes()
    intact = sum(frame in data for frame in comparable(good))
    assert 0.8 * len(comparable(good)) < intact < len(comparable(good))
    assert len(data) > sum(8 + len(frame) for _, frame in good)


def test_a_drifting_clock(tmp_path: Path) -> None:
    flight = messages(record(tmp_path / "f.tlog", "--fault", "drift-ppm=5000"))
    sent = np.array([when for when, m in flight if m.get_type() == "HIGHRES_IMU"], dtype=np.float64)
    stamps = np.array([m.time_usec for _, m in flight if m.get_type() == "HIGHRES_IMU"], dtype=np.float64)
    slope = np.polyfit(sent - sent[0], stamps - stamps[0], 1)[0]
    assert slope - 1.0 == pytest.approx(5000e-6, abs=2e-6)
    for when, message in flight:
        if message.get_type() == "SYSTEM_TIME":  # UTC comes from satellites, and does not drift
            assert message.time_unix_usec == pytest.approx(when, abs=2)


def test_a_clock_that_starts_anew(tmp_path: Path) -> None:
    flight = messages(record(tmp_path / "f.tlog", "--fault", "clock-reset=1.5"))
    restart = next(k for k in range(1, len(flight)) if flight[k][1].get_seq() != (flight[k - 1][1].get_seq() + 1) % 256)
    first = flight[restart][1]
    assert (first.get_type(), first.get_seq(), first.system_status) == ("HEARTBEAT", 0, mavlink.MAV_STATE_STANDBY)
    stamps = np.array([m.time_usec for _, m in flight if m.get_type() == "HIGHRES_IMU"])
    backward = np.flatnonzero(np.diff(stamps) < 0)
    assert backward.tolist() == [74]  # after the 75 samples of the first 1.5 s
    assert stamps[75] == 1_000_000
    told = [
        (m.system_status == mavlink.MAV_STATE_ACTIVE, bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED))
        for _, m in flight
        if m.get_type() == "HEARTBEAT"
    ]
    assert told == [(True, True), (True, True), (False, False), (True, True)]
    for when, message in flight:
        if message.get_type() == "SYSTEM_TIME":
            assert message.time_unix_usec == pytest.approx(when, abs=2)


def test_several_vehicles_fly_in_step_each_as_it_would_alone(tmp_path: Path) -> None:
    truth = tmp_path / "truth.json"
    arguments = ["--duration", "1.5", "--system", "7", "--vehicles", "2", "--truth", str(truth)]
    together = record(tmp_path / "f.tlog", *arguments)
    again = record(tmp_path / "g.tlog", *arguments)
    assert comparable(together) == comparable(again)
    assert [when for when, _ in together] == sorted(when for when, _ in together)
    for number in range(2):
        path = tmp_path / f"{number}.tlog"
        alone = ["fly", "--duration", "1.5", "--seed", str(4 + number), "--system", str(7 + number)]
        assert main([*alone, "--truth", str(tmp_path / f"alone-{number}.json"), "--record", str(path)]) == 0
        own = [(when, frame) for when, frame in together if frame[5] == 7 + number]
        assert comparable(own) == comparable(entries(path))
        assert (tmp_path / f"truth-{7 + number}.json").read_text() == (tmp_path / f"alone-{number}.json").read_text()


@pytest.mark.parametrize("form", [bytes, lambda key: key.hex().encode() + b"\n"])
def test_signed_frames(tmp_path: Path, form: Callable[[bytes], bytes]) -> None:
    key = bytes(range(32))
    file = tmp_path / "key"
    file.write_bytes(form(key))
    flight = record(tmp_path / "f.tlog", "--signing-key", str(file))
    right, wrong = mavlink.MAVLink(None), mavlink.MAVLink(None)
    right.signing.secret_key, wrong.signing.secret_key = key, bytes(32)
    for _, frame in flight:
        right.decode(bytearray(frame))
        with pytest.raises(mavlink.MAVError):
            wrong.decode(bytearray(frame))
    told = [int.from_bytes(frame[-12:-6], "little") for _, frame in flight]
    assert told == sorted(set(told))
    assert told[0] * 10 + 1_420_070_400_000_000 == pytest.approx(flight[0][0], abs=1000)
    assert told[-1] - told[0] == pytest.approx(3e5, abs=100)


def test_mavlink_1(tmp_path: Path, good: Flight) -> None:
    flight = record(tmp_path / "f.tlog", "--mavlink1")
    assert {frame[0] for _, frame in flight} == {0xFE}
    kinds = Counter(m.get_type() for _, m in messages(flight))
    expected = Counter(m.get_type() for _, m in messages(good))
    for name in ("AIRSPEED", "AOA_SSA", "DEBUG_FLOAT_ARRAY"):
        del expected[name]
    assert kinds == expected
    sequence = [m.get_seq() for _, m in messages(flight)]
    assert {(after - before) % 256 for before, after in itertools.pairwise(sequence)} == {1}


@pytest.mark.parametrize("content", [b"", b"short", b"z" * 64, b"a" * 63])
def test_a_file_that_is_no_key_is_one_line(tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "key"
    file.write_bytes(content)
    assert main(["fly", "--record", str(tmp_path / "f.tlog"), "--signing-key", str(file)]) == 1
    error = capsys.readouterr().err
    assert "32 bytes or of 64 hexadecimal digits" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "f.tlog").exists()
