"""Writing and reading recordings, against the libraries that others use. Run: python benchmarks/recording.py"""

from __future__ import annotations

import io
import struct
import tempfile
from pathlib import Path

import foxglove
import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer as RosWriter
from pymavlink import mavutil
from rerun.chunk import McapReader
from telemetry import compare, telemetry

from gcs.formats.tlog import import_tlog
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import scan
from gcs.recording.reader import Recording
from gcs.recording.wire import WIRE_TOPIC
from gcs.recording.writer import McapWriter

SECONDS = 60.0
COPIES = 20


def bodies(dialect: Dialect, frames: list[tuple[int, bytes]]) -> list[tuple[str, int, bytes]]:
    """(message, time, CDR message) ready for mcap-python."""
    ready = []
    for time, frame in frames:
        message = dialect.by_id[int.from_bytes(frame[7:10], "little")]
        payload = frame[10 : 10 + frame[1]].ljust(message.layout.wire_size, b"\0")
        body = bytearray(message.layout.cdr_size)
        for wire, cdr, length in message.layout.runs:
            body[cdr : cdr + length] = payload[wire : wire + length]
        ready.append((message.name, time, b"\0\1\0\0" + bytes(body)))
    return ready


def write_peer(dialect: Dialect, ready: list[tuple[str, int, bytes]]) -> None:
    """mcap-python, from ready CDR bytes."""
    writer = Writer(io.BytesIO(), compression=CompressionType.ZSTD)
    writer.start("ros2")
    channels: dict[str, int] = {}
    for name, time, data in ready:
        if name not in channels:
            message = dialect.by_name[name]
            schema = writer.register_schema(message.schema_name, "ros2msg", message.layout.ros2msg.encode())
            channels[name] = writer.register_channel(f"/mavlink/1/1/{name}", "cdr", schema)
        writer.add_message(channels[name], time, data, time)
    writer.finish()


def write_foxglove(dialect: Dialect, ready: list[tuple[str, int, bytes]], path: Path) -> None:
    """foxglove-sdk, whose core is in Rust, from ready CDR bytes; its own defaults (zstd, indexes, all cores)."""
    context = foxglove.Context()
    with foxglove.open_mcap(path, allow_overwrite=True, context=context):
        channels: dict[str, foxglove.Channel] = {}
        for name, time, data in ready:
            channel = channels.get(name)
            if channel is None:
                message = dialect.by_name[name]
                schema = foxglove.Schema(
                    name=message.schema_name, encoding="ros2msg", data=message.layout.ros2msg.encode()
                )
                channel = channels[name] = foxglove.Channel(
                    f"/mavlink/1/1/{name}", schema=schema, message_encoding="cdr", context=context
                )
            channel.log(data, log_time=time)


def read_rerun(path: Path) -> int:
    """rerun's reader, in Rust: Arrow columns of every message; how many there are."""
    reader = McapReader(path, decoders=["ros2_reflection"], exclude_topic_regex=[WIRE_TOPIC])
    return sum(chunk.to_record_batch().num_rows for chunk in reader.stream())


def import_peer(dialect: Dialect, path: Path, out: Path) -> None:
    """pymavlink reading and mcap-ros2 writing, message by message."""
    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    with open(out, "wb") as file:
        writer = RosWriter(file)
        schemas: dict[str, object] = {}
        while (message := log.recv_match()) is not None:
            kind = dialect.by_id[message.get_msgId()]
            if kind.name not in schemas:
                schemas[kind.name] = writer.register_msgdef(kind.schema_name, kind.layout.ros2msg)
            fields = {name.lower(): getattr(message, name) for name in message.get_fieldnames()}
            values = {}
            for field in kind.layout.fields:
                value = fields[field.name]
                values[field.name] = value.encode().ljust(field.count, b"\0") if isinstance(value, str) else value
            time = int(message._timestamp * 1e9)
            writer.write_message(f"/mavlink/1/1/{kind.name}", schemas[kind.name], values, time, time)
        writer.finish()
    log.close()


def check(count: int, expected: int) -> None:
    """A reader that gives fewer messages than there are would win any comparison."""
    assert count == expected, (count, expected)


def main() -> None:
    """Print the ratios."""
    dialect = Dialect.load()
    frames = telemetry(SECONDS)
    ready = bodies(dialect, frames)
    data = np.frombuffer(b"".join(frame for _, frame in frames) * COPIES, np.uint8)
    period = round(SECONDS * 1e9)
    times = np.concatenate([np.array([time for time, _ in frames]) + copy * period for copy in range(COPIES)])
    found = scan(data, dialect)
    names = sorted({name for name, _, _ in ready})
    with tempfile.TemporaryDirectory() as folder:
        path, log, small = (Path(folder) / name for name in ("large.mcap", "small.tlog", "small.mcap"))
        log.write_bytes(b"".join(struct.pack(">Q", time // 1000) + frame for time, frame in frames))
        hour = Path(folder) / "hour.tlog"
        with open(hour, "wb") as file:
            for copy in range(60):
                late = copy * period // 1000
                file.write(b"".join(struct.pack(">Q", time // 1000 + late) + frame for time, frame in frames))

        def write_own() -> None:
            with McapWriter(path, dialect, chunk_seconds=4.0) as writer:
                writer.write("udp", data, found, times)

        def read_own() -> None:
            recording = Recording(path)
            assert sum(len(recording.columns(name)[0]) for name in names) == len(found)

        def read_peer() -> None:
            with open(small, "rb") as file:
                reader = make_reader(file, decoder_factories=[DecoderFactory()])
                topics = [topic for topic in Recording(small).topics() if topic != WIRE_TOPIC]
                assert sum(1 for _ in reader.iter_decoded_messages(topics=topics)) == len(frames)

        one, many = float(len(frames)), float(len(found))
        compare(
            "writing, zstd, indexed",
            "messages",
            {"mcap-python add_message": one, "foxglove-sdk Channel.log": 4 * one, "McapWriter": many},
            {
                "mcap-python add_message": lambda: write_peer(dialect, ready),
                "foxglove-sdk Channel.log": lambda: write_foxglove(dialect, 4 * ready, Path(folder) / "peer.mcap"),
                "McapWriter": write_own,
            },
        )
        compare(
            ".tlog to recording",
            "messages",
            {"pymavlink + mcap-ros2": one, "import_tlog, one hour": 60 * one},
            {
                "pymavlink + mcap-ros2": lambda: import_peer(dialect, log, Path(folder) / "peer.mcap"),
                "import_tlog, one hour": lambda: import_tlog(hour, Path(folder) / "hour.mcap", dialect),
            },
            rounds=5,
        )
        import_tlog(log, small, dialect)
        compare(
            "file to numpy columns",
            "messages",
            {"mcap-python + mcap-ros2-support": one, "rerun McapReader": many, "Recording.columns": many},
            {
                "mcap-python + mcap-ros2-support": read_peer,
                "rerun McapReader": lambda: check(read_rerun(path), len(found)),
                "Recording.columns": read_own,
            },
            rounds=5,
        )


if __name__ == "__main__":
    main()
