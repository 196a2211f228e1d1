"""The file behind a recording: chunks written by a thread, forced to disk, refused by a full disk, split into parts."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from mcap.reader import make_reader
from processes import messages_on_disk
from recorded_stream import DIALECT, NAMES, SECOND, START, Stream, stream_of
from traffic import wait_until
from wire_streams import wire_streams

from gcs.errors import DiskFullError, RecordingError, SettingsError
from gcs.recording.joined import by_recording
from gcs.recording.parts import Provenance, RecordingParts
from gcs.recording.reader import Recording
from gcs.recording.storage import StorageOptions, SyncPolicy
from gcs.recording.writer import McapWriter


def test_chunks_are_written_in_order_behind_the_receiving_thread(tmp_path: Path) -> None:
    stream = Stream()
    with McapWriter(tmp_path / "a.mcap", DIALECT, chunk_seconds=0.05) as writer:
        writer.metadata("recording", {"flight": "x"})
        stream.feed(writer, 200)
        writer.attach("vehicle.toml", "text/plain", b"mass")
        stream.feed(writer, 200)
        writer.flush()
        assert stream_of(tmp_path / "a.mcap") == stream.bytes
        stream.feed(writer, 3)
    assert stream_of(tmp_path / "a.mcap") == stream.bytes
    with open(tmp_path / "a.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 50
        times = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
    assert times == sorted(times)
    assert not Recording(tmp_path / "a.mcap").damage


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("never", SyncPolicy(None, False)),
        ("close", SyncPolicy(None, True)),
        ("chunk", SyncPolicy(0.0, True)),
        ("2.5", SyncPolicy(2.5, True)),
    ],
)
def test_when_to_force_to_disk_is_said_in_a_word_or_seconds(text: str, expected: SyncPolicy) -> None:
    assert SyncPolicy.parse(text) == expected


@pytest.mark.parametrize("text", ["", "always", "0", "-1", "nan", "1e9"])
def test_a_policy_that_cannot_be_meant_is_refused(text: str) -> None:
    with pytest.raises(SettingsError, match="--fsync"):
        SyncPolicy.parse(text)


@pytest.mark.parametrize(("policy", "least", "most"), [("never", 0, 0), ("close", 1, 1), ("chunk", 8, 12)])
def test_the_disk_is_asked_as_often_as_the_policy_says(
    policy: str, least: int, most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The calls are real; they are counted on their way, since nothing short of a power cut shows their effect."""
    calls: list[int] = []
    real = os.fdatasync

    def counted(handle: int) -> None:
        calls.append(handle)
        real(handle)

    monkeypatch.setattr(os, "fdatasync", counted)
    stream = Stream()
    with McapWriter(tmp_path / "a.mcap", DIALECT, chunk_seconds=0.1, sync=SyncPolicy.parse(policy)) as writer:
        stream.feed(writer, 100)
    assert least <= len(calls) <= most


def test_an_idle_recording_is_forced_to_disk_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    folders: list[str] = []
    monkeypatch.setattr(os, "fdatasync", calls.append)
    monkeypatch.setattr(os, "fsync", lambda handle: folders.append(os.readlink(f"/proc/self/fd/{handle}")))
    stream = Stream()
    with McapWriter(tmp_path / "a.mcap", DIALECT, sync=SyncPolicy.parse("0.05")) as writer:
        stream.feed(writer, 10)
        writer.tick(stream.time + SECOND)
        # On a slow machine they are forced in two portions.
        wait_until(lambda: calls and messages_on_disk(tmp_path / "a.mcap") == 10)
        wait_until(lambda: folders == [str(tmp_path)])  # its name too, which a power cut would else take
        before = len(calls)
        stream.feed(writer, 10)
        writer.tick(stream.time + SECOND)
        wait_until(lambda: len(calls) > before)
    assert folders == [str(tmp_path)]


def test_parts_feign_no_loss_and_join_to_the_stream(tmp_path: Path) -> None:
    stream, other = Stream(), Stream(seed=2)
    paths = [tmp_path / name for name in ("a.mcap", "a.part2.mcap", "a.part3.mcap")]
    with McapWriter(paths[0], DIALECT) as writer:
        for following in (*paths[1:], None):
            stream.feed(writer, 70)
            other.feed(writer, 30, "serial")
            if following is not None:
                writer.roll(following)
        assert writer.path == paths[2]
        assert writer.counts.messages == 300
    counters: list[int] = []
    for number, path in enumerate(paths):
        recording = Recording(path)
        assert not recording.damage
        assert sum(recording.counts().values()) == 100
        assert set(recording.lost().values()) == {0}
        counters += sorted(
            counter
            for name in NAMES
            for columns in recording.columns(name)
            for counter in columns.sequence.tolist()
            if number == 0 or counter >= 70 * number
        )
        with open(path, "rb") as file:
            reader = make_reader(file, validate_crcs=True)
            summary = reader.get_summary()
            assert summary is not None
            assert summary.statistics is not None
            assert summary.statistics.message_count == sum(1 for _ in reader.iter_messages())
    assert b"".join(map(stream_of, paths)) == stream.bytes
    assert b"".join(stream_of(path, "serial") for path in paths) == other.bytes


