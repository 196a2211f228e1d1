"""Links that carry a byte stream: TCP and serial."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from abc import abstractmethod

import serial

from gcs.datagrams import Batch
from gcs.errors import LinkError
from gcs.link import Backoff, Link, resolve
from gcs.linkurl import LinkUrl

# Reads are stamped here, not by the kernel, so each is made at once; only the handing over waits for a few.
_GATHER_S = 0.02
_READ_BYTES = 65536


class StreamLink(Link):
    """A byte stream that may end and come back: what TCP and serial links share."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._retry = Backoff()

    @abstractmethod
    def _connect(self, timeout_s: float) -> bool:
        """Try once; True when bytes can flow, OSError with the reason when not."""

    @abstractmethod
    def _read(self, timeout_s: float) -> bytes | None:
        """Bytes within `timeout_s`, b"" if none came, None or OSError if the stream has ended."""

    @abstractmethod
    def _write(self, data: bytes) -> None:
        """Send all; OSError if that cannot be done now."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Drop the connection, keep what is needed for the next."""

    def receive(self, timeout_s: float) -> Batch | None:
        if not self.connected and not self._reconnect(timeout_s):
            return None
        chunks: list[tuple[bytes, int]] = []
        deadline = time.monotonic() + timeout_s
        while (left := deadline - time.monotonic()) > 0:
            try:
                data = self._read(left)
            except OSError as error:
                self._lose(error.strerror or str(error))
                break
            if data is None:
                self._lose("the other side closed the connection")
                break
            if data:
                chunks.append((data, time.time_ns()))
                if len(chunks) == 1:
                    deadline = min(deadline, time.monotonic() + _GATHER_S)
        return self._count(Batch.of(chunks)) if chunks else None

    def _reconnect(self, timeout_s: float) -> bool:
        if not self._retry.due(timeout_s):
            return False
        try:
            self.connected = self._connect(timeout_s)
        except OSError as error:
            self.problem = error.strerror or str(error)
            return False
        if self.connected:
            self.problem = ""
            self.counters.connections += 1
            self._retry.reset()
        return self.connected

    def _lose(self, problem: str) -> None:
        self.connected = False
        self.problem = problem
        self._disconnect()

    def send(self, data: bytes) -> None:
        if not self.connected:
            return
        try:
            self._write(data)
            self.counters.bytes_sent += len(data)
        except OSError:
            self.counters.send_errors += 1

    def close(self) -> None:
        self.connected = False
        self._disconnect()


class TcpClientLink(StreamLink):
    """`tcp:HOST:PORT`: connects, and connects again whenever the server goes away."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._socket: socket.socket | None = None

    def _connect(self, timeout_s: float) -> bool:
        sock = socket.create_connection((self.url.host, self.url.port), timeout=max(timeout_s, 0.5))
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._socket = sock
        return True

    def _read(self, timeout_s: float) -> bytes | None:
        sock = self._socket
        if sock is None:
            return None
        if not select.select([sock], [], [], timeout_s)[0]:
            return b""
        return sock.recv(_READ_BYTES) or None

    def _write(self, data: bytes) -> None:
        if self._socket is not None:
            self._socket.sendall(data)

    def _disconnect(self) -> None:
        sock, self._socket = self._socket, None
        if sock is not None:
            sock.close()


class TcpServerLink(TcpClientLink):
    """`tcpin:HOST:PORT`: serves one client at a time; a new one replaces one that has been silent for 2 s."""

    _SILENT_S = 2.0

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        try:
            family, address = resolve(url, socket.SOCK_STREAM)
            self._listener = socket.create_server(address, family=socket.AddressFamily(family), backlog=4)
        except OSError as error:
            raise LinkError(
                f"{url.text}: cannot listen there ({error.strerror or error}); choose another port"
            ) from error
        self._last_read = 0.0

    @property
    def port(self) -> int:
        """The local port, of use where the URL asked for port 0."""
        return int(self._listener.getsockname()[1])

    def _connect(self, timeout_s: float) -> bool:
        if not select.select([self._listener], [], [], timeout_s)[0]:
            self._retry.reset()
            return False
        self._socket, _ = self._listener.accept()
        self._socket.settimeout(max(timeout_s, 0.5))
        self._last_read = time.monotonic()
        return True

    def _read(self, timeout_s: float) -> bytes | None:
        data = super()._read(timeout_s)
        if data:
            self._last_read = time.monotonic()
        elif time.monotonic() - self._last_read > self._SILENT_S and select.select([self._listener], [], [], 0)[0]:
            return None
        return data

    def close(self) -> None:
        super().close()
        self._listener.close()


class SerialLink(StreamLink):
    """A serial device or pseudo-terminal: opened again whenever it was unplugged."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._port: serial.Serial | None = None

    def _connect(self, timeout_s: float) -> bool:
        try:
            self._port = serial.Serial(self.url.device, self.url.baud, timeout=timeout_s, write_timeout=0.5)
        except ValueError as error:  # a baud rate that the device refuses
            raise OSError(str(error)) from error
        return True

    def _read(self, timeout_s: float) -> bytes | None:
        port = self._port
        if port is None:
            return None
        port.timeout = timeout_s
        first = port.read(1)
        return bytes(first + port.read(port.in_waiting)) if first else b""

    def _write(self, data: bytes) -> None:
        if self._port is not None:
            self._port.write(data)

    def _disconnect(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(OSError):  # a device that is gone cannot be closed properly
                port.close()
