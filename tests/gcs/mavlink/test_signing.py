"""Signatures: frames signed by pymavlink, altered, replayed and made with another key, judged as pymavlink judges."""

import itertools
import time
from pathlib import Path

import numpy as np
import pytest
from mavlink_frames import Sender
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from signed_frames import KEY, NOW, signed, stamp

from gcs.errors import SettingsError
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Framer
from gcs.mavlink.signing import SignatureChecker, SignatureCounts, SignatureMemory, SigningClock, load_key, signing_time

DIALECT = Dialect.load()


def judge(*batches: list[bytes], key: bytes | None = KEY) -> SignatureCounts:
    """What our checker counts, batch by batch."""
    checker, framer = SignatureChecker(key), Framer(DIALECT)
    for batch in batches:
        _, frames = framer.feed(b"".join(batch))
        assert len(frames) == len(batch)
        checker.add(frames, np.full(len(frames), NOW), int(np.count_nonzero(frames.incompat)))
    return checker.counts


def pymavlinks_verdict(frames: list[bytes], key: bytes = KEY) -> list[bool]:
    """What pymavlink's own check says of each frame, in turn."""
    parser = mavlink.MAVLink(None)
    parser.signing.secret_key = key
    parser.signing.timestamp = stamp()
    return [parser.check_signature(bytearray(frame), frame[5], frame[6]) for frame in frames]


def test_frames_signed_by_pymavlink_are_good_and_unsigned_ones_are_counted_apart() -> None:
    frames = signed(40)
    plain = [Sender(2, 1).send("ATTITUDE").frame, Sender(3, 1, version=1).send("ATTITUDE").frame]
    counts = judge(frames[:10], [*frames[10:], *plain])
    assert counts == SignatureCounts(good=40, unsigned=2)
    assert judge(frames, plain, key=None) == SignatureCounts(unverified=40, unsigned=2)


def test_a_frame_altered_in_any_part_of_its_signature_is_bad() -> None:
    for place in range(1, 14):
        frames = signed(5)
        altered = bytearray(frames[2])
        altered[-place] ^= 0x10
        frames[2] = bytes(altered)
        verdicts = pymavlinks_verdict([frames[2]])
        assert verdicts == [False]
        counts = judge(frames)
        assert (counts.good, counts.bad) == (4, 1)


def test_another_key_makes_all_frames_bad() -> None:
    assert judge(signed(7, key=bytes(32))) == SignatureCounts(bad=7)


def test_replayed_frames_are_bad_and_streams_do_not_disturb_each_other() -> None:
    first, second, other_link = signed(10), signed(10, system=2), signed(10, link_id=3)
    mixed = [frame for trio in zip(first, second, other_link, strict=True) for frame in trio]
    assert judge(mixed) == SignatureCounts(good=30)
    counts = judge(mixed, first[3:6])
    assert counts == SignatureCounts(good=30, bad=3, replayed=3)
    assert pymavlinks_verdict([*mixed, *first[3:6]]) == [True] * 30 + [False] * 3


@pytest.mark.parametrize(("age_s", "accepted"), [(-3600.0, False), (-61.0, False), (-59.0, True), (3600.0, True)])
def test_a_new_stream_may_lie_a_minute_back(age_s: float, accepted: bool) -> None:
    frames = signed(3, at_s=age_s)
    assert judge(frames).good == (3 if accepted else 0)
    assert pymavlinks_verdict(frames) == [accepted] * 3


def test_a_frame_that_was_heard_is_no_better_from_another_port_and_a_second_link_no_worse() -> None:
    memory, framer = SignatureMemory(), Framer(DIALECT)
    first, second, stranger = (SignatureChecker(KEY, memory) for _ in range(3))

    def give(checker: SignatureChecker, frames: list[bytes]) -> None:
        _, found = framer.feed(b"".join(frames))
        checker.add(found, np.full(len(found), NOW), len(found))

    stream = [frame for at in range(0, 60, 2) for frame in signed(1, at_s=at)]
    for k in range(0, 30, 2):  # the second link brings the same a little later, but for what it loses
        give(first, stream[k : k + 2])
        give(second, stream[k : k + 1])
    assert first.counts == SignatureCounts(good=30)
    assert second.counts == SignatureCounts(repeated=15)
    give(stranger, stream[:20])
    assert stranger.counts == SignatureCounts(bad=20, replayed=20)
    give(first, stream[-1:])
    give(second, stream[-1:] * 2)
    assert (first.counts.replayed, second.counts.repeated, second.counts.replayed) == (1, 16, 1)
    # The second link goes on alone when the first falls silent.
    give(second, signed(5, at_s=61))
    assert second.counts.good == 5


def test_signatures_of_unknown_messages_are_checked_too() -> None:
    small = Dialect.load("minimal")
    frames = signed(8)
    checker = SignatureChecker(KEY)
    _, found = Framer(small).feed(b"".join(frames), final=True)
    checker.add(found, np.full(len(found), NOW), 8)
    assert len(found) == 8
    assert checker.counts == SignatureCounts(good=8)


def test_keys_are_32_bytes_or_64_digits(tmp_path: Path) -> None:
    path = tmp_path / "key"
    for content in (KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b"\n"):
        path.write_bytes(content)
        assert load_key(path) == KEY
    for wrong in (b"", KEY[:31], KEY + b"\n", b"x" * 64, KEY.hex().encode()[:63], b"\xff" * 64):
        path.write_bytes(wrong)
        with pytest.raises(SettingsError, match="32 bytes") as error:
            load_key(path)
        assert "\n" not in str(error.value)
    with pytest.raises(SettingsError, match="cannot be read"):
        load_key(tmp_path / "none")


def test_own_stamps_tell_the_time_and_always_increase() -> None:
    clock = SigningClock()
    stamps = [clock.next() for _ in range(1000)]
    assert all(later > earlier for earlier, later in itertools.pairwise(stamps))
    assert abs(stamps[-1] - signing_time(time.time_ns())) < 100_000 * 30
