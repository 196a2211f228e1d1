"""Recordings: what other MCAP readers see, the wire rebuilt byte for byte, and files that are cut off or damaged."""

import io
import random
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mavlink_frames import Sender, Sent
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from processes import messages_on_disk
from pymavlink.generator.mavcrc import x25crc
from traffic import wait_until
from wire_streams import wire_streams

from gcs.errors import RecordingError
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Framer
from gcs.recording import container
from gcs.recording.reader import Recording
from gcs.recording.simulator import open_mcap_sink
from gcs.recording.wire import WIRE_TOPIC
from gcs.recording.writer import McapWriter

DIALECT = Dialect.load()
START = 1_760_000_000_000_000_000
SECOND = 1_000_000_000
# Two without padding, four with one or two gaps, two with text.
NAMES = (
    "ATTITUDE",
    "HIGHRES_IMU",
    "GPS_RAW_INT",
    "SERVO_OUTPUT_RAW",
    "BATTERY_STATUS",
    "MANUAL_CONTROL",
    "STATUSTEXT",
    "NAMED_VALUE_FLOAT",
)


def record(path: Path, pieces: list[tuple[int, bytes]], link: str = "udp", **settings: object) -> None:
    """Write pieces (time, bytes) of one link as the recorder would."""
    framer = Framer(DIALECT)
    with McapWriter(path, DIALECT, **settings) as writer:
        for time, data in pieces:
            buffer, frames = framer.feed(data)
            writer.write(link, buffer, frames, time)
        buffer, frames = framer.flush()
        writer.write(link, buffer, frames, pieces[-1][0])


