"""Reception of many UDP datagrams per system call, each with the kernel's time of arrival.

One `recvmmsg` call takes everything that waits in the socket, so the cost per datagram stays small however
late the thread wakes up, and the kernel's stamp (SO_TIMESTAMPNS) keeps the time of arrival exact all the same.
The kernel also counts what it had to drop because the socket's buffer was full (SO_RXQ_OVFL).
"""

from __future__ import annotations

import ctypes
import errno
import os
import socket
import sys
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit

_SO_TIMESTAMPNS = 35
_SO_RXQ_OVFL = 40
_MSG_DONTWAIT = 0x40
_MAX_DATAGRAM = 65536
_ADDRESS_BYTES = 32  # sockaddr_in6 is 28
_CONTROL_BYTES = 64  # a timespec (32 bytes with its header) and a uint32 (24)
_TIMESPEC_CONTROL = 32
_DROPS_CONTROL = 56


@dataclass(frozen=True)
class Batch:
    """Bytes of one link in the order of arrival.

    ends: (N,) offset in `data` just behind each datagram or read.
    received_ns: (N,) UTC time of arrival of each, ns.
    """

    data: bytes
    ends: NDArray[np.int64]
    received_ns: NDArray[np.int64]

    @classmethod
    def of(cls, chunks: list[tuple[bytes, int]]) -> Batch:
        """Join (bytes, UTC ns) pairs."""
        ends = np.cumsum([len(data) for data, _ in chunks], dtype=np.int64)
        return cls(b"".join(data for data, _ in chunks), ends, np.array([at for _, at in chunks], dtype=np.int64))

    def chunks(self) -> list[bytes]:
        """Each datagram or read on its own."""
        starts = [0, *self.ends[:-1].tolist()]
        return [self.data[start:end] for start, end in zip(starts, self.ends.tolist(), strict=True)]


# struct mmsghdr of 64-bit Linux as eight words: name, namelen, iov, iovlen, control, controllen, flags, length.
_NAME, _NAME_LENGTH, _VECTOR, _VECTOR_COUNT, _CONTROL, _CONTROL_LENGTH, _LENGTH = 0, 1, 2, 3, 4, 5, 7
_WORDS = 8

Words = NDArray[np.uint64]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]


@jit
def _collect(
    count: int, headers: Words, payload: Bytes, address: Words, control: Ints, out: Bytes, ends: Ints, times: Ints
) -> tuple[int, int, bool]:
    """Put `count` datagrams behind one another; (bytes, kernel's count of drops or -1, whether all have one sender).

    times: ns of arrival, 0 where the kernel gave no stamp. Makes the headers ready for the next call.
    """
    total = 0
    drops = -1
    same = True
    for i in range(count):
        length = int(headers[i, _LENGTH] & np.uint64(0xFFFFFFFF))
        for k in range(length):
            out[total + k] = payload[i, k]
        total += length
        ends[i] = total
        times[i] = 0
        if headers[i, _CONTROL_LENGTH] >= _TIMESPEC_CONTROL:
            times[i] = control[i, 2] * 1_000_000_000 + control[i, 3]
        if headers[i, _CONTROL_LENGTH] >= _DROPS_CONTROL:
            drops = int(control[i, 6]) & 0xFFFFFFFF
        for k in range(address.shape[1]):
            same = same and address[i, k] == address[0, k]
        headers[i, _NAME_LENGTH] = _ADDRESS_BYTES
        headers[i, _CONTROL_LENGTH] = _CONTROL_BYTES
    return total, drops, same


