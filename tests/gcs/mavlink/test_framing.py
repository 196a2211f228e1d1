"""Frames are found by their checksums, noise is accounted for, and nothing swallows a good frame."""

import random

import numpy as np
import pytest
from mavlink_frames import Sender, Sent, message_names

from gcs.mavlink.crc import CRC_TABLES, crc_accumulate, crc_of
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import KNOWN, KNOWN_SIGNED, UNKNOWN, Framer, Frames, scan

DIALECT = Dialect.load()


def frames_of(data: bytes, dialect: Dialect = DIALECT, final: bool = True) -> Frames:
    return scan(np.frombuffer(data, np.uint8), dialect, final)


def found(frames: Frames) -> list[bytes]:
    return [frames.frame(i) for i in range(len(frames))]


def some_messages(count: int = 60, seed: int = 3) -> list[Sent]:
    sender = Sender(system=7, component=9, seed=seed)
    names = ("HEARTBEAT", "ATTITUDE", "HIGHRES_IMU", "GPS_RAW_INT", "STATUSTEXT", "SERVO_OUTPUT_RAW")
    messages = []
    for i in range(count):
        sender.version = 1 if i % 3 == 0 else 2
        messages.append(sender.send(names[i % len(names)]))
    return messages


def test_checksum_has_the_published_check_value() -> None:
    # Catalogue of parametrised CRC algorithms, CRC-16/MCRF4XX: check = 0x6f91.
    data = b"123456789"
    assert crc_of(data) == 0x6F91
    assert crc_accumulate(np.frombuffer(data, np.uint8), 0, 9, 0xFFFF, CRC_TABLES) == 0x6F91


@pytest.mark.parametrize("version", [1, 2])
def test_every_message_of_the_dialect_is_found(version: int) -> None:
    sender = Sender(system=3, component=200, seed=1, version=version)
    names = [name for name in message_names() if version == 2 or DIALECT.by_name[name].id < 256]
    sent = [sender.send(name) for name in names]
    frames = frames_of(b"".join(message.frame for message in sent))
    assert found(frames) == [message.frame for message in sent]
    assert frames.raw == 0
    assert frames.bad_crc == 0
    assert frames.msgid.tolist() == [DIALECT.by_name[name].id for name in names]
    assert [DIALECT.messages[i].name for i in frames.message] == names
    assert frames.seq.tolist() == [message.sequence for message in sent]
    assert set(frames.sysid.tolist()) == {3}
    assert set(frames.compid.tolist()) == {200}
    assert set(frames.kind.tolist()) == {KNOWN}


def test_every_byte_among_noise_is_accounted_for() -> None:
    chooser = random.Random(5)
    sent = some_messages()
    data, places = b"", []
    for message in sent:
        # False headers of both versions that claim more bytes than follow before the next frame.
        data += bytes(chooser.choices(range(256), k=chooser.randint(0, 9))) + chooser.choice(
            (b"", b"\xfe\xff", b"\xfd\xff\0")
        )
        places.append(len(data))
        data += message.frame
    data += b"\xfe\x20\x01"
    frames = frames_of(data)
    assert frames.offset.tolist() == places
    assert found(frames) == [message.frame for message in sent]
    assert frames.consumed == len(data)
    assert frames.raw == len(data) - sum(len(message.frame) for message in sent)


def test_no_damaged_byte_passes_and_the_next_frame_survives() -> None:
    first, second = some_messages(2, seed=8)
    for at in range(len(first.frame)):
        for flip in (0x01, 0x80):
            broken = bytearray(first.frame)
            broken[at] ^= flip
            assert found(frames_of(bytes(broken) + second.frame)) == [second.frame], (at, flip)


def test_a_torn_frame_costs_only_itself() -> None:
    first, second = some_messages(2, seed=9)
    for length in range(1, len(first.frame)):
        assert found(frames_of(first.frame[:length] + second.frame)) == [second.frame]


