"""What a crash, a cut or a flipped bit may cost a recording: one trial each, judged by what was sent and written."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mavlink_frames import Sender
from mcap.reader import make_reader
from processes import free_port
from traffic import wait_until
from wire_streams import wire_streams

from gcs.catalogue.intake import recover
from gcs.catalogue.store import Catalogue
from gcs.errors import RecordingError
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Framer
from gcs.recording.joined import by_recording
from gcs.recording.reader import Recording
from gcs.recording.writer import McapWriter
from gcs.settings import Settings

GCS = (sys.executable, "-m", "gcs")
SENDER = Path(__file__).with_name("numbered_sender.py")
RATES = (50, 400, 2000, 4000)
FSYNC = ("never", "chunk", "0.2")
LONGEST_S = 4.0
ALLOWED_S = 1.0
START_NS = 1_760_000_000_000_000_000
STEP_NS = 10_000_000
NAMES = ("ATTITUDE", "HIGHRES_IMU", "GPS_RAW_INT", "STATUSTEXT", "SERVO_OUTPUT_RAW")


@dataclass(frozen=True)
class Killed:
    """One kill: what it was, seconds missing at the end, messages kept, and what is wrong ("" if nothing)."""

    seed: int
    command: str
    rate: int
    fsync: str
    after_s: float
    missing_s: float
    messages: int
    parts: int
    wrong: str

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


class Fresh:
    """A command in a new interpreter, as a user starts it."""

    def __init__(self, arguments: list[object]) -> None:
        program, *rest = arguments
        self._process = subprocess.Popen(
            [sys.executable, *map(str, rest)] if program == "sender" else [*GCS, *map(str, rest)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def first_line(self) -> str:
        """What it says first."""
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def alive(self) -> bool:
        return self._process.poll() is None

    def kill(self) -> None:
        """SIGKILL, and wait until it is gone."""
        self._process.kill()
        self._process.communicate()


def kill_trial(
    seed: int,
    folder: Path,
    allowed_s: float = ALLOWED_S,
    begin: Callable[[list[object]], Fresh] = Fresh,
    keeping_up: bool = False,
) -> Killed:
    """Start a station under load, kill it at a random moment, and look at what it leaves. begin: how to start both.

    keeping_up: kill it only when the file holds what came at most half of `allowed_s` ago, so that a machine that is
    too busy to run the station does not count against it; one that never gets so far fails.
    """
    chance = random.Random(seed)
    command = ("record", "serve")[seed % 2]
    rate, fsync, after_s = chance.choice(RATES), chance.choice(FSYNC), chance.uniform(0.1, LONGEST_S)
    port, data = free_port(), folder / "data"
    options: list[object] = ["--connect", f"udpin:127.0.0.1:{port}", "--fsync", fsync, "--split-size", "1MB"]
    output = data / "flights" / "flight.mcap"
    if command == "record":
        output.parent.mkdir(parents=True)
        options += ["-o", output]
    else:
        options += ["--data", data, "--port", "0"]
    running = [begin(["gcs", command, *options])]
    try:
        station = running[0]
        if command == "serve":
            assert station.first_line().startswith("serving on ")
        else:
            wait_until(lambda: output.exists() or not station.alive())
        running.append(begin(["sender", SENDER, port, rate]))
        running[1].first_line()
        sending_us = time.time_ns() // 1000
        wait_until(lambda: list(data.glob("flights/*.mcap")) or not station.alive())
        time.sleep(after_s)
        if keeping_up:
            wait_until(lambda: _newest_age_s(data) < allowed_s / 2 or not station.alive())
        assert station.alive(), "the station ended by itself"
        killed_us = time.time_ns() // 1000
    finally:
        for process in running:
            process.kill()
    missing_s, messages, parts, wrong = judge_kill(data, sending_us, killed_us, allowed_s)
    return Killed(seed, command, rate, fsync, after_s, missing_s, messages, parts, wrong)


def judge_kill(data: Path, sending_us: int, killed_us: int, allowed_s: float) -> tuple[float, int, int, str]:
    """Seconds missing, messages, parts, and what is wrong, of the files left behind; as they are, and completed."""
    paths = sorted((data / "flights").glob("*.mcap"))
    (parts,) = by_recording(paths)
    found = _numbers(parts)
    settings = Settings(data=data)
    with closing(Catalogue(settings.database)) as catalogue:
        (flight,) = recover(settings, catalogue)
    completed = _numbers(parts)
    if completed != found:
        return 0.0, len(found), len(parts), "completing the files changed their messages"
    if not found:
        early = "cut off before its first message" in flight.end_reason and killed_us - sending_us < allowed_s * 1e6
        return 0.0, 0, len(parts), "" if early else f"nothing could be read: {flight.end_reason}"
    numbers = [number for number, _, _ in found]
    if numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        return 0.0, len(found), len(parts), "messages are missing in the middle, doubled or out of order"
    if numbers[0] != 0:
        return 0.0, len(found), len(parts), f"the first {numbers[0]} messages are missing"
    if any(Recording(path).damage.truncated for path in parts):
        return 0.0, len(found), len(parts), "a file was not completed"
    missing_s = (killed_us - found[-1][1] / 1000) / 1e6
    wrong = "" if missing_s <= allowed_s else f"the last {missing_s:.2f} s are missing"
    return missing_s, len(found), len(parts), wrong


def _newest_age_s(data: Path) -> float:
    """How long ago the newest message came that is in the files."""
    found = _numbers(sorted((data / "flights").glob("*.mcap")))
    return (time.time_ns() - found[-1][1]) / 1e9 if found else float("inf")


def _numbers(paths: list[Path]) -> list[tuple[int, int, int]]:
    """(number, time of reception in ns, time of sending in us) of every PING, in the order of the files."""
    try:
        columns = Recording(paths).columns("PING")
    except RecordingError:
        return []
    found = [(one["seq"].tolist(), one.log_time.tolist(), one["time_usec"].tolist()) for one in columns]
    return [row for entry in found for row in zip(*entry, strict=True)]


class Undamaged:
    """A recording with many chunks, and what of it the mcap package says is where."""

    def __init__(self, path: Path, messages: int = 3000) -> None:
        dialect = Dialect.load()
        framer, sender = Framer(dialect), Sender(seed=3)
        with McapWriter(path, dialect, chunk_seconds=0.3) as writer:
            writer.metadata("recording", {"flight": "x"})
            writer.attach("vehicle.toml", "application/toml", b"mass = 1\n" * 50)
            for i in range(messages):
                frame = sender.send(NAMES[i % len(NAMES)]).frame
                writer.write("udp", *framer.feed(frame), START_NS + i * STEP_NS)
        self.bytes = path.read_bytes()
        with open(path, "rb") as file:
            reader = make_reader(file, validate_crcs=True)
            summary = reader.get_summary()
            assert summary is not None
            self.chunks = sorted(
                (index.chunk_start_offset, index.chunk_length, index.message_start_time, index.message_end_time)
                for index in summary.chunk_indexes
            )
            self.messages: dict[tuple[str, int], tuple[int, bytes]] = {
                (channel.topic, message.log_time): (message.sequence, message.data[4:])
                for _, channel, message in reader.iter_messages()
                if channel.topic != "/mavlink/wire"
            }
        assert len(self.messages) == messages

    @property
    def unfinished(self) -> bytes:
        """The file as it was before its end was written: the data, without DATA_END, summary and footer."""
        footer = self.bytes[-8 - 20 :]
        summary = int.from_bytes(footer[:8], "little")
        return self.bytes[: summary - 13]

    def expected_after_cut(self, size: int) -> set[tuple[str, int]]:
        """Messages of the chunks that are whole in the first `size` bytes."""
        ends = [end for offset, length, _, end in self.chunks if offset + length <= size]
        return {key for key in self.messages if ends and key[1] <= ends[-1]}

    def expected_after_damage(self, place: int, size: int = 1) -> set[tuple[str, int]]:
        """Messages of all chunks but those that the damaged bytes are in."""
        hit = [chunk for chunk in self.chunks if chunk[0] < place + size and place < chunk[0] + chunk[1]]
        return {key for key in self.messages if not any(start <= key[1] <= end for _, _, start, end in hit)}


def read_all(path: Path) -> dict[tuple[str, int], tuple[int, bytes]]:
    """Everything a recording tells, its messages as (topic, log time) -> (sequence, fields)."""
    recording = Recording(path)
    recording.metadata(), recording.attachments(), recording.lost(), recording.counts(), recording.damage
    for pieces in wire_streams(recording).values():
        for _ in pieces:
            pass
    return {
        (f"/mavlink/{one.system}/{one.component}/{one.name}", time): (sequence, one.fields[i].tobytes())
        for name in recording.messages()
        for one in recording.columns(name)
        for i, (time, sequence) in enumerate(zip(one.log_time.tolist(), one.sequence.tolist(), strict=True))
    }


def damage_trial(
    whole: Undamaged, damaged: bytes, expected: set[tuple[str, int]], path: Path, repaired: Callable[[Path], object]
) -> str:
    """What is wrong with how a damaged file reads, "" if nothing.

    repaired: called with the path afterwards; it must neither raise nor take a message away.
    """
    path.write_bytes(damaged)
    try:
        found = read_all(path)
    except RecordingError as error:
        if "\n" in str(error):
            return f"an error of several lines: {error}"
        if expected:
            return f"refused though it holds {len(expected)} messages: {error}"
        repaired(path)
        return "" if path.read_bytes() == damaged else "nothing could be read, and completing it changed it"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    if not expected <= found.keys():
        return f"{len(expected - found.keys())} whole messages are not read"
    wrong = [key for key, value in found.items() if whole.messages.get(key) != value]
    if wrong:
        return f"{len(wrong)} messages are not as they were written, first {wrong[0]}"
    try:
        repaired(path)
        after = read_all(path)
    except Exception as error:
        return f"completing it: {type(error).__name__}: {error}"
    if after != found:
        return f"completing it left {len(after)} of {len(found)} messages"
    return ""


def flipped(data: bytes, place: int, bit: int) -> bytes:
    """The data with one bit turned over."""
    changed = bytearray(data)
    changed[place] ^= 1 << bit
    return bytes(changed)


def zeroed(data: bytes, place: int, size: int) -> bytes:
    """The data with a block of zeros in it, as a power cut leaves them."""
    return data[:place] + bytes(len(data[place : place + size])) + data[place + size :]