def test_a_part_that_cannot_be_begun_leaves_the_first_open(tmp_path: Path) -> None:
    stream = Stream()
    with McapWriter(tmp_path / "a.mcap", DIALECT) as writer:
        stream.feed(writer, 10)
        with pytest.raises(RecordingError, match="No such file"):
            writer.roll(tmp_path / "nowhere" / "b.mcap")
        stream.feed(writer, 10)
    assert stream_of(tmp_path / "a.mcap") == stream.bytes


def test_the_reserve_of_the_disk_stays_free_and_the_file_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = Stream()
    room = os.statvfs(tmp_path)
    free = room.f_bavail * room.f_frsize
    writer = McapWriter(tmp_path / "a.mcap", DIALECT, chunk_seconds=0.1, reserve_bytes=free // 2)
    stream.feed(writer, 50)
    writer.flush()
    kept = stream.bytes
    # From here on the disk seems to hold less than the reserve.
    monkeypatch.setattr(os, "fstatvfs", lambda handle: os.statvfs_result((4096, 4096, 9, 9, 9, 9, 9, 9, 0, 255)))
    stream.feed(writer, 9)
    with pytest.raises(DiskFullError, match="reserve") as error:
        writer.flush()
    assert "\n" not in str(error.value)
    writer.close()
    assert writer.lost.bytes == len(stream.bytes) - len(kept)
    assert writer.lost.messages == 9
    recording = Recording(tmp_path / "a.mcap")
    assert not recording.damage
    assert not recording.damage.truncated
    assert stream_of(tmp_path / "a.mcap") == kept


LIMITED = """
import resource, signal, sys
from pathlib import Path
sys.path.insert(0, {support!r})
from gcs.errors import RecordingError
from recorded_stream import DIALECT, McapWriter, Stream
with McapWriter(Path({path!r} + ".first"), DIALECT) as first:  # compiles, and keeps what it compiled on disk
    Stream().feed(first, 10)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, resource.RLIM_INFINITY))
writer, stream = McapWriter(Path({path!r}), DIALECT, chunk_seconds=0.1), Stream()
try:
    for _ in range(1000):
        stream.feed(writer, 10)
        writer.flush()
except RecordingError as error:
    print(error)
writer.close()
print(len(stream.bytes) - writer.lost.bytes, writer.lost.messages)
"""


@pytest.mark.parametrize("limit", [5_000, 20_011])
def test_a_file_that_the_system_refuses_to_extend_stays_readable(limit: int, tmp_path: Path) -> None:
    """A limit on the size of files stands for the full disk: the system refuses in the middle of a record."""
    path = tmp_path / "a.mcap"
    support = Path(__file__).resolve().parents[2] / "support"
    program = LIMITED.format(support=str(support), limit=limit, path=str(path))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    error, numbers = done.stdout.splitlines()
    assert error == f"{path} cannot be written: File too large"
    kept, lost = map(int, numbers.split())
    recording = Recording(path)
    assert recording.damage.bytes == 0
    assert path.stat().st_size <= limit
    assert len(stream_of(path)) == kept > 0
    assert lost > 0


def test_the_parts_of_a_recording_read_as_one(tmp_path: Path) -> None:
    stream = Stream()
    paths = [tmp_path / name for name in ("a.mcap", "a.part2.mcap", "a.part3.mcap")]
    with McapWriter(paths[0], DIALECT) as writer:
        writer.metadata("recording", {"part": "1"})
        for following in paths[1:]:
            stream.feed(writer, 50)
            writer.roll(following)
        stream.feed(writer, 50)
    with McapWriter(tmp_path / "whole.mcap", DIALECT) as writer:
        Stream().feed(writer, 150)
    whole, joined = Recording(tmp_path / "whole.mcap"), Recording(paths)
    assert joined.path == paths[0]
    assert b"".join(data for _, data in wire_streams(joined)["udp"]) == stream.bytes
    assert joined.counts() == whole.counts()
    assert set(joined.lost().values()) == {0}
    assert (joined.start_ns, joined.end_ns) == (whole.start_ns, whole.end_ns)
    assert joined.metadata() == {"recording": {"part": "1"}}
    for name in NAMES:
        (one,), (other,) = joined.columns(name), whole.columns(name)
        assert (one.log_time == other.log_time).all()
        assert (one.sequence == other.sequence).all()
        assert one.fields.tobytes() == other.fields.tobytes()
    assert by_recording([paths[2], tmp_path / "whole.mcap", paths[0], paths[1]]) == [paths, [tmp_path / "whole.mcap"]]
    paths[1].write_bytes(b"")
    assert "a.part2.mcap is empty" in " ".join(Recording(paths).damage.notes)
    with pytest.raises(RecordingError, match="not of the same recording"):
        Recording([paths[0], other_recording(tmp_path / "b.mcap")])


def other_recording(path: Path) -> Path:
    with McapWriter(path, DIALECT) as writer:
        Stream().feed(writer, 10, "another link")
    return path


def test_an_error_that_nobody_thought_of_ends_the_file_not_the_thread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = Stream()
    writer = McapWriter(tmp_path / "a.mcap", DIALECT, chunk_seconds=0.05, reserve_bytes=1)
    stream.feed(writer, 50)
    writer.flush()
    kept = stream.bytes

    def fails(handle: int) -> None:
        raise MemoryError("no room for the answer")

    monkeypatch.setattr(os, "fstatvfs", fails)
    told: list[str] = []

    def go_on() -> None:  # more chunks than may wait, so that a writer without its thread would stand still
        for _ in range(20):
            try:
                stream.feed(writer, 10)
                writer.flush()
            except RecordingError as error:
                told.append(str(error))
        writer.close()

    thread = threading.Thread(target=go_on, daemon=True)
    thread.start()
    thread.join(30.0)
    assert not thread.is_alive()
    assert told == [f"{tmp_path / 'a.mcap'} cannot be written: MemoryError: no room for the answer"]
    assert writer.lost.bytes == writer.counts.bytes - len(kept)
    assert stream_of(tmp_path / "a.mcap") == kept
    assert not Recording(tmp_path / "a.mcap").damage


def test_what_an_earlier_recording_left_is_never_written_over(tmp_path: Path) -> None:
    earlier = tmp_path / "a.part2.mcap"
    earlier.write_bytes(b"precious")
    options = StorageOptions(split_bytes=2000)
    with pytest.raises(RecordingError, match=r"a\.part2\.mcap is a part of an earlier recording"):
        RecordingParts(tmp_path / "a.mcap", DIALECT, options, Provenance(), START)
    stream, reserved = Stream(), tmp_path / "b.mcap"
    reserved.touch()
    parts = RecordingParts(reserved, DIALECT, options, Provenance(), START)
    later = tmp_path / "b.part2.mcap"
    later.write_bytes(b"came meanwhile")

    def fill() -> None:
        while True:
            stream.time += SECOND // 10
            parts.write("udp", *stream.framer.feed(stream.sender.send("ATTITUDE").frame), stream.time)

    with pytest.raises(RecordingError, match=r"b\.part2\.mcap exists already"):
        fill()
    parts.close({})
    assert (earlier.read_bytes(), later.read_bytes()) == (b"precious", b"came meanwhile")
    assert not Recording(reserved).damage


def test_a_clock_set_back_holds_no_chunk_and_begins_a_part_of_its_own(tmp_path: Path) -> None:
    stream = Stream()
    parts = RecordingParts(tmp_path / "a.mcap", DIALECT, StorageOptions(), Provenance(), START)

    def feed(at_ns: int) -> None:
        frame = stream.sender.send("ATTITUDE").frame
        stream.frames.append(frame)
        parts.write("udp", *stream.framer.feed(frame), at_ns)

    feed(START)
    parts.clock_set_back(START - 3600 * SECOND)
    feed(START - 3600 * SECOND)
    feed(START - 3600 * SECOND + 5)
    # By the time of day, which goes back once more, this chunk would be open for another hour.
    back = START - 7200 * SECOND
    wait_until(lambda: parts.tick(back) or messages_on_disk(parts.parts[1]) == 2)
    parts.close({})
    first, second = map(Recording, parts.parts)
    assert (first.start_ns, second.start_ns) == (START, START - 3600 * SECOND)
    assert second.columns("ATTITUDE")[0].log_time.tolist() == [START - 3600 * SECOND, START - 3600 * SECOND + 5]
    assert second.metadata()["recording"]["begun_by"] == "clock set back"
    assert b"".join(map(stream_of, parts.parts)) == stream.bytes
