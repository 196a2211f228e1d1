"""Recordings that were cut off, made whole again: every whole chunk, readable by others, nothing else touched."""

from contextlib import closing
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.records import Channel, Header, Message, Schema
from recorded_stream import DIALECT, NAMES, Stream, stream_of

from gcs.catalogue.flight_table import Flight
from gcs.catalogue.intake import recover
from gcs.catalogue.store import Catalogue
from gcs.cli import main
from gcs.errors import RecordingError
from gcs.recording import records
from gcs.recording.reader import Recording
from gcs.recording.repair import complete, repair
from gcs.recording.writer import McapWriter
from gcs.settings import Settings


def cut_recording(path: Path, keep: float, messages: int = 300) -> Stream:
    """A recording of chunks of 0.1 s of which only the beginning is left."""
    stream = Stream()
    with McapWriter(path, DIALECT, chunk_seconds=0.1) as writer:
        writer.metadata("recording", {"flight": path.stem})
        writer.attach("vehicle.toml", "application/toml", b"mass = 1\n")
        stream.feed(writer, messages)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(keep * len(whole))])
    return stream


def other_readers_messages(path: Path) -> int:
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        count = sum(1 for _ in reader.iter_messages())
        assert summary.statistics.message_count == count
        assert summary.chunk_indexes
    return count


@pytest.mark.parametrize("keep", [0.2, 0.5, 0.731])
def test_a_cut_file_is_completed_with_all_that_was_whole_in_it(keep: float, tmp_path: Path) -> None:
    path, new = tmp_path / "a.mcap", tmp_path / "b.mcap"
    stream = cut_recording(path, keep)
    before, cut = Recording(path), path.read_bytes()
    assert before.damage.truncated
    repair([path], new)
    after = Recording(new)
    assert not after.damage
    assert not after.damage.truncated
    assert after.counts() == before.counts()
    assert after.metadata() == {"recording": {"flight": "a"}}
    assert [file.data for file in after.attachments()] == [b"mass = 1\n"]
    kept = stream_of(new)
    assert stream.bytes.startswith(kept)
    assert len(kept) > 0
    # The account of the link's bytes is a message too.
    assert other_readers_messages(new) > sum(before.counts().values())
    for name in NAMES:
        assert after.columns(name)[0].fields.tobytes() == before.columns(name)[0].fields.tobytes()
    assert complete(path) == ""
    assert path.read_bytes() == new.read_bytes() != cut
    assert [file.name for file in tmp_path.iterdir() if file.name not in ("a.mcap", "b.mcap")] == []


