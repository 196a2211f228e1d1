"""More senders than any network of vehicles has: what they send is kept, and those that came before stay apart."""

import logging
import random
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from recorded_stream import DIALECT, START
from wire_streams import wire_streams

from gcs.mavlink.framing import Framer
from gcs.recording.reader import Recording
from gcs.recording.writer import McapWriter

APART = 1024


def test_what_further_senders_send_is_kept_as_bytes(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    senders = [(system, component) for system in range(1, 9) for component in range(1, 251)]
    voices = {sender: mavlink.MAVLink(None, *sender) for sender in senders}
    order = senders + random.Random(1).choices(senders, k=3000)
    frames_of = [mavlink.MAVLink_ping_message(at, at, 0, 0).pack(voices[one]) for at, one in enumerate(order)]
    for one, frame in zip(order, frames_of, strict=True):
        assert (frame[5], frame[6]) == one
    framer = Framer(DIALECT)
    with (
        caplog.at_level(logging.WARNING),
        McapWriter(tmp_path / "a.mcap", DIALECT, chunk_seconds=0.1) as writer,
    ):
        for at, frame in enumerate(frames_of):
            writer.write("udp", *framer.feed(frame), START + at * 1_000_000)
    apart = set(senders[:APART])
    recording = Recording(tmp_path / "a.mcap")
    kept = {(one.system, one.component): one.fields["seq"].tolist() for one in recording.columns("PING")}
    assert kept == {who: [at for at, one in enumerate(order) if one == who] for who in apart}
    assert writer.counts.unknown_frames == sum(one not in apart for one in order)
    assert b"".join(part for _, part in wire_streams(recording)["udp"]) == b"".join(frames_of)
    assert [record.getMessage() for record in caplog.records] == [
        "a.mcap: more than 1024 components or 8192 messages of theirs; what further ones send is kept as bytes"
    ]


def test_no_number_of_messages_of_others_takes_those_of_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs.recording.writer._MOST_CHANNELS", 100)
    monkeypatch.setattr("gcs.recording.writer._FIRST_COMPONENTS", 2)
    first, second, crowd = (
        [mavlink.MAVLink(None, *one) for one in some]
        for some in ([(1, 1)], [(2, 1)], [(9, number) for number in range(1, 100)])
    )
    early = mavlink.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3)
    late = mavlink.MAVLink_system_time_message(5, 6)
    ping = mavlink.MAVLink_ping_message(1, 7, 0, 0)
    frames = [early.pack(voice) for voice in (*first, *second)]
    frames += [message.pack(voice) for voice in crowd for message in (early, ping)]
    frames += [late.pack(voice) for voice in (*first, *second, *crowd)]
    with McapWriter(tmp_path / "a.mcap", DIALECT) as writer:
        writer.write("udp", *Framer(DIALECT).feed(b"".join(frames)), START)
    recording = Recording(tmp_path / "a.mcap")
    assert {(one.system, one.component) for one in recording.columns("SYSTEM_TIME")} == {(1, 1), (2, 1)}
    # That of the link, two HEARTBEATs, 97 messages of 49 of the crowd; then all is full.
    assert len(recording.columns("HEARTBEAT", system=9)) == 49
    assert len(recording.columns("PING", system=9)) == 48
    assert b"".join(part for _, part in wire_streams(recording)["udp"]) == b"".join(frames)