def a_flight(seconds: int = 5, rate: int = 40, seed: int = 1) -> tuple[list[Sent], list[tuple[int, bytes]]]:
    """Messages of both protocol versions and all the names above, and when their bytes came."""
    sender = Sender(seed=seed)
    sent, pieces = [], []
    for i in range(seconds * rate):
        message = sender.send(NAMES[i % len(NAMES)])
        if i % 5 == 0:
            message = as_version_1(message)
        sent.append(message)
        pieces.append((START + i * SECOND // rate, message.frame))
    return sent, pieces


def as_version_1(message: Sent) -> Sent:
    """The same in MAVLink 1, without extension fields (pymavlink would send them)."""
    kind = DIALECT.by_name[message.name]
    payload = message.frame[10 : 10 + message.frame[1]].ljust(kind.base_length, b"\0")[: kind.base_length]
    head = bytes((0xFE, kind.base_length, *message.frame[4:8]))
    return replace(message, frame=head + payload + checksum(head[1:] + payload, kind.crc_extra))


def checksum(data: bytes, crc_extra: int) -> bytes:
    crc = x25crc(data)
    crc.accumulate(bytes((crc_extra,)))
    return struct.pack("<H", crc.crc)


def same(value: object, expected: object) -> bool:
    if isinstance(expected, str):
        return bytes(value).split(b"\0")[0].decode() == expected
    return np.array_equal(np.asarray(value).ravel(), np.asarray(expected, np.asarray(value).dtype).ravel())


def as_sent(message: Sent) -> dict[str, object]:
    """The values that go over the wire: MAVLink 1 as others send it has no extension fields."""
    sent = {}
    for field in DIALECT.by_name[message.name].layout.fields:
        is_cut = message.frame[0] == 0xFE and field.wire_offset >= message.frame[1]
        sent[field.name] = np.zeros(max(field.count, 1)) if is_cut else message.values[field.name]
    return sent


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_another_reader_decodes_the_values_sent(tmp_path: Path, compression: str) -> None:
    sent, pieces = a_flight()
    record(tmp_path / "a.mcap", pieces, compression=compression)
    with open(tmp_path / "a.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        decoded = [entry for entry in reader.iter_decoded_messages() if entry.channel.topic != WIRE_TOPIC]
    assert len(decoded) == len(sent)
    for i, (entry, message) in enumerate(zip(decoded, sent, strict=True)):
        assert entry.channel.topic == f"/mavlink/1/1/{message.name}"
        assert entry.schema.name == DIALECT.by_name[message.name].schema_name
        assert (entry.schema.encoding, entry.channel.message_encoding) == ("ros2msg", "cdr")
        assert entry.message.sequence & 0xFF == message.sequence
        assert entry.message.log_time == pieces[i][0]
        for field, expected in as_sent(message).items():
            assert same(getattr(entry.decoded_message, field), expected), (message.name, field)


def test_columns_hold_the_values_sent(tmp_path: Path) -> None:
    sent, pieces = a_flight()
    record(tmp_path / "a.mcap", pieces)
    recording = Recording(tmp_path / "a.mcap")
    assert recording.messages() == tuple(sorted(NAMES))
    assert recording.systems() == ((1, 1),)
    assert recording.links() == ("udp",)
    assert (recording.start_ns, recording.end_ns) == (pieces[0][0], pieces[-1][0])
    for name in NAMES:
        (columns,) = recording.columns(name)
        chosen = [(message, piece[0]) for message, piece in zip(sent, pieces, strict=True) if message.name == name]
        assert columns.log_time.tolist() == [time for _, time in chosen]
        assert (columns.sequence & 0xFF).tolist() == [message.sequence for message, _ in chosen]
        assert recording.counts()[f"/mavlink/1/1/{name}"] == len(chosen)
        for i, (message, _) in enumerate(chosen):
            for field, expected in as_sent(message).items():
                assert same(columns[field][i], expected), (name, field)
    (texts,) = recording.columns("STATUSTEXT")
    assert texts.text("text").tolist() == [m.values["text"] for m in sent if m.name == "STATUSTEXT"]
    assert recording.columns("HEARTBEAT") == []
    assert recording.columns("ATTITUDE", system=2) == []
    assert not recording.damage


def awkward_stream(seed: int) -> bytes:
    """Frames in every form there is, with noise among them."""
    chooser = random.Random(seed)
    sender, signer = Sender(seed=seed), Sender(component=2, seed=seed + 1)
    signer.sign_from_now()
    forms: list[bytes] = []
    for i in range(150):
        sender.version = 1 if i % 4 == 0 else 2
        name = NAMES[i % len(NAMES)]
        sent = sender.send(name)
        message = sent.frame
        kind = DIALECT.by_name[name]
        forms.append(message)
        forms.append(signer.send(name).frame)
        forms.append(bytes(chooser.choices(range(256), k=chooser.randint(0, 6))))
        if message[0] == 0xFD:
            forms.append(as_version_1(sent).frame)
            # Trailing zeros not cut; longer than our dialect knows; a compatibility flag; an unknown id.
            padded = message[10 : 10 + message[1]].ljust(kind.layout.wire_size, b"\0")
            forms.append(frame_v2(message[:10], padded, kind.crc_extra))
            forms.append(frame_v2(message[:10], padded + b"\1\2\3", kind.crc_extra))
            forms.append(frame_v2(message[:3] + b"\x80" + message[4:10], padded, kind.crc_extra))
            forms.append(frame_v2(message[:7] + (60001).to_bytes(3, "little"), padded[:9], 17))
    return b"".join(forms)


def frame_v2(header: bytes, payload: bytes, crc_extra: int) -> bytes:
    head = header[:1] + bytes((len(payload),)) + header[2:]
    return head + payload + checksum(head[1:] + payload, crc_extra)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_wire_is_rebuilt_byte_for_byte(tmp_path: Path, seed: int) -> None:
    data = awkward_stream(seed)
    chooser = random.Random(seed)
    pieces, at = [], 0
    while at < len(data):
        size = chooser.randint(1, 400)
        pieces.append((START + at * 400_000, data[at : at + size]))
        at += size
    record(tmp_path / "a.mcap", pieces, chunk_seconds=0.5)
    stream = list(wire_streams(Recording(tmp_path / "a.mcap"))["udp"])
    assert b"".join(part for _, part in stream) == data
    times = [time for time, _ in stream]
    assert times == sorted(set(times))
    assert set(times) <= {time for time, _ in pieces}


def test_several_links_are_kept_apart(tmp_path: Path) -> None:
    streams = {"udp": awkward_stream(4), "serial": awkward_stream(5)}
    framers = {link: Framer(DIALECT) for link in streams}
    with McapWriter(tmp_path / "a.mcap", DIALECT) as writer:
        for at in range(0, max(map(len, streams.values())), 300):
            for link, data in streams.items():
                buffer, frames = framers[link].feed(data[at : at + 300], final=at + 300 >= len(data))
                writer.write(link, buffer, frames, START + at * 1_000_000)
        assert writer.counts.bytes == sum(map(len, streams.values()))
    rebuilt = wire_streams(Recording(tmp_path / "a.mcap"))
    assert {link: b"".join(part for _, part in parts) for link, parts in rebuilt.items()} == streams


def test_counts_add_up(tmp_path: Path) -> None:
    data = awkward_stream(6)
    framer = Framer(DIALECT)
    buffer, frames = framer.feed(data, final=True)
    with McapWriter(tmp_path / "a.mcap", DIALECT) as writer:
        writer.write("udp", buffer, frames, START)
        counts = writer.counts
    assert counts.bytes == len(data)
    assert counts.messages + counts.unknown_frames == len(frames)
    assert counts.unknown_frames == frames.unknown
    assert counts.raw_bytes == frames.raw


def test_a_message_over_two_links_counts_once_when_read(tmp_path: Path) -> None:
    sent, pieces = a_flight(seconds=3)
    late = 30_000_000
    framers = {"udp": Framer(DIALECT), "serial": Framer(DIALECT)}
    with McapWriter(tmp_path / "a.mcap", DIALECT) as writer:
        for i, (time, data) in enumerate(pieces):
            for link, delay, lost in (("udp", 0, i % 7 == 0), ("serial", late, i % 11 == 0)):
                if not lost:
                    writer.write(link, *framers[link].feed(data), time + delay)
    recording = Recording(tmp_path / "a.mcap")
    expected = [m for i, m in enumerate(sent) if m.name == "ATTITUDE" and (i % 7 or i % 11)]
    (columns,) = recording.columns("ATTITUDE")
    assert sorted(columns["roll"].tolist()) == sorted(float(m.values["roll"]) for m in expected)
    assert set(recording.lost()) == {("udp", 1, 1), ("serial", 1, 1)}


def test_lost_messages_are_gaps_in_the_counter(tmp_path: Path) -> None:
    sender = Sender(seed=3)
    sent = [sender.send(NAMES[i % 3]) for i in range(1000)]
    dropped = {5, 6, 7, 300, 301, 640}
    # One comes late, as datagrams may: it is not lost.
    order = [i for i in range(1000) if i not in dropped]
    order[100], order[101] = order[101], order[100]
    record(tmp_path / "a.mcap", [(START + n * 1_000_000, sent[i].frame) for n, i in enumerate(order)])
    assert Recording(tmp_path / "a.mcap").lost() == {("udp", 1, 1): len(dropped)}


def test_frames_of_unknown_id_are_not_lost(tmp_path: Path) -> None:
    small = Dialect.load("minimal")
    sender = Sender(seed=3)
    data = b"".join(sender.send(name).frame for name in ("HEARTBEAT", "ATTITUDE", "HEARTBEAT"))
    framer = Framer(small)
    with McapWriter(tmp_path / "a.mcap", small) as writer:
        writer.write("udp", *framer.feed(data), START)
    assert Recording(tmp_path / "a.mcap").lost() == {("udp", 1, 1): 0}


def test_stamps_of_32_bits_are_unwrapped_and_restarts_are_not(tmp_path: Path) -> None:
    # SERVO_OUTPUT_RAW counts microseconds in 32 bits: it wraps after 71.6 minutes.
    sender = Sender(seed=1)
    before = [2**32 - 60_000 + 20_000 * i for i in range(10)]
    restarted = [1_000 + 20_000 * i for i in range(10)]
    stamps = before + restarted
    pieces = [
        (
            START + i * 20_000_000 + (2 * SECOND if i >= 10 else 0),
            sender.send("SERVO_OUTPUT_RAW", time_usec=stamp % 2**32).frame,
        )
        for i, stamp in enumerate(stamps)
    ]
    record(tmp_path / "wrap.mcap", pieces[:10])
    (columns,) = Recording(tmp_path / "wrap.mcap").columns("SERVO_OUTPUT_RAW")
    assert columns.publish_time.tolist() == [stamp * 1000 for stamp in before]
    # A vehicle that ran for an hour and starts anew.
    hour = 3_600_000_000
    pieces = [
        (START + i * 20_000_000, sender.send("SERVO_OUTPUT_RAW", time_usec=stamp).frame)
        for i, stamp in enumerate((hour, hour + 20_000, 1_000, 21_000))
    ]
    record(tmp_path / "restart.mcap", pieces)
    (columns,) = Recording(tmp_path / "restart.mcap").columns("SERVO_OUTPUT_RAW")
    assert columns.publish_time.tolist() == [hour * 1000, (hour + 20_000) * 1000, 1_000_000, 21_000_000]


def test_publish_time_is_the_senders_or_log_time(tmp_path: Path) -> None:
    sender = Sender()
    frames = sender.send("ATTITUDE", time_boot_ms=1234).frame + sender.send("VFR_HUD").frame
    record(tmp_path / "a.mcap", [(START, frames)])
    recording = Recording(tmp_path / "a.mcap")
    assert recording.columns("ATTITUDE")[0].publish_time.tolist() == [1_234_000_000]
    assert recording.columns("VFR_HUD")[0].publish_time.tolist() == [START]


def test_log_time_never_steps_back(tmp_path: Path) -> None:
    sender = Sender()
    times = [START, START + 50, START - 10 * SECOND, START + 60]
    record(tmp_path / "a.mcap", [(time, sender.send("HEARTBEAT").frame) for time in times])
    (columns,) = Recording(tmp_path / "a.mcap").columns("HEARTBEAT")
    assert columns.log_time.tolist() == [START, START + 50, START + 50, START + 60]


def test_attachments_and_metadata(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    _, pieces = a_flight(seconds=1)
    framer = Framer(DIALECT)
    with McapWriter(path, DIALECT) as writer:
        writer.metadata("flight", {"vehicle": "iitb-mav", "place": "Powai"})
        writer.write("udp", *framer.feed(pieces[0][1]), pieces[0][0])
        writer.attach("vehicle.toml", "application/toml", b'name = "x"\n')
    recording = Recording(path)
    assert recording.metadata() == {"flight": {"vehicle": "iitb-mav", "place": "Powai"}}
    assert [(a.name, a.media_type, a.data) for a in recording.attachments()] == [
        ("vehicle.toml", "application/toml", b'name = "x"\n')
    ]
    with open(path, "rb") as file:
        reader = make_reader(file)
        assert [m.metadata for m in reader.iter_metadata()] == [{"vehicle": "iitb-mav", "place": "Powai"}]
        assert [a.data for a in reader.iter_attachments()] == [b'name = "x"\n']


def test_checksums_and_statistics_are_those_of_the_specification(tmp_path: Path) -> None:
    sent, pieces = a_flight()
    path = tmp_path / "a.mcap"
    record(path, pieces)
    data = path.read_bytes()
    data_end = data.rindex(struct.pack("<BQ", 0x0F, 4), 0, len(data) - 37 - 8)
    with open(path, "rb") as file:
        summary = make_reader(file).get_summary()
        records = list(StreamReader(io.BytesIO(data), validate_crcs=True).records)
    # DataEnd: checksum of everything in front of it.
    ends = [record for record in records if type(record).__name__ == "DataEnd"]
    place = data.index(struct.pack("<BQI", 0x0F, 4, ends[0].data_section_crc))
    assert ends[0].data_section_crc == zlib.crc32(data[:place])
    assert data_end >= place
    statistics = summary.statistics
    assert statistics.message_count == len(sent) + statistics.chunk_count
    assert statistics.channel_count == len(NAMES) + 1
    assert (statistics.message_start_time, statistics.message_end_time) == (pieces[0][0], pieces[-1][0])
    assert statistics.chunk_count == 5
    for index in summary.chunk_indexes:
        assert index.message_end_time - index.message_start_time < SECOND


def test_a_file_cut_off_anywhere_opens_and_loses_at_most_its_last_second(tmp_path: Path) -> None:
    sent, pieces = a_flight(seconds=4)
    whole = tmp_path / "whole.mcap"
    record(whole, pieces)
    data = whole.read_bytes()
    with open(whole, "rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    ends = [chunk.chunk_start_offset + chunk.chunk_length for chunk in chunks]
    cut = tmp_path / "cut.mcap"
    for length in [*range(ends[0], len(data), 97), *ends, *(end - 1 for end in ends[1:]), len(data) - 1]:
        cut.write_bytes(data[:length])
        recording = Recording(cut)
        complete = sum(end <= length for end in ends)
        assert recording.damage.truncated == (length < len(data) - 8)
        assert recording.damage.chunks == 0
        assert sum(recording.counts().values()) == 40 * complete
        stream = b"".join(part for _, part in wire_streams(recording)["udp"])
        assert stream == b"".join(message.frame for message in sent[: 40 * complete])


def test_what_was_written_is_in_the_file_a_second_later(tmp_path: Path) -> None:
    _, pieces = a_flight(seconds=1)
    path = tmp_path / "a.mcap"
    framer = Framer(DIALECT)
    writer = McapWriter(path, DIALECT)
    for time, data in pieces:
        writer.write("udp", *framer.feed(data), time)
    writer.tick(START + SECOND // 2)
    with pytest.raises(RecordingError, match="cut off"):
        Recording(path)
    writer.tick(START + SECOND)
    wait_until(lambda: messages_on_disk(path) == len(pieces))
    writer.close()
    assert sum(Recording(path).counts().values()) == len(pieces)


def test_flipped_bits_cost_one_chunk_and_are_reported(tmp_path: Path) -> None:
    sent, pieces = a_flight(seconds=6)
    whole = tmp_path / "whole.mcap"
    record(whole, pieces)
    data = whole.read_bytes()
    with open(whole, "rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    bad = tmp_path / "bad.mcap"
    third = chunks[2]
    # In the stored data, in the length of the data; in the chunk record's own length, and in the file's first bytes,
    # which the summary and the end make up for.
    third_data = third.chunk_start_offset + third.chunk_length // 2
    third_size = third.chunk_start_offset + 9 + 28 + 4 + 4
    for place, lost in ((third_data, 40), (third_size, 40), (third.chunk_start_offset + 3, 0), (5, 0), (11, 0)):
        changed = bytearray(data)
        changed[place] ^= 0x40
        bad.write_bytes(changed)
        recording = Recording(bad)
        assert bool(recording.damage) == (lost > 0), place
        assert len(recording.damage.notes) == 1
        assert sum(recording.counts().values()) == len(sent) - lost
        (columns,) = recording.columns("ATTITUDE")
        assert len(columns) == 6 * 5 - lost // 8


def test_files_that_are_no_recording_are_refused_in_one_line(tmp_path: Path) -> None:
    _, pieces = a_flight(seconds=1)
    record(tmp_path / "whole.mcap", pieces)
    whole = (tmp_path / "whole.mcap").read_bytes()
    cases = {
        "empty": (b"", "is empty"),
        "text": (b"Dear pilot, this is no recording at all.", "not an MCAP file"),
        "magic": (whole[:5], "cut off before"),
        "header": (whole[:60], "cut off before"),
    }
    for name, (content, expected) in cases.items():
        path = tmp_path / f"{name}.mcap"
        path.write_bytes(content)
        with pytest.raises(RecordingError, match=expected) as caught:
            Recording(path)
        assert "\n" not in str(caught.value)
        assert str(path) in str(caught.value)
    with pytest.raises(RecordingError, match="cannot be read"):
        Recording(tmp_path / "missing.mcap")
    with pytest.raises(RecordingError, match="cannot be written"):
        McapWriter(tmp_path / "no" / "folder.mcap", DIALECT)
    with pytest.raises(RecordingError, match="unknown compression"):
        McapWriter(tmp_path / "a.mcap", DIALECT, compression="rar")


def test_large_batches_make_several_chunks(tmp_path: Path) -> None:
    sender = Sender(seed=9)
    block = b"".join(sender.send(NAMES[i % len(NAMES)]).frame for i in range(256))
    noise = np.random.default_rng(2).integers(0, 250, 3_000_000, np.uint8).tobytes()
    data = block * 150 + noise + block
    path = tmp_path / "a.mcap"
    record(path, [(START, data)])
    recording = Recording(path)
    assert sum(recording.counts().values()) == 256 * 151
    assert recording.lost() == {("udp", 1, 1): 0}
    assert b"".join(part for _, part in wire_streams(recording)["udp"]) == data


def test_recordings_larger_than_what_is_held_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sent, pieces = a_flight(seconds=8)
    record(tmp_path / "a.mcap", pieces)
    whole = Recording(tmp_path / "a.mcap")
    (expected,) = whole.columns("GPS_RAW_INT")
    monkeypatch.setattr(container, "GROUP_BYTES", 10_000)
    parts = Recording(tmp_path / "a.mcap")
    (columns,) = parts.columns("GPS_RAW_INT")
    assert columns.fields.tobytes() == expected.fields.tobytes()
    assert columns.log_time.tolist() == expected.log_time.tolist()
    assert parts.counts() == whole.counts()
    assert parts.lost() == whole.lost()
    stream = b"".join(part for _, part in wire_streams(parts)["udp"])
    assert stream == b"".join(message.frame for message in sent)


def test_the_simulator_may_record_with_it(tmp_path: Path) -> None:
    sent, pieces = a_flight(seconds=2)
    sink = open_mcap_sink(str(tmp_path / "a.mcap"))
    for time, data in pieces:
        sink.write(data, time)
    sink.close()
    stream = wire_streams(Recording(tmp_path / "a.mcap"))["simulator"]
    assert list(stream) == pieces
    assert len(sent) == len(pieces)