def test_a_file_that_cannot_be_completed_stays_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    cut_recording(path, 0.7)
    damaged = bytearray(path.read_bytes())
    damaged[len(damaged) // 2] ^= 0x10
    path.write_bytes(damaged)
    assert "damaged inside" in complete(path)
    assert path.read_bytes() == damaged
    nothing = tmp_path / "b.mcap"
    nothing.write_bytes(bytes(damaged[:20]))
    assert "left as it is" in complete(nothing)
    assert nothing.read_bytes() == damaged[:20]
    assert len(list(tmp_path.iterdir())) == 2


def unfinished_recording(path: Path) -> tuple[bytearray, list[int]]:
    """A recording without its end: its bytes, and where its chunks begin."""
    cut_recording(path, 1.0)
    with open(path, "rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunks = [index.chunk_start_offset for index in summary.chunk_indexes]
    data = bytearray(path.read_bytes())
    return data[: chunks[-1] + 40], chunks


@pytest.mark.parametrize("damage", ["length", "zeros", "private opcode"])
def test_damage_in_an_unfinished_file_costs_nothing_behind_it(damage: str, tmp_path: Path) -> None:
    path, new = tmp_path / "a.mcap", tmp_path / "b.mcap"
    data, chunks = unfinished_recording(path)
    at = chunks[len(chunks) // 2]
    if damage == "length":
        data[at + 30] ^= 0x40  # the uncompressed size
        data[at + 4] = 0x7F
    elif damage == "zeros":
        data[at - 20 : at + 50] = bytes(70)
    else:
        data[at] = 0x86
    path.write_bytes(data)
    recording = Recording(path)
    lost = 0 if damage == "private opcode" else 10
    assert sum(recording.counts().values()) == 10 * (len(chunks) - 1) - lost
    assert recording.damage.truncated
    assert bool(recording.damage.inside) == (lost > 0)
    if lost:
        assert "left as it is, damaged inside: " in complete(path)
        assert path.read_bytes() == data
        assert len(list(tmp_path.iterdir())) == 1
    repair([path], new)
    assert sum(Recording(new).counts().values()) == 10 * (len(chunks) - 1) - lost
    assert other_readers_messages(new) > 0


def test_a_file_with_a_damaged_attachment_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    data, _ = unfinished_recording(path)
    data[data.index(b"mass = 1")] ^= 1
    path.write_bytes(data)
    assert Recording(path).attachments() == ()
    assert "attachment" in complete(path)
    assert path.read_bytes() == data


def test_messages_of_channels_that_nothing_describes_are_no_index_and_no_crash(tmp_path: Path) -> None:
    path, new = tmp_path / "a.mcap", tmp_path / "b.mcap"
    content = records.packed(Schema(1, b"uint8 c\n", "ros2msg", "a/msg/B"))
    content += records.packed(Channel(1, "/b", "cdr", {}, 1))
    for channel in (1, 65535, 40000, 1):
        content += records.packed(Message(channel, 5, b"\0\1\0\0\7", 5, 0))
    chunk = records.chunk_record(5, 5, memoryview(content), "", content)
    path.write_bytes(records.MAGIC + records.packed(Header("ros2", "")) + chunk + b"\x06")
    damage = repair([path], new)
    assert damage.notes[-1] == "a.mcap: 2 messages are of channels that nothing in the file describes"
    with open(new, "rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.channel_message_counts == {1: 2}
    assert "channels that nothing in the file describes" in complete(path)


def test_a_whole_file_is_not_touched(tmp_path: Path) -> None:
    cut_recording(tmp_path / "a.mcap", 1.0)
    before = (tmp_path / "a.mcap").stat()
    assert complete(tmp_path / "a.mcap") == ""
    assert (tmp_path / "a.mcap").stat().st_mtime_ns == before.st_mtime_ns


def test_the_service_completes_what_the_last_run_left(tmp_path: Path) -> None:
    settings = Settings(data=tmp_path)
    settings.flights.mkdir()
    cut_recording(settings.flights / "cut.mcap", 0.6)
    with McapWriter(settings.flights / "split.mcap", DIALECT) as writer:
        stream = Stream()
        stream.feed(writer, 50)
        writer.roll(settings.flights / "split.part2.mcap")
        stream.feed(writer, 30)
    last = settings.flights / "split.part2.mcap"
    last.write_bytes(last.read_bytes()[:-500])
    (settings.flights / "none.mcap").write_bytes(b"\x89MCAP0\r\n")
    (settings.flights / "cut.mcap.unfinished").write_bytes(b"left by an attempt that was killed")
    with closing(Catalogue(settings.database)) as catalogue:
        for name in ("cut", "gone"):
            catalogue.put_flight(Flight(name, f"{name}.mcap", name, "live", "recording", 1, 1, 2, 0, 0))
        recovered = {flight.id: flight for flight in recover(settings, catalogue)}
        assert set(recovered) == {"cut", "none", "split"}
        assert recovered["cut"].end_reason == "the service stopped before its end"
        assert recovered["cut"].messages > 0
        assert (recovered["split"].parts, recovered["split"].messages) == (2, 80)
        assert "cut off before its first message" in recovered["none"].end_reason
        assert "gone" in catalogue.flight("gone").end_reason
        assert recover(settings, catalogue) == []
    assert not Recording(settings.flights / "cut.mcap").damage.truncated
    assert not Recording(last).damage.truncated
    assert sorted(path.suffix for path in settings.flights.iterdir()) == [".mcap"] * 4


def test_recover_joins_parts_and_tells_what_it_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = [tmp_path / "a.mcap", tmp_path / "a.part2.mcap"]
    stream = Stream()
    with McapWriter(paths[0], DIALECT, chunk_seconds=0.1) as writer:
        stream.feed(writer, 100)
        writer.roll(paths[1])
        stream.feed(writer, 100)
    whole = tmp_path / "whole.mcap"
    assert main(["recover", *map(str, paths), "-o", str(whole)]) == 0
    assert stream_of(whole) == stream.bytes
    assert other_readers_messages(whole) > 200
    assert capsys.readouterr().err == ""
    assert main(["recover", str(paths[0]), "-o", str(whole)]) == 2
    assert "exists already" in capsys.readouterr().err
    damaged = bytearray(paths[0].read_bytes())
    damaged[len(damaged) // 3] ^= 1
    paths[0].write_bytes(damaged)
    assert main(["recover", str(paths[0]), "-o", str(tmp_path / "rest.mcap")]) == 0
    assert "left out" in capsys.readouterr().err
    assert 80 <= sum(Recording(tmp_path / "rest.mcap").counts().values()) < 100


def test_import_completes_a_cut_recording(tmp_path: Path) -> None:
    cut_recording(tmp_path / "a.mcap", 0.5)
    assert main(["import", str(tmp_path / "a.mcap"), "-o", str(tmp_path / "b.mcap")]) == 0
    assert not Recording(tmp_path / "b.mcap").damage.truncated
    with pytest.raises(RecordingError, match="cannot be written"):
        repair([tmp_path / "a.mcap"], tmp_path / "nowhere" / "b.mcap")
