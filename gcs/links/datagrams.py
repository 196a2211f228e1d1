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
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit

_SO_TIMESTAMPNS = 35
_SO_RXQ_OVFL = 40
_MSG_DONTWAIT = 0x40
_MAX_DATAGRAM = 65536
# A datagram's first bytes lie close together, so that the usual small ones stay in the processor's cache; the rest of
# a large one goes to a place of its own, whose memory is not touched before.
_DENSE_BYTES = 512
_ADDRESS_BYTES = 32  # sockaddr_in6 is 28
_CONTROL_BYTES = 64  # a timespec (32 bytes with its header) and a uint32 (24)
_TIMESPEC_CONTROL = 32
_DROPS_CONTROL = 56


#: Host and port of who sent a datagram.
Peer = tuple[str, int]


@dataclass(frozen=True)
class Batch:
    """Bytes of one source (one peer of a link) in the order of arrival.

    ends: (N,) offset in `data` just behind each datagram or read.
    received_ns: (N,) UTC time of arrival of each, ns.
    source: the source's name where a link distinguishes several peers; "" stands for the link's own.
    """

    data: bytes
    ends: NDArray[np.int64]
    received_ns: NDArray[np.int64]
    source: str = ""

    @classmethod
    def of(cls, chunks: list[tuple[bytes, int]], source: str = "") -> Batch:
        """Join (bytes, UTC ns) pairs."""
        ends = np.cumsum([len(data) for data, _ in chunks], dtype=np.int64)
        times = np.array([at for _, at in chunks], dtype=np.int64)
        return cls(b"".join(data for data, _ in chunks), ends, times, source)

    @classmethod
    def joined(cls, batches: Sequence[Batch]) -> Batch:
        """Batches of one source, at least one, as one."""
        if len(batches) == 1:
            return batches[0]
        begins = np.cumsum([0, *(len(batch.data) for batch in batches[:-1])])
        ends = np.concatenate([batch.ends + begin for batch, begin in zip(batches, begins.tolist(), strict=True)])
        times = np.concatenate([batch.received_ns for batch in batches])
        return cls(b"".join(batch.data for batch in batches), ends, times, batches[0].source)

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


# As many changes of the sender within one fetch are kept in the order of arrival; beyond, datagrams come so
# densely that the bytes of each peer may be put together.
_MOST_RUNS = 32
_MOST_ADDRESSES = 1024


@jit
def _collect(
    count: int,
    headers: Words,
    dense: Bytes,
    rest: Bytes,
    address: Words,
    control: Ints,
    out: Bytes,
    ends: Ints,
    times: Ints,
    run_start: Ints,
) -> tuple[int, int, int]:
    """Put `count` datagrams behind one another; (bytes, kernel's count of drops or -1, runs of one sender each).

    times: ns of arrival, 0 where the kernel gave no stamp. run_start: first datagram of each run. Makes the headers
    ready for the next call.
    """
    total = 0
    drops = -1
    runs = 0
    for i in range(count):
        length = np.int64(headers[i, _LENGTH] & np.uint64(0xFFFFFFFF))
        near = min(length, np.int64(dense.shape[1]))
        for k in range(near):
            out[total + k] = dense[i, k]
        for k in range(length - near):
            out[total + near + k] = rest[i, k]
        total += int(length)
        ends[i] = total
        times[i] = 0
        if headers[i, _CONTROL_LENGTH] >= _TIMESPEC_CONTROL:
            times[i] = control[i, 2] * 1_000_000_000 + control[i, 3]
        if headers[i, _CONTROL_LENGTH] >= _DROPS_CONTROL:
            drops = int(control[i, 6]) & 0xFFFFFFFF
        same = i > 0
        for k in range(address.shape[1]):
            same = same and address[i, k] == address[i - 1, k]
        if not same:
            run_start[runs] = i
            runs += 1
        headers[i, _NAME_LENGTH] = _ADDRESS_BYTES
        headers[i, _CONTROL_LENGTH] = _CONTROL_BYTES
    # A socket keeps the order of arrival. The first datagrams after the option was set may have no stamp of their
    # own and get the time of the call.
    for i in range(count - 1, 0, -1):
        if 0 < times[i] < times[i - 1]:
            times[i - 1] = times[i]
    return total, drops, runs


@jit
def _reorder(order: Ints, ends: Ints, data: Bytes, out: Bytes, new_ends: Ints) -> None:
    """Put datagrams into another order."""
    total = 0
    for i in range(order.size):
        start = ends[order[i] - 1] if order[i] > 0 else 0
        for k in range(start, ends[order[i]]):
            out[total] = data[k]
            total += 1
        new_ends[i] = total


