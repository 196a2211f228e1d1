"""What goes over the pipe to the live process: bytes as links received them, and which flight is recorded."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from gcs.links.datagrams import Batch

_HEADER = struct.Struct("<HIIB")  # bytes of the name, bytes of data, datagrams, kind
_BYTES, _FLIGHT = 0, 1


@dataclass(frozen=True)
class Flight:
    """A recorded flight, "" for none, and the MAVLink system that flies it, None while that is not known.

    vehicle: the file of its aircraft; "" where it is the one that the process was started with.
    """

    id: str = ""
    system: int | None = None
    vehicle: str = ""


def pack_batch(source: str, batch: Batch) -> bytes:
    """A batch as one record."""
    name = source.encode()
    ends = np.asarray(batch.ends, dtype="<i8").tobytes()
    times = np.asarray(batch.received_ns, dtype="<i8").tobytes()
    return _HEADER.pack(len(name), len(batch.data), batch.ends.size, _BYTES) + name + batch.data + ends + times


def pack_flight(flight: Flight) -> bytes:
    """Which flight is followed from here on."""
    name, data = flight.id.encode(), bytes([flight.system or 0]) + flight.vehicle.encode()
    return _HEADER.pack(len(name), len(data), 0, _FLIGHT) + name + data


class Unpacker:
    """Records out of bytes that come in any pieces."""

    def __init__(self) -> None:
        self._held = b""

    def feed(self, data: bytes) -> list[Batch | Flight]:
        """The records that are complete now: batches, whose `source` is set, and flights."""
        self._held += data
        found: list[Batch | Flight] = []
        at = 0
        while at + _HEADER.size <= len(self._held):
            name_size, size, count, kind = _HEADER.unpack_from(self._held, at)
            start = at + _HEADER.size
            stop = start + name_size + size + 16 * count
            if stop > len(self._held):
                break
            name = self._held[start : start + name_size].decode()
            if kind == _FLIGHT:
                data = self._held[start + name_size : stop]
                found.append(Flight(name, data[0] or None, data[1:].decode()))
            else:
                at_data = start + name_size
                at_ends = at_data + size
                numbers = np.frombuffer(self._held, "<i8", 2 * count, at_ends).astype(np.int64)
                found.append(Batch(self._held[at_data:at_ends], numbers[:count], numbers[count:], name))
            at = stop
        self._held = self._held[at:]
        return found
