"""Telemetry logs come in whole, noise and all, and go out with the same frames."""

import random
import struct
from pathlib import Path
from time import process_time

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from mavlink_frames import Sender
from pymavlink import mavutil
from pymavlink.generator.mavcrc import x25crc

from gcs.errors import ImportFileError, RecordingError
from gcs.formats import tlog
from gcs.formats.tlog import export_tlog, import_tlog
from gcs.recording.reader import Recording

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


@pytest.mark.parametrize("block", [1 << 24, 1000])
def test_a_computer_s_clock_that_is_set_back_while_it_records_moves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    """Set back by an hour after 100 frames, by 5 s after 200; one stamp early by itself is none of it."""
    monkeypatch.setattr(tlog, "_BLOCK_BYTES", block)
    log = a_log()
    back = [0 if i < 100 else 3_600_000_000 if i < 200 else 3_605_000_000 for i in range(len(log))]
    source, recording = tmp_path / "a.tlog", tmp_path / "a.mcap"
    source.write_bytes(as_bytes([(time - by, frame) for (time, frame), by in zip(log, back, strict=True)]))
    import_tlog(source, recording)
    opened = Recording(recording)
    times = sorted(int(time) for c in (opened.columns(name)[0] for name in NAMES) for time in c.log_time)
    # At each of the two moments the interval between two frames is lost.
    assert times == [(time - 20_000 * sum(i >= at for at in (100, 200))) * 1000 for i, (time, _) in enumerate(log)]
    assert opened.metadata()["import"]["warning clock"].startswith("the computer's clock was set back by 3605 s")
    odd = [(time - 5_000_000 if i == 150 else time, frame) for i, (time, frame) in enumerate(log)]
    source.write_bytes(as_bytes(odd))
    import_tlog(source, tmp_path / "odd.mcap")
    assert "warning clock" not in Recording(tmp_path / "odd.mcap").metadata()["import"]


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
def test_a_megabyte_of_noise_is_refused_soon(tmp_path: Path, seed: int) -> None:
    source, recording = tmp_path / "a.tlog", tmp_path / "a.mcap"
    source.write_bytes(as_bytes(a_log(5)))
    import_tlog(source, tmp_path / "b.mcap")  # what is compiled is loaded
    source.write_bytes(random.Random(seed).randbytes(1_000_000))
    started = process_time()  # of the processor: a busy machine does not change it
    with pytest.raises(ImportFileError, match=r"a\.tlog holds no MAVLink frame"):
        import_tlog(source, recording)
    assert process_time() - started < 30.0  # and not the hour that trying every length at every byte would take
    assert not recording.exists()


def unknown_frame(chooser: random.Random) -> bytes:
    """A MAVLink 2 frame of an id that the dialect lacks, its checksum right for some CRC_EXTRA."""
    payload = chooser.randbytes(chooser.randint(1, 40))
    head = bytes((len(payload), 0, 0, chooser.randrange(256), 1, 1)) + (50_000).to_bytes(3, "little")
    crc = x25crc(head + payload + bytes((chooser.randrange(256),))).crc
    return b"\xfd" + head + payload + struct.pack("<H", crc)


def is_a_frame_by_chance(data: bytes, start: int) -> bool:
    """Whether a checksum is right for some CRC_EXTRA where noise begins a frame: 1 of 256 such places."""
    head = 10 if data[start] == 0xFD else 6
    end = start + head + (data[start + 1] if start + 1 < len(data) else 0)
    if end + 2 > len(data):
        return False
    found = int.from_bytes(data[end : end + 2], "little")
    return any(x25crc(data[start + 1 : end] + bytes((extra,))).crc == found for extra in range(256))


@st.composite
def mixed_logs(draw: st.DrawFn) -> tuple[list[tuple[int, bytes]], bytes, int]:
    """(time, frame) of several systems, the log's bytes with noise in it, and how many bytes of noise."""
    chooser = random.Random(draw(st.integers(0, 2**32)))
    senders = [Sender(system, component, seed=system) for system, component in ((1, 1), (1, 154), (7, 1), (255, 190))]
    log: list[tuple[int, bytes]] = []
    data, noise, now, flags = b"", 0, START_US, []
    for kind in draw(st.lists(st.sampled_from(("v1", "v2", "signed", "unknown", "noise", "flag")), min_size=1)):
        now += draw(st.sampled_from((0, 1, 20_000, 5_000_000)))
        sender = chooser.choice(senders)
        if kind in ("noise", "flag"):
            # Zero bytes are in no stamp of these times and in no frame's first byte.
            junk = b"\x00" * chooser.randint(1, 20) if kind == "noise" else b"\xfe\xfd\x00"
            noise += len(junk)
            flags += [len(data), len(data) + 1] if kind == "flag" else []
            data += junk
            continue
        sender.version = 1 if kind == "v1" else 2
        sender.mavlink.signing.sign_outgoing = kind == "signed"
        sender.mavlink.signing.secret_key = bytes(range(32))
        frame = unknown_frame(chooser) if kind == "unknown" else sender.send(chooser.choice(NAMES)).frame
        log.append((now, frame))
        data += struct.pack(">Q", now) + frame
    # Frames of known id, so that the file is a log; their count fixes the time of what may precede them.
    for _ in range(10):
        senders[0].version = 2
        senders[0].mavlink.signing.sign_outgoing = False
        log.append((now, senders[0].send("ATTITUDE").frame))
        data += struct.pack(">Q", now) + log[-1][1]
    assume(not any(is_a_frame_by_chance(data, place) for place in flags))
    return log, data, noise


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mixed_logs())
def test_what_any_mix_of_frames_and_noise_holds_comes_out_frame_for_frame(
    tmp_path: Path, mixed: tuple[list[tuple[int, bytes]], bytes, int]
) -> None:
    log, data, noise = mixed
    source, recording, out = tmp_path / "a.tlog", tmp_path / "a.mcap", tmp_path / "b.tlog"
    source.write_bytes(data)
    recording.unlink(missing_ok=True)
    counts = import_tlog(source, recording)
    assert counts.messages + counts.unknown_frames == len(log)
    assert counts.raw_bytes == noise
    assert counts.bytes == noise + sum(len(frame) for _, frame in log)
    assert export_tlog(recording, out) == len(log)
    assert out.read_bytes() == as_bytes(log)


def test_noise_with_a_frame_by_chance_is_refused(tmp_path: Path) -> None:
    """In 10 MB of noise a frame or two have a right checksum; without a time in front of them they are none."""
    chooser = random.Random(5)
    frame = Sender(seed=8).send("ATTITUDE").frame
    noise = chooser.randbytes(150_000)
    source, recording = tmp_path / "a.tlog", tmp_path / "a.mcap"
    source.write_bytes(noise + b"\xff" * 8 + frame + noise)
    with pytest.raises(ImportFileError, match=r"a\.tlog holds no MAVLink frame"):
        import_tlog(source, recording)
    assert not recording.exists()
    source.write_bytes(noise + struct.pack(">Q", START_US) + frame + noise)
    assert import_tlog(source, recording).messages == 1
