"""Links that carry a byte stream: a TCP client and a serial device."""

from __future__ import annotations

import contextlib
import glob
import os
import socket
import sys
import time
from abc import abstractmethod
from collections.abc import Sequence

import serial

from gcs.links.datagrams import Batch, Peer
from gcs.links.link import Backoff, Link, address_text, readable
from gcs.links.outbox import Outbox
from gcs.links.url import LinkUrl
from gcs.portable import TERMINAL_ERROR
from gcs.text.oserrors import device_reason, reason

# Reads are stamped here, not by the kernel, so each is made at once; only the handing over waits for a few.
GATHER_S = 0.02
READ_BYTES = 65536
#: What is on its way when a link is closed gets this long.
LINGER_S = 1.0
# Looking for a device costs next to nothing, and what it sends before it is opened is lost.
_LOOK_FOR_DEVICE_S = 0.1
CLOSED = "the other side closed the connection"


class StreamLink(Link):
    """A byte stream that may end and come back: what TCP clients and serial links share."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._retry = Backoff()
        self._outbox: Outbox | None = None

    @abstractmethod
    def _connect(self, timeout_s: float) -> tuple[Peer, str]:
        """Try once: the peer and its name in words; OSError with the reason if bytes cannot flow."""

    @abstractmethod
    def _read(self, timeout_s: float) -> bytes | None:
        """Bytes within `timeout_s`, b"" if none came, None or OSError if the stream has ended."""

    @abstractmethod
    def _write(self, data: memoryview) -> int:
        """Give the stream what it takes without waiting; OSError if it has ended."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Drop the connection, keep what is needed for the next."""

    def _fetch(self, timeout_s: float) -> None:
        if not self.connected and not self._reconnect(timeout_s):
            return
        chunks: list[tuple[bytes, int]] = []
        deadline = time.monotonic() + timeout_s
        while (left := deadline - time.monotonic()) > 0:
            try:
                if self._outbox:
                    self._outbox.flush()
                    left = min(left, GATHER_S)
                data = self._read(left)
            except OSError as error:
                self._lose(reason(error))
                break
            if data is None:
                self._lose(CLOSED)
                break
            if data:
                chunks.append((data, time.time_ns()))
                if len(chunks) == 1:
                    deadline = min(deadline, time.monotonic() + GATHER_S)
        if chunks:
            self._take(self._source, Batch.of(chunks))

    def _reconnect(self, timeout_s: float) -> bool:
        if not self._retry.due(timeout_s):
            return False
        try:
            peer, address = self._connect(timeout_s)
        except OSError as error:
            self._failed(error)
            return False
        self._source = self.sources.of(peer, address)
        self._outbox = Outbox(self._write, self._sent, self._unsent)
        self.connected, self.problem, self.broken = True, "", False
        self.counters.reconnects += self.counters.connections > 0
        self.counters.connections += 1
        self._retry.reset()
        return True

    def _lose(self, problem: str) -> None:
        self.connected = False
        self.problem = problem
        self._end_outbox()
        self.sources.forget(self._source.peer)
        self._disconnect()

    def _end_outbox(self) -> None:
        """From here on nothing is written, whatever thread is about to."""
        outbox, self._outbox = self._outbox, None
        if outbox is not None:
            outbox.close()

    def send(self, data: bytes, wait_s: float = 0.0) -> None:
        self._offer([data], wait_s)

    def send_frames(self, frames: Sequence[bytes]) -> None:
        """Send frames behind one another; waits for nothing."""
        self._offer(frames, 0.0)

    def _offer(self, frames: Sequence[bytes], wait_s: float) -> None:
        outbox = self._outbox
        if outbox is None:
            return
        taken = 0
        with contextlib.suppress(OSError):  # reading says what became of the stream
            taken = outbox.offer(frames, wait_s)
        self._unsent(len(frames) - taken)

    def close(self) -> None:
        if self._outbox:
            with contextlib.suppress(OSError):
                self._outbox.flush(LINGER_S)
        self._end_outbox()
        self.connected = False
        self._disconnect()


def prepare_socket(sock: socket.socket) -> None:
    """Send at once, wait for nothing, and notice within half a minute that the other side is gone without a word."""
    sock.setblocking(False)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    if sys.platform == "linux":
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 10)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 5)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3)


def write_some(sock: socket.socket, data: memoryview) -> int:
    """Give a non-blocking socket what it takes now."""
    try:
        return sock.send(data)
    except (BlockingIOError, InterruptedError):
        return 0


class TcpClientLink(StreamLink):
    """`tcp:HOST:PORT`: connects, and connects again whenever the server goes away."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._socket: socket.socket | None = None

    def _connect(self, timeout_s: float) -> tuple[Peer, str]:
        sock = socket.create_connection((self.url.host, self.url.port), timeout=max(timeout_s, 0.5))
        prepare_socket(sock)
        self._socket = sock
        peer = (self.url.host, self.url.port)
        return peer, address_text(*peer)

    def _read(self, timeout_s: float) -> bytes | None:
        sock = self._socket
        if sock is None:
            return None
        if not readable(sock.fileno(), timeout_s):
            return b""
        return sock.recv(READ_BYTES) or None

    def _write(self, data: memoryview) -> int:
        if self._socket is None:
            return 0
        return write_some(self._socket, data)

    def _disconnect(self) -> None:
        sock, self._socket = self._socket, None
        if sock is not None:
            sock.close()


class SerialLink(StreamLink):
    """A serial device or pseudo-terminal: opened again whenever it was unplugged.

    The device may be a pattern, as /dev/ttyACM*: the first that is there, and that no other program holds, is taken.
    """

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._port: serial.Serial | None = None
        self._retry = Backoff(_LOOK_FOR_DEVICE_S)

    def _connect(self, timeout_s: float) -> tuple[Peer, str]:
        pattern = self.url.device
        devices = sorted(glob.glob(pattern)) if glob.has_magic(pattern) else [pattern]
        if not devices:
            raise OSError(f"no device matches {pattern} yet")
        for device in devices[:-1]:
            with contextlib.suppress(OSError):
                return self._open(device)
        return self._open(devices[-1])

    def _open(self, device: str) -> tuple[Peer, str]:
        try:
            # Exclusive: a second program on the device would take bytes away from this one.
            self._port = serial.Serial(device, self.url.baud, exclusive=True)
        except serial.SerialException as error:
            raise OSError(device_reason(device, error)) from error
        except (ValueError, OverflowError, TERMINAL_ERROR) as error:  # a baud rate that the device refuses
            why = " ".join(str(error.args[-1]).split())
            raise OSError(f"{device} cannot be used at {self.url.baud} baud: {why}") from error
        return (device, self.url.baud), device

    def _read(self, timeout_s: float) -> bytes | None:
        port = self._port
        if port is None:
            return None
        # pyserial's own read waits by `select`, which takes no descriptor from 1024 on.
        if not readable(port.fileno(), timeout_s):
            return b""
        return os.read(port.fileno(), READ_BYTES) or None

    def _write(self, data: memoryview) -> int:
        port = self._port
        if port is None:
            return 0
        try:
            return os.write(port.fileno(), data)
        except (BlockingIOError, InterruptedError):
            return 0

    def _disconnect(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(OSError):  # a device that is gone cannot be closed properly
                port.close()
