"""Telemetry logs come in whole, noise and all, and go out with the same frames."""

import random
import struct
from pathlib import Path
from time import monotonic

import pytest
from mavlink_frames import Sender
from pymavlink import mavutil

from gcs import tlog
from gcs.errors import ImportFileError, RecordingError
from gcs.recording.reader import Recording
from gcs.tlog import export_tlog, import_tlog

START_US = 1_760_000_000_000_000
NAMES = ("HEARTBEAT", "ATTITUDE", "GPS_RAW_INT", "STATUSTEXT", "SERVO_OUTPUT_RAW")


def a_log(count: int = 300, seed: int = 1) -> list[tuple[int, bytes]]:
    """(time in us, frame), of both protocol versions."""
    sender = Sender(seed=seed)
    log = []
    for i in range(count):
        sender.version = 1 if i % 4 == 0 else 2
        log.append((START_US + 20_000 * i, sender.send(NAMES[i % len(NAMES)]).frame))
    return log


def as_bytes(log: list[tuple[int, bytes]]) -> bytes:
    return b"".join(struct.pack(">Q", time) + frame for time, frame in log)


def test_a_clean_log_goes_in_and_out_unchanged(tmp_path: Path) -> None:
    source, recording, out = tmp_path / "a.tlog", tmp_path / "a.mcap", tmp_path / "b.tlog"
    log = a_log()
    source.write_bytes(as_bytes(log))
    counts = import_tlog(source, recording)
    assert (counts.messages, counts.raw_bytes) == (len(log), 0)
    assert counts.bytes == sum(len(frame) for _, frame in log)
    assert export_tlog(recording, out) == len(log)
    assert out.read_bytes() == source.read_bytes()
    times = [int(time) for c in (Recording(recording).columns(name)[0] for name in NAMES) for time in c.log_time]
    assert sorted(times) == [time * 1000 for time, _ in log]


@pytest.mark.parametrize("block", [1 << 24, 1000, 311])
def test_noise_and_torn_frames_cost_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    monkeypatch.setattr(tlog, "_BLOCK_BYTES", block)
    chooser = random.Random(7)
    log = a_log(400, seed=2)
    data = b""
    noise = 0
    for i, (time, frame) in enumerate(log):
        junk = b""
        if i % 5 == 0:
            junk = bytes(chooser.choices(range(256), k=chooser.randint(1, 30)))
        elif i % 7 == 0:
            junk = struct.pack(">Q", time) + frame[: chooser.randint(1, len(frame) - 1)]
        elif i % 11 == 0:
            junk = b"\xfe\xff"
        noise += len(junk)
        data += junk + struct.pack(">Q", time) + frame
    source, recording, out = tmp_path / "a.tlog", tmp_path / "a.mcap", tmp_path / "b.tlog"
    source.write_bytes(data)
    counts = import_tlog(source, recording)
    assert (counts.messages, counts.raw_bytes) == (len(log), noise)
    export_tlog(recording, out)
    assert out.read_bytes() == as_bytes(log)


def test_pymavlink_reads_what_is_exported(tmp_path: Path) -> None:
    source, recording, out = tmp_path / "a.tlog", tmp_path / "a.mcap", tmp_path / "b.tlog"
    log = a_log(100, seed=3)
    source.write_bytes(as_bytes(log))
    import_tlog(source, recording)
    export_tlog(recording, out)
    reader = mavutil.mavlink_connection(str(out), dialect="ardupilotmega")
    read = []
    while (message := reader.recv_match()) is not None:
        read.append((round(message._timestamp * 1e6), bytes(message.get_msgbuf())))
    reader.close()
    assert read == log


def test_an_odd_stamp_is_replaced_by_its_neighbours(tmp_path: Path) -> None:
    log = a_log(50)
    odd = list(log)
    odd[20] = (START_US + 3_000_000_000_000_000, log[20][1])
    odd[30] = (17, log[30][1])
    source, recording = tmp_path / "a.tlog", tmp_path / "a.mcap"
    source.write_bytes(as_bytes(odd))
    import_tlog(source, recording)
    opened = Recording(recording)
    assert (opened.start_ns, opened.end_ns) == (log[0][0] * 1000, log[-1][0] * 1000)


def test_frames_without_a_stamp_take_the_one_before(tmp_path: Path) -> None:
    log = a_log(3)
    source, recording, out = tmp_path / "a.tlog", tmp_path / "a.mcap", tmp_path / "b.tlog"
    source.write_bytes(as_bytes(log[:2]) + log[2][1])
    import_tlog(source, recording)
    export_tlog(recording, out)
    assert out.read_bytes() == as_bytes([*log[:2], (log[1][0], log[2][1])])


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    target = tmp_path / "a.mcap"
    with pytest.raises(ImportFileError, match="cannot be read"):
        import_tlog(tmp_path / "missing.tlog", target)
    for content in (b"", b"no frame in here at all, just text"):
        (tmp_path / "a.tlog").write_bytes(content)
        with pytest.raises(ImportFileError, match="no MAVLink frame"):
            import_tlog(tmp_path / "a.tlog", target)
        assert not target.exists()
    (tmp_path / "a.tlog").write_bytes(as_bytes(a_log(5)))
    import_tlog(tmp_path / "a.tlog", target)
    with pytest.raises(RecordingError, match="cannot be written"):
        export_tlog(target, tmp_path / "no" / "folder.tlog")


@pytest.mark.parametrize("seed", [0, 3, 4])  # in 1 of 7 such files some checksum is right by chance
def test_a_megabyte_of_noise_is_refused_at_once(tmp_path: Path, seed: int) -> None:
    source, recording = tmp_path / "a.tlog", tmp_path / "a.mcap"
    source.write_bytes(as_bytes(a_log(5)))
    import_tlog(source, recording)  # what is compiled is loaded
    source.write_bytes(random.Random(seed).randbytes(1_000_000))
    started = monotonic()
    with pytest.raises(ImportFileError, match=r"a\.tlog holds no MAVLink frame"):
        import_tlog(source, recording)
    assert monotonic() - started < 1.0
    assert not recording.exists()