def test_signed_frames_carry_their_signature() -> None:
    sender = Sender(seed=2)
    plain = sender.send("ATTITUDE")
    sender.sign_from_now()
    signed = sender.send("ATTITUDE")
    frames = frames_of(plain.frame + signed.frame + plain.frame)
    assert found(frames) == [plain.frame, signed.frame, plain.frame]
    assert frames.kind.tolist() == [KNOWN, KNOWN_SIGNED, KNOWN]
    assert frames.incompat.tolist() == [0, 1, 0]


def test_frames_with_an_unknown_incompatibility_flag_are_refused() -> None:
    message = Sender().send("HEARTBEAT")
    changed = bytearray(message.frame)
    changed[2] = 0x02
    end = 10 + changed[1]
    checksum = crc_of(bytes(changed[1:end]) + bytes((DIALECT.by_name["HEARTBEAT"].crc_extra,)))
    changed[end : end + 2] = checksum.to_bytes(2, "little")
    assert found(frames_of(bytes(changed))) == []


def test_frames_of_unknown_id_are_told_apart_and_kept_whole() -> None:
    small = Dialect.load("minimal")
    sender = Sender(seed=4)
    heartbeat, strange = sender.send("HEARTBEAT"), sender.send("ATTITUDE")
    frames = frames_of(heartbeat.frame + strange.frame + heartbeat.frame, small)
    assert found(frames) == [heartbeat.frame, strange.frame, heartbeat.frame]
    assert frames.kind.tolist() == [KNOWN, UNKNOWN, KNOWN]
    assert frames.message.tolist()[1] == -1
    assert frames.unknown == 1
    assert frames.raw == 0


def test_an_unknown_id_never_swallows_a_good_frame() -> None:
    heartbeat = Sender().send("HEARTBEAT")
    # A frame of an unknown id, right checksum for any seed, whose payload is a whole good frame.
    head = bytes((0xFD, len(heartbeat.frame), 0, 0, 0, 1, 1)) + (70000).to_bytes(3, "little")
    checksum = crc_of(head[1:] + heartbeat.frame + b"\x55").to_bytes(2, "little")
    assert found(frames_of(head + heartbeat.frame + checksum)) == [heartbeat.frame]


def test_noise_is_rarely_taken_for_a_frame() -> None:
    noise = np.random.default_rng(11).integers(0, 256, 2_000_000, np.uint8)
    frames = scan(noise, DIALECT, True)
    # Of 2e6 bytes: a known id passes with 2^-16, an unknown one with 2^-8, after the magic and the flags.
    assert np.count_nonzero(frames.kind != UNKNOWN) <= 3
    assert len(frames) < 60
    assert frames.consumed == noise.size


@pytest.mark.parametrize("piece", [1, 2, 7, 64, 1000])
def test_pieces_of_any_size_give_the_same_frames(piece: int) -> None:
    sent = some_messages(30, seed=6)
    data = b"\xfe\xfd".join(message.frame for message in sent) + b"\xfd\x10"
    framer = Framer(DIALECT)
    frames: list[bytes] = []
    stream = b""
    for start in range(0, len(data), piece):
        buffer, part = framer.feed(data[start : start + piece])
        assert buffer.size == part.consumed
        frames += found(part)
        stream += buffer.tobytes()
    buffer, part = framer.flush()
    assert frames + found(part) == [message.frame for message in sent]
    assert stream + buffer.tobytes() == data
    assert framer.pending == 0


def test_flush_frees_frames_behind_a_false_header() -> None:
    message = Sender().send("HEARTBEAT")
    framer = Framer(DIALECT)
    buffer, frames = framer.feed(b"\xfe\xff" + message.frame)
    assert (buffer.size, len(frames), framer.pending) == (0, 0, 2 + len(message.frame))
    buffer, frames = framer.flush()
    assert found(frames) == [message.frame]
    assert frames.raw == 2


def test_wrong_checksums_are_counted() -> None:
    message = Sender().send("ATTITUDE")
    broken = message.frame[:-1] + bytes((message.frame[-1] ^ 1,))
    assert frames_of(broken + message.frame).bad_crc == 1
