"""Dialect tables agree with the XML definitions, and the layouts with how pymavlink packs."""

from pathlib import Path

import numpy as np
import pymavlink
import pytest
from mavlink_frames import Sender, message_names
from pymavlink.generator import mavparse

from gcs.errors import DialectError, RecordingError
from gcs.mavlink.cdr import layout, parse_ros2msg
from gcs.mavlink.dialect import Dialect

DIALECT = Dialect.load()
XML_FOLDER = Path(pymavlink.__file__).parent / "dialects" / "v20"


@pytest.fixture(scope="module")
def definitions() -> dict[int, object]:
    """The messages of the dialect's XML and of all it includes, as pymavlink's parser reads them."""
    found: dict[int, object] = {}
    waiting, done = ["ardupilotmega.xml"], set()
    while waiting:
        name = waiting.pop()
        if name not in done:
            done.add(name)
            parsed = mavparse.MAVXML(str(XML_FOLDER / name), mavparse.PROTOCOL_2_0)
            found.update({message.id: message for message in parsed.message})
            waiting += parsed.include
    return found


def test_tables_equal_the_xml(definitions: dict[int, object], capsys: pytest.CaptureFixture[str]) -> None:
    assert set(DIALECT.by_id) == set(definitions)
    for identity, expected in definitions.items():
        message = DIALECT.by_id[identity]
        assert message.name == expected.name
        assert message.crc_extra == expected.crc_extra, message.name
        assert message.base_length == expected.wire_min_length, message.name
        assert message.layout.wire_size == expected.wire_length, message.name
        assert [f.name for f in message.layout.fields] == [f.name.lower() for f in expected.ordered_fields]
        assert [f.wire_offset for f in message.layout.fields] == [f.wire_offset for f in expected.ordered_fields]


def test_messages_that_need_padding() -> None:
    # Found independently by laying each message out from the XML and comparing with ROS 2 readers.
    runs = {message.name: len(message.layout.runs) for message in DIALECT.messages}
    assert len(runs) == 301
    assert sum(count == 1 for count in runs.values()) == 273
    assert sorted(name for name, count in runs.items() if count == 3) == [
        "BATTERY_STATUS",
        "GPS2_RAW",
        "MANUAL_CONTROL",
        "SMART_BATTERY_INFO",
    ]
    assert sum(count == 2 for count in runs.values()) == 24


def test_cdr_fields_are_aligned_and_do_not_overlap() -> None:
    for message in DIALECT.messages:
        end = 0
        for field in message.layout.fields:
            size = np.dtype(message.layout.dtype[field.name].base).itemsize
            assert field.cdr_offset % size == 0, (message.name, field.name)
            assert end <= field.cdr_offset < end + size
            end = field.cdr_offset + size * max(field.count, 1)
        assert end == message.layout.cdr_size


def test_schema_names_have_no_underscore_and_are_unique() -> None:
    names = [message.schema_name for message in DIALECT.messages]
    assert len(set(names)) == len(names)
    assert DIALECT.by_name["HIGHRES_IMU"].schema_name == "mavlink/msg/HighresImu"
    assert not any("_" in name for name in names)


def test_stamps() -> None:
    stamps = {name: (DIALECT.by_name[name].stamp, DIALECT.by_name[name].stamp_unit) for name in message_names()}
    assert stamps["HIGHRES_IMU"] == ("time_usec", "us")
    assert stamps["ATTITUDE"] == ("time_boot_ms", "ms")
    assert stamps["SYSTEM_TIME"] == ("time_boot_ms", "ms")
    assert stamps["VFR_HUD"] == ("", "")
    assert stamps["LOG_ENTRY"] == ("", "")


def test_definition_text_gives_the_same_layout() -> None:
    for message in DIALECT.messages:
        assert parse_ros2msg(message.layout.ros2msg) == message.layout


def test_other_definitions_are_refused() -> None:
    with pytest.raises(RecordingError, match="string name"):
        parse_ros2msg("string name\n")


def test_payload_copied_by_runs_decodes_to_what_was_sent() -> None:
    sender = Sender(seed=12)
    for name in message_names():
        sent = sender.send(name)
        placed = DIALECT.by_name[name].layout
        payload = sent.frame[10 : 10 + sent.frame[1]].ljust(placed.wire_size, b"\0")
        body = bytearray(placed.cdr_size)
        for wire, cdr, length in placed.runs:
            body[cdr : cdr + length] = payload[wire : wire + length]
        decoded = np.frombuffer(bytes(body), placed.dtype)[0]
        for field, value in sent.values.items():
            if isinstance(value, str):
                assert bytes(decoded[field]).rstrip(b"\0").decode() == value
            else:
                assert np.array_equal(decoded[field], np.asarray(value).astype(decoded[field].dtype)), (name, field)


def test_a_users_own_dialect(tmp_path: Path) -> None:
    xml = tmp_path / "mine.xml"
    xml.write_text(
        """<?xml version="1.0"?><mavlink><version>3</version><messages>
        <message id="180000" name="VANE_RAW"><description>x</description>
        <field type="uint64_t" name="time_usec" units="us">t</field>
        <field type="float" name="Angle">a</field><field type="uint8_t" name="state">s</field>
        <extensions/><field type="uint16_t" name="counts">c</field></message></messages></mavlink>"""
    )
    message = Dialect.load(str(xml)).by_name["VANE_RAW"]
    assert (message.id, message.base_length, message.layout.wire_size, message.layout.cdr_size) == (180000, 13, 15, 16)
    assert [field.name for field in message.layout.fields] == ["time_usec", "angle", "state", "counts"]
    assert message.stamp == "time_usec"


def test_unknown_dialects_are_named(tmp_path: Path) -> None:
    for name in ("nonsense", "../common"):
        with pytest.raises(DialectError, match="unknown MAVLink dialect"):
            Dialect.load(name)
    with pytest.raises(DialectError, match="no dialect file"):
        Dialect.load(str(tmp_path / "missing.xml"))
    broken = tmp_path / "broken.xml"
    broken.write_text("<mavlink><messages>")
    with pytest.raises(DialectError, match="cannot be used"):
        Dialect.load(str(broken))


def test_layout_pads_for_alignment() -> None:
    placed = layout([("a", "uint32", 0), ("b", "uint8", 3), ("c", "float64", 0)])
    assert [field.cdr_offset for field in placed.fields] == [0, 4, 8]
    assert placed.runs == ((0, 0, 7), (7, 8, 8))
    assert (placed.wire_size, placed.cdr_size) == (15, 16)