class DatagramReceiver:
    """Drains a non-blocking UDP socket.

    slots: most datagrams of one `drain`.
    dropped: datagrams that the kernel reports as dropped since the socket was opened.
    """

    def __init__(self, sock: socket.socket, slots: int = 1024) -> None:
        self._socket = sock
        self._family = int(sock.family)
        self.slots = slots
        self.dropped = 0
        self._peers: dict[bytes, Peer] = {}
        self._run_start = np.zeros(slots, np.int64)
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
        self._dense = np.zeros((slots, _DENSE_BYTES), np.uint8)
        self._rest = np.zeros((slots, _MAX_DATAGRAM - _DENSE_BYTES), np.uint8)  # untouched pages cost no memory
        self._address = np.zeros((slots, _ADDRESS_BYTES // 8), np.uint64)
        self._control = np.zeros((slots, _CONTROL_BYTES // 8), np.int64)
        self._vectors = np.zeros((slots, 2, 2), np.uint64)
        self._headers = np.zeros((slots, _WORDS), np.uint64)
        self._out = np.zeros(slots * _MAX_DATAGRAM, np.uint8)
        index = np.arange(slots, dtype=np.uint64)
        for part, memory in enumerate((self._dense, self._rest)):
            self._vectors[:, part, 0] = memory.ctypes.data + index * np.uint64(memory.shape[1])
            self._vectors[:, part, 1] = memory.shape[1]
        self._headers[:, _NAME] = self._address.ctypes.data + index * np.uint64(_ADDRESS_BYTES)
        self._headers[:, _VECTOR] = self._vectors.ctypes.data + index * np.uint64(self._vectors[0].nbytes)
        self._headers[:, _VECTOR_COUNT] = 2
        self._headers[:, _CONTROL] = self._control.ctypes.data + index * np.uint64(_CONTROL_BYTES)
        self._headers[:, _NAME_LENGTH] = _ADDRESS_BYTES
        self._headers[:, _CONTROL_LENGTH] = _CONTROL_BYTES
        self._headers_at = self._headers.ctypes.data
        self._descriptor = self._socket.fileno()
        return True

    def drain(self) -> list[tuple[Peer, Batch]]:
        """Everything that waits now (at most `slots` datagrams): who sent it, and what, in the order of arrival.

        Raises OSError (ConnectionRefusedError of a connected socket) as the socket does; never blocks.
        """
        return self._drain_many() if self._multiple else self._drain_singly()

    def _drain_many(self) -> list[tuple[Peer, Batch]]:
        count = self._recvmmsg(self._descriptor, self._headers_at, self.slots, _MSG_DONTWAIT, None)
        if count < 0:
            number = ctypes.get_errno()
            if number in (errno.EAGAIN, errno.EWOULDBLOCK, errno.EINTR):
                return []
            raise OSError(number, os.strerror(number))
        ends, times = np.empty(count, np.int64), np.empty(count, np.int64)
        total, drops, runs = _collect(
            count,
            self._headers,
            self._dense,
            self._rest,
            self._address,
            self._control,
            self._out,
            ends,
            times,
            self._run_start,
        )
        if drops >= 0:
            self.dropped = drops
        if times[0] == 0:  # queued before the option was set
            times[times == 0] = time.time_ns()
        if runs == 1:
            return [(self._peer(0), Batch(self._out[:total].tobytes(), ends, times))]
        return self._split(count, total, runs, ends, times)

    def _split(self, count: int, total: int, runs: int, ends: Ints, times: Ints) -> list[tuple[Peer, Batch]]:
        """Batches of one sender each."""
        data, order = self._out[:total], np.arange(count)
        starts = self._run_start[:runs]
        if runs > _MOST_RUNS:
            _, first, inverse = np.unique(self._address[:count], axis=0, return_index=True, return_inverse=True)
            sender = np.argsort(np.argsort(first))[inverse.reshape(-1)]  # who came first stays first
            order = np.argsort(sender, kind="stable")
            data, new_ends = np.empty(total, np.uint8), np.empty(count, np.int64)
            _reorder(order, ends, self._out, data, new_ends)
            ends, times = new_ends, times[order]
            starts = np.flatnonzero(np.diff(sender[order], prepend=-1))
        batches = []
        for start, stop in zip(starts.tolist(), [*starts[1:].tolist(), count], strict=True):
            begin = int(ends[start - 1]) if start else 0
            part = data[begin : int(ends[stop - 1])].tobytes()
            batches.append((self._peer(int(order[start])), Batch(part, ends[start:stop] - begin, times[start:stop])))
        return batches

    def _peer(self, i: int) -> Peer:
        """Who sent datagram i of the last fetch."""
        raw = self._address[i].tobytes()
        peer = self._peers.get(raw)
        if peer is None:
            if len(self._peers) >= _MOST_ADDRESSES:
                self._peers.clear()
            peer = self._peers[raw] = _address_of(raw, self._family)
        return peer

    def _drain_singly(self) -> list[tuple[Peer, Batch]]:
        arrived: list[tuple[Peer, bytes, int]] = []
        while len(arrived) < self.slots:
            try:
                data, address = self._socket.recvfrom(_MAX_DATAGRAM)
            except (BlockingIOError, InterruptedError):
                break
            arrived.append((address[:2], data, time.time_ns()))
        return [
            (peer, Batch.of([(data, at) for _, data, at in run])) for peer, run in groupby(arrived, lambda one: one[0])
        ]


def _address_of(raw: bytes, family: int) -> Peer:
    """Host and port in a sockaddr_in or sockaddr_in6."""
    port = int.from_bytes(raw[2:4], "big")
    if family == socket.AF_INET6:
        return socket.inet_ntop(socket.AF_INET6, raw[8:24]), port
    return socket.inet_ntop(socket.AF_INET, raw[4:8]), port
