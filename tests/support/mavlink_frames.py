"""MAVLink frames made by pymavlink, with random but reproducible field values."""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

INTEGER_RANGE = {
    "int8_t": (-(2**7), 2**7 - 1),
    "uint8_t": (0, 2**8 - 1),
    "int16_t": (-(2**15), 2**15 - 1),
    "uint16_t": (0, 2**16 - 1),
    "int32_t": (-(2**31), 2**31 - 1),
    "uint32_t": (0, 2**32 - 1),
    "int64_t": (-(2**63), 2**63 - 1),
    "uint64_t": (0, 2**63 - 1),
}


@dataclass(frozen=True)
class Sent:
    """One frame and what went into it: field (lower case) -> value, char arrays as text."""

    name: str
    sequence: int
    frame: bytes
    values: dict[str, Any]


class Sender:
    """One component that sends."""

    def __init__(self, system: int = 1, component: int = 1, seed: int = 0, version: int = 2) -> None:
        self.random = random.Random(seed)
        self.mavlink = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.version = version

    def _value(self, kind: str, count: int) -> Any:
        if kind == "char":
            return "".join(self.random.choices("abcXYZ_09 ", k=self.random.randint(0, count)))
        if count:
            return [self._value(kind, 0) for _ in range(count)]
        if kind in ("float", "double"):
            return float(self.random.randint(-(2**20), 2**20)) / 64.0
        low, high = INTEGER_RANGE[kind]
        return self.random.choice((0, 1, low, high, self.random.randint(low, high)))

    def send(self, name: str, **given: Any) -> Sent:
        """A message of random values, but for those given."""
        kind = next(m for m in mavlink.mavlink_map.values() if m.msgname == name)
        values = {}
        for field, field_type in zip(kind.fieldnames, kind.fieldtypes, strict=True):
            count = kind.array_lengths[kind.ordered_fieldnames.index(field)]
            values[field] = given.get(field, self._value(field_type, count))
        arguments = {field: value.encode() if isinstance(value, str) else value for field, value in values.items()}
        message = getattr(mavlink, f"MAVLink_{name.lower()}_message")(**arguments)
        sequence = self.mavlink.seq
        frame = bytes(message.pack(self.mavlink, force_mavlink1=self.version == 1))
        self.mavlink.seq = (sequence + 1) % 256
        return Sent(name, sequence, frame, {field.lower(): value for field, value in values.items()})

    def sign_from_now(self, key: bytes = bytes(range(32))) -> None:
        """Sign every frame from now on."""
        self.mavlink.signing.secret_key = key
        self.mavlink.signing.sign_outgoing = True
        self.mavlink.signing.timestamp = 1


def message_names() -> list[str]:
    """All messages of the dialect, by id."""
    return [mavlink.mavlink_map[identity].msgname for identity in sorted(mavlink.mavlink_map)]