class DatagramReceiver:
    """Drains a non-blocking UDP socket.

    slots: most datagrams of one `drain`.
    dropped: datagrams that the kernel reports as dropped since the socket was opened.
    """

    def __init__(self, sock: socket.socket, slots: int = 256) -> None:
        self._socket = sock
        self.slots = slots
        self.dropped = 0
        self._multiple = sys.platform == "linux" and sys.maxsize > 2**32 and self._prepare(slots)

    def _prepare(self, slots: int) -> bool:
        """Lay out the message headers; False where the system's C library has no recvmmsg."""
        library = ctypes.CDLL(None, use_errno=True)
        if not hasattr(library, "recvmmsg"):
            return False
        self._recvmmsg = library.recvmmsg
        self._recvmmsg.argtypes = [
            ctypes.c_int,
            ctypes.c_void_p,
            ctypes.c_uint,
            ctypes.c_int,
            ctypes.c_void_p,
        ]
        for option in (_SO_TIMESTAMPNS, _SO_RXQ_OVFL):
            self._socket.setsockopt(socket.SOL_SOCKET, option, 1)
        self._payload = np.zeros((slots, _MAX_DATAGRAM), np.uint8)  # untouched pages cost no memory
        self._address = np.zeros((slots, _ADDRESS_BYTES // 8), np.uint64)
        self._control = np.zeros((slots, _CONTROL_BYTES // 8), np.int64)
        self._vectors = np.zeros((slots, 2), np.uint64)
        self._headers = np.zeros((slots, _WORDS), np.uint64)
        self._out = np.zeros(slots * _MAX_DATAGRAM, np.uint8)
        index = np.arange(slots, dtype=np.uint64)
        self._vectors[:, 0] = self._payload.ctypes.data + index * np.uint64(_MAX_DATAGRAM)
        self._vectors[:, 1] = _MAX_DATAGRAM
        self._headers[:, _NAME] = self._address.ctypes.data + index * np.uint64(_ADDRESS_BYTES)
        self._headers[:, _VECTOR] = self._vectors.ctypes.data + index * np.uint64(self._vectors.itemsize * 2)
        self._headers[:, _VECTOR_COUNT] = 1
        self._headers[:, _CONTROL] = self._control.ctypes.data + index * np.uint64(_CONTROL_BYTES)
        self._headers[:, _NAME_LENGTH] = _ADDRESS_BYTES
        self._headers[:, _CONTROL_LENGTH] = _CONTROL_BYTES
        self._headers_at = self._headers.ctypes.data
        return True

    def drain(self) -> tuple[Batch | None, list[tuple[str, int]]]:
        """Everything that waits now (at most `slots` datagrams), and the addresses that sent it.

        Raises OSError (ConnectionRefusedError of a connected socket) as the socket does; never blocks.
        """
        return self._drain_many() if self._multiple else self._drain_singly()

    def _drain_many(self) -> tuple[Batch | None, list[tuple[str, int]]]:
        count = self._recvmmsg(self._socket.fileno(), self._headers_at, self.slots, _MSG_DONTWAIT, None)
        if count < 0:
            number = ctypes.get_errno()
            if number in (errno.EAGAIN, errno.EWOULDBLOCK, errno.EINTR):
                return None, []
            raise OSError(number, os.strerror(number))
        ends, times = np.empty(count, np.int64), np.empty(count, np.int64)
        total, drops, same = _collect(
            count, self._headers, self._payload, self._address, self._control, self._out, ends, times
        )
        if drops >= 0:
            self.dropped = drops
        if times[0] == 0:  # queued before the option was set
            times[times == 0] = time.time_ns()
        rows = self._address[:1] if same else np.unique(self._address[:count], axis=0)
        peers = [_address_of(row.tobytes(), self._socket.family) for row in rows]
        return Batch(self._out[:total].tobytes(), ends, times), peers

    def _drain_singly(self) -> tuple[Batch | None, list[tuple[str, int]]]:
        chunks: list[tuple[bytes, int]] = []
        peers: set[tuple[str, int]] = set()
        while len(chunks) < self.slots:
            try:
                data, address = self._socket.recvfrom(_MAX_DATAGRAM)
            except (BlockingIOError, InterruptedError):
                break
            chunks.append((data, time.time_ns()))
            peers.add(address[:2])
        return (Batch.of(chunks) if chunks else None), sorted(peers)


def _address_of(raw: bytes, family: int) -> tuple[str, int]:
    """Host and port in a sockaddr_in or sockaddr_in6."""
    port = int.from_bytes(raw[2:4], "big")
    if family == socket.AF_INET6:
        return socket.inet_ntop(socket.AF_INET6, raw[8:24]), port
    return socket.inet_ntop(socket.AF_INET, raw[4:8]), port
