"""Every message of the dialect, recorded by us, opens with equal values in the MCAP readers of others."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mavlink_frames import Sender, Sent, message_names
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from node_reader import NodeReader
from rerun_messages import rerun_messages
from rosbags.highlevel import AnyReader

from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Framer
from gcs.recording.reader import Recording
from gcs.recording.wire import WIRE_TOPIC
from gcs.recording.writer import McapWriter

DIALECT = Dialect.load()
START = 1_760_000_000_000_000_000


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Sent]]:
    """All messages in MAVLink 2, and those with an id below 256 in MAVLink 1 as well."""
    path = tmp_path_factory.mktemp("interop") / "all.mcap"
    new, old = Sender(seed=21), Sender(system=2, seed=22, version=1)
    sent = [new.send(name) for name in message_names()]
    sent += [old.send(name) for name in message_names() if DIALECT.by_name[name].id < 256]
    framer = Framer(DIALECT)
    with McapWriter(path, DIALECT) as writer:
        for i, message in enumerate(sent):
            writer.write("udp", *framer.feed(message.frame, final=True), START + i * 5_000_000)
    return path, sent


def assert_equal(message: Sent, decoded: object) -> None:
    for field, expected in message.values.items():
        value = getattr(decoded, field)
        if isinstance(expected, str):
            assert bytes(value).split(b"\0")[0].decode() == expected
        else:
            given = np.frombuffer(value, np.uint8) if isinstance(value, bytes) else np.asarray(value)
            exact = np.asarray(expected, DIALECT.by_name[message.name].layout.dtype[field].base)
            assert np.array_equal(given, exact), (message.name, field)


def test_mcap_with_ros2_support(recorded: tuple[Path, list[Sent]]) -> None:
    path, sent = recorded
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        decoded = [entry for entry in reader.iter_decoded_messages() if entry.channel.topic != WIRE_TOPIC]
    assert len(decoded) == len(sent)
    for message, entry in zip(sent, decoded, strict=True):
        assert entry.channel.topic.endswith(f"/{message.name}")
        assert_equal(message, entry.decoded_message)


def test_rosbags(recorded: tuple[Path, list[Sent]]) -> None:
    path, sent = recorded
    with AnyReader([path]) as reader:
        decoded = [
            (connection.topic, time, reader.deserialize(data, connection.msgtype))
            for connection, time, data in reader.messages()
            if connection.topic != WIRE_TOPIC
        ]
    assert len(decoded) == len(sent)
    for i, (message, (topic, time, values)) in enumerate(zip(sent, decoded, strict=True)):
        assert topic.endswith(f"/{message.name}")
        assert time == START + i * 5_000_000
        assert_equal(message, values)


def test_rerun(recorded: tuple[Path, list[Sent]]) -> None:
    path, sent = recorded
    rows = {(topic, at): fields for topic, found in rerun_messages(path).items() for at, fields in found}
    assert len(rows) == len(sent)
    for i, message in enumerate(sent):
        system = 1 if message.frame[0] == 0xFD else 2
        (topic,) = (topic for topic, at in rows if at == START + i * 5_000_000)
        assert topic.startswith(f"/mavlink/{system}/")
        assert topic.endswith(f"/{message.name}")
        assert_equal(message, SimpleNamespace(**rows[topic, START + i * 5_000_000]))


def test_the_libraries_of_the_viewers(recorded: tuple[Path, list[Sent]], node: NodeReader) -> None:
    path, sent = recorded
    decoded = [entry for entry in node.read(path) if entry["topic"] != WIRE_TOPIC]
    assert len(decoded) == len(sent)
    for i, (message, entry) in enumerate(zip(sent, decoded, strict=True)):
        assert entry["topic"].endswith(f"/{message.name}")
        assert int(entry["logTime"]) == START + i * 5_000_000
        whole = {field: numbers(value) for field, value in entry["fields"].items()}
        assert_equal(message, SimpleNamespace(**whole))


def numbers(value: Any) -> Any:
    """64-bit integers come as text, which no float could hold."""
    if isinstance(value, list):
        return [numbers(item) for item in value]
    return int(value) if isinstance(value, str) else value


def test_our_own_reader(recorded: tuple[Path, list[Sent]]) -> None:
    path, sent = recorded
    recording = Recording(path)
    for message in sent:
        system = 1 if message.frame[0] == 0xFD else 2
        (columns,) = recording.columns(message.name, system=system)
        assert_equal(message, SimpleNamespace(**{field: columns[field][0] for field in columns.fields.dtype.names}))


def test_the_wire_topic_opens_too(recorded: tuple[Path, list[Sent]]) -> None:
    path, sent = recorded
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        wire = [entry.decoded_message for entry in reader.iter_decoded_messages(topics=[WIRE_TOPIC])]
    assert sum(len(message.form) for message in wire) == len(sent)
    with AnyReader([path]) as bag:
        chosen = [c for c in bag.connections if c.topic == WIRE_TOPIC]
        others = [bag.deserialize(data, c.msgtype) for c, _, data in bag.messages(chosen)]
    assert [bytes(message.form) for message in others] == [bytes(message.form) for message in wire]
