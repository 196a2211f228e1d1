"""A flight recorded over UDP, opened by MCAP readers of others, against what pymavlink finds in the sender's log."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from node_reader import NodeReader
from processes import ANSWERS, free_port, recording_station, run
from pymavlink import mavutil
from rerun_messages import rerun_messages
from rosbags.highlevel import AnyReader

from gcs.recording.wire import WIRE_TOPIC

FLIGHT = ("fly", "--manoeuvre", "elevator-doublet", "--duration", 8, "--seed", 2, "--noise", "table2")
Messages = dict[str, list[dict[str, Any]]]


@dataclass(frozen=True)
class Flown:
    """The recording of another process, and per topic the fields of what was sent."""

    path: Path
    sent: Messages


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """The same flight as a log of the sender's own, and over a UDP socket into `gcs record`."""
    folder = tmp_path_factory.mktemp("flight")
    log, path = folder / "sent.tlog", folder / "received.mcap"
    done = run("sim-vehicle", *FLIGHT, "--record", log)
    assert done.returncode == 0, done.stderr
    sent: Messages = defaultdict(list)
    reader = mavutil.mavlink_connection(str(log))
    while (message := reader.recv_match()) is not None:
        topic = f"/mavlink/{message.get_srcSystem()}/{message.get_srcComponent()}/{message.get_type()}"
        fields = {name.lower(): getattr(message, name) for name in message.get_fieldnames()}
        if message.get_type() == "SYSTEM_TIME":
            del fields["time_unix_usec"]  # which tells when the simulation was started
        sent[topic].append(fields)
    reader.close()
    port = free_port()
    with recording_station(f"udpin:127.0.0.1:{port}", path, sum(map(len, sent.values()))):
        done = run("sim-vehicle", *FLIGHT, "--out", f"udpout:127.0.0.1:{port}", "--speed", 5)
        assert done.returncode == 0, done.stderr
    return Flown(path, dict(sent))


def value_of(given: Any) -> Any:
    """A field as a reader gives it: numbers, or a list of numbers."""
    if isinstance(given, str):
        return float(given) if given in ("NaN", "Infinity", "-Infinity") else int(given)
    if isinstance(given, bytes | np.ndarray | list | tuple):
        return [value_of(item) for item in given]
    return given.item() if isinstance(given, np.generic) else given


def assert_equal(found: Messages, sent: Messages) -> None:
    """Every message of every topic in its order, every field exactly; answers to the station's questions aside."""
    assert {topic for topic in found if not topic.endswith(ANSWERS)} == sent.keys()
    for topic, messages in sent.items():
        assert len(found[topic]) == len(messages), topic
        for given, wanted in zip(found[topic], messages, strict=True):
            for name, expected in wanted.items():
                value = value_of(given[name])
                if isinstance(expected, str):
                    value = bytes(value).split(b"\0")[0].decode()
                same = value == expected or (value != value and isinstance(expected, float) and math.isnan(expected))
                assert same, (topic, name, value, expected)


def fields_of(message: Any) -> dict[str, Any]:
    names = getattr(message, "__slots__", None) or vars(message)
    return {name.lstrip("_"): getattr(message, name) for name in names}


def test_the_libraries_of_the_viewers(flown: Flown, node: NodeReader) -> None:
    found: Messages = defaultdict(list)
    counters: list[int] = []
    last = 0
    for entry in node.read(flown.path):
        assert int(entry["logTime"]) >= last
        last = int(entry["logTime"])
        if entry["topic"] != WIRE_TOPIC:
            found[entry["topic"]].append(entry["fields"])
            counters.append(entry["sequence"])
            stamp = entry["fields"].get("time_usec")
            if stamp is not None:
                assert int(entry["publishTime"]) == int(stamp) * 1000
    assert_equal(found, flown.sent)
    assert np.all(np.diff(counters) == 1)  # nothing is missing and nothing there twice


def test_mcap_with_ros2_support(flown: Flown) -> None:
    found: Messages = defaultdict(list)
    counters = []
    with open(flown.path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for entry in reader.iter_decoded_messages():
            if entry.channel.topic != WIRE_TOPIC:
                found[entry.channel.topic].append(fields_of(entry.decoded_message))
                counters.append(entry.message.sequence)
    assert_equal(found, flown.sent)
    assert np.all(np.diff(counters) == 1)  # nothing is missing and nothing there twice


def test_rosbags(flown: Flown) -> None:
    found: Messages = defaultdict(list)
    with AnyReader([flown.path]) as reader:
        for connection, _, data in reader.messages():
            if connection.topic != WIRE_TOPIC:
                found[connection.topic].append(fields_of(reader.deserialize(data, connection.msgtype)))
    assert_equal(found, flown.sent)


def test_rerun(flown: Flown) -> None:
    """Rerun's own reader, on the whole file and on one that was cut off."""
    cut = flown.path.with_name("cut.mcap")
    content = flown.path.read_bytes()
    cut.write_bytes(content[: len(content) * 2 // 3])
    whole = {topic: [fields for _, fields in rows] for topic, rows in rerun_messages(flown.path).items()}
    assert_equal(whole, flown.sent)
    recovered = rerun_messages(cut, recover=True)
    assert sum(map(len, recovered.values())) > sum(map(len, whole.values())) / 3
    for topic, rows in recovered.items():
        assert [fields for _, fields in rows] == whole[topic][: len(rows)]
