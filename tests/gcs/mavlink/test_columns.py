"""Columns of frames hold what pymavlink put into the messages."""

from __future__ import annotations

import numpy as np
import pytest
from mavlink_frames import Sender, Sent, message_names

from gcs.mavlink.columns import message_columns
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import scan

DIALECT = Dialect.load()


def _everything(version: int) -> list[Sent]:
    """Each message of the dialect three times, in an order that mixes them."""
    sender = Sender(system=3, component=4, seed=version, version=version)
    names = [name for name in message_names() if version == 2 or DIALECT.by_name[name].id < 256]
    return [sender.send(name) for _ in range(3) for name in names]


@pytest.mark.parametrize("version", [1, 2])
def test_every_field_of_every_message_has_its_value(version: int) -> None:
    sent = _everything(version)
    data = b"\xfd\x00".join(message.frame for message in sent)
    frames = scan(np.frombuffer(data, np.uint8), DIALECT, final=True)
    assert len(frames) == len(sent)
    columns = message_columns(frames, DIALECT)
    assert sum(len(entry) for entry in columns.values()) == len(sent)
    for name, entry in columns.items():
        kind = DIALECT.by_name[name]
        for row, place in zip(entry.fields, entry.index.tolist(), strict=True):
            message = sent[place]
            assert message.name == name
            for field in kind.layout.fields:
                if version == 1 and field.wire_offset >= kind.base_length:
                    continue  # MAVLink 1 does not send extension fields
                value = row[field.name]
                given = message.values[field.name]
                if isinstance(given, str):
                    assert bytes(value).rstrip(b"\0").decode() == given, (name, field.name)
                else:
                    assert np.array_equal(value, np.array(given, value.dtype)), (name, field.name)


def test_frames_of_unknown_id_are_in_no_column() -> None:
    small = Dialect.load("minimal")
    sender = Sender(seed=4)
    data = b"".join(sender.send(name).frame for name in ("HEARTBEAT", "ATTITUDE", "HEARTBEAT"))
    columns = message_columns(scan(np.frombuffer(data, np.uint8), small, final=True), small)
    assert list(columns) == ["HEARTBEAT"]
    assert columns["HEARTBEAT"].index.tolist() == [0, 2]


def test_no_frames_give_no_columns() -> None:
    assert message_columns(scan(np.empty(0, np.uint8), DIALECT), DIALECT) == {}
