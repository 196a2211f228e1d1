"""Where telemetry goes: a UDP, TCP or serial link named as pymavlink names it, a .tlog file, or a recorder
lent by entry point.
"""

from __future__ import annotations

import select
import socket
import struct
import threading
import time
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, BinaryIO, Protocol

from sim_vehicle.errors import SinkError

RECORDERS = "sim_vehicle.recorders"
_SEND_TIMEOUT_S = 5.0
_LARGEST_DATAGRAM = 65535
_RECEIVE_BYTES = 4096
_PEER_SILENT_S = 30.0
_MOST_PEERS = 16
_SERIAL_POLL_S = 0.002  # pyserial waits only for whole reads, and not on every system by select
_SOCKETS = ("udp", "udpin", "udpout", "tcp", "tcpin")
_KINDS = "udpout:HOST:PORT, udpin:HOST:PORT, udp:HOST:PORT (as udpin), tcp:HOST:PORT, tcpin:HOST:PORT, /dev/TTY[,BAUD]"


class Sink(Protocol):
    """Takes whole frames, one by one."""

    def write(self, data: bytes, utc_ns: int) -> None:
        """Send or store one frame that left the vehicle at `utc_ns`; SinkError where that is impossible."""

    def close(self) -> None:
        """Flush and release."""


class Link(Sink, Protocol):
    """A sink that also hears: what the other side sends is to be had while another thread writes."""

    def receive(self, timeout_s: float) -> bytes:
        """What has come, empty where nothing does within `timeout_s` or the other side is gone."""


class UdpSink:
    """Each frame its own datagram. As a server (udpin) it waits for a first datagram, and serves all who spoke.

    A peer that is silent for 30 s is left out, but not the last that is left; of more than 16 the longest silent is.
    clock: monotonic seconds, replaced in tests.
    """

    def __init__(self, host: str, port: int, *, server: bool, clock: Callable[[], float] = time.monotonic) -> None:
        where = f"{'udpin' if server else 'udpout'}:{host}:{port}"
        try:
            family, _, _, _, address = socket.getaddrinfo(host or "0.0.0.0", port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            if server:
                self._socket.bind(address)
        except OSError as error:
            raise SinkError(f"{where}: cannot be opened: {error.strerror or error}") from None
        self._where = where
        self._server = server
        self._clock = clock
        self._heard: dict[Any, float] = {} if server else {address: 0.0}  # when, the longest silent first
        self._changing = threading.Lock()
        self._first = b""

    @property
    def port(self) -> int:
        """Local port, 0 before anything was bound or sent."""
        return int(self._socket.getsockname()[1])

    def wait_for_peer(self) -> None:
        """Block until someone has spoken to a server socket."""
        if not self._heard:
            self._first, peer = self._socket.recvfrom(_LARGEST_DATAGRAM)
            self._hears(peer)

    def _hears(self, peer: Any) -> None:
        with self._changing:
            self._heard.pop(peer, None)
            self._heard[peer] = self._clock()
            if len(self._heard) > _MOST_PEERS:
                del self._heard[next(iter(self._heard))]

    def _peers(self) -> list[Any]:
        """Whom to send to."""
        with self._changing:
            silent_since = self._clock() - _PEER_SILENT_S
            for peer in list(self._heard)[:-1]:
                if self._heard[peer] < silent_since:
                    del self._heard[peer]
            return list(self._heard)

    def receive(self, timeout_s: float) -> bytes:
        if self._first:
            data, self._first = self._first, b""
            return data
        try:
            if not select.select([self._socket], [], [], timeout_s)[0]:
                return b""
            data, peer = self._socket.recvfrom(_LARGEST_DATAGRAM)
        except OSError:
            return b""  # an ICMP message about what was sent; writing reports what cannot go on
        if self._server:
            self._hears(peer)
        return data

    def write(self, data: bytes, utc_ns: int) -> None:
        self.wait_for_peer()
        peers = self._peers()
        failures = [error for peer in peers if (error := self._send(data, peer))]
        if len(failures) == len(peers):
            raise SinkError(f"{self._where}: cannot send: {failures[0].strerror or failures[0]}")

    def _send(self, data: bytes, peer: Any) -> OSError | None:
        try:
            self._socket.sendto(data, peer)
        except ConnectionRefusedError:
            return None  # nobody listens yet: a radio does not stop for that either
        except OSError as error:
            return error
        return None

    def close(self) -> None:
        self._socket.close()


class TcpSink:
    """A byte stream. As a server (tcpin) it waits for a first client, and for a next one when that leaves."""

    def __init__(self, host: str, port: int, *, server: bool) -> None:
        self._where = f"{'tcpin' if server else 'tcp'}:{host}:{port}"
        self._listener: socket.socket | None = None
        self._stream: socket.socket | None = None
        self._silent: socket.socket | None = None  # a stream whose other side will say no more
        try:
            if server:
                self._listener = socket.create_server((host or "0.0.0.0", port))
            else:
                self._stream = socket.create_connection((host, port), timeout=_SEND_TIMEOUT_S)
                self._stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError as error:
            raise SinkError(f"{self._where}: cannot be opened: {error.strerror or error}") from None

    @property
    def port(self) -> int:
        """Port listened on, 0 for a client."""
        return int(self._listener.getsockname()[1]) if self._listener else 0

    def wait_for_peer(self) -> None:
        """Block until a client has connected."""
        if self._stream is None and self._listener:
            self._stream, _ = self._listener.accept()
            self._stream.settimeout(_SEND_TIMEOUT_S)
            self._stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def receive(self, timeout_s: float) -> bytes:
        stream = self._stream
        if stream is None or stream is self._silent:
            time.sleep(timeout_s)
            return b""
        try:
            if not select.select([stream], [], [], timeout_s)[0]:
                return b""
            data = stream.recv(_RECEIVE_BYTES)
        except (OSError, ValueError):  # closed by the writing thread, which reports it
            data = b""
        if not data:
            self._silent = stream
        return data

    def write(self, data: bytes, utc_ns: int) -> None:
        self.wait_for_peer()
        if self._stream is None:
            return
        try:
            self._stream.sendall(data)
        except OSError as error:
            self._stream.close()
            self._stream = None
            if not self._listener:
                raise SinkError(f"{self._where}: the other side is gone: {error.strerror or error}") from None

    def close(self) -> None:
        for open_socket in (self._stream, self._listener):
            if open_socket:
                open_socket.close()


class SerialSink:
    """A serial port, or anything that looks like one."""

    def __init__(self, device: str, baud: int) -> None:
        import serial

        try:
            self._port = serial.Serial(device, baud, timeout=0, write_timeout=_SEND_TIMEOUT_S)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise SinkError(f"{device},{baud}: cannot be opened: {reason}") from None
        self._where = f"{device},{baud}"
        self._errors = (OSError, serial.SerialTimeoutException)

    def receive(self, timeout_s: float) -> bytes:
        deadline = time.monotonic() + timeout_s
        while True:
            try:
                data = bytes(self._port.read(_RECEIVE_BYTES))
            except self._errors:
                data = b""
            if data or time.monotonic() >= deadline:
                return data
            time.sleep(_SERIAL_POLL_S)

    def write(self, data: bytes, utc_ns: int) -> None:
        try:
            self._port.write(data)
        except self._errors as error:
            raise SinkError(f"{self._where}: cannot write: {error}; is {self._port.baudrate} baud enough?") from None

    def close(self) -> None:
        self._port.close()


class TlogSink:
    """A .tlog: before each frame its time, us since 1970, big-endian 64 bit."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file: BinaryIO = path.open("wb")
        except OSError as error:
            raise SinkError(f"{path}: cannot be written: {error.strerror}") from None

    def write(self, data: bytes, utc_ns: int) -> None:
        try:
            self._file.write(struct.pack(">Q", utc_ns // 1000) + data)
        except OSError as error:
            raise SinkError(f"{self._path}: cannot be written: {error.strerror}") from None

    def close(self) -> None:
        self._file.close()


def open_recording(path: Path) -> Sink:
    """A file to record into, by its suffix: .tlog, or what an installed recorder offers (.mcap)."""
    suffix = path.suffix.lstrip(".").lower()
    if path.exists() and (path.is_dir() or path.stat().st_size > 0):
        raise SinkError(f"{path} exists already; give another name, or delete it first")
    if not path.parent.is_dir():
        raise SinkError(f"{path}: cannot be written: there is no folder {path.parent}")
    if suffix == "tlog":
        return TlogSink(path)
    found = list(entry_points(group=RECORDERS, name=suffix)) if suffix else []
    if not found:
        known = ", ".join(sorted({"tlog", *(point.name for point in entry_points(group=RECORDERS))}))
        raise SinkError(f"{path}: no recorder for .{suffix} files is installed; there are {known}")
    try:
        opener: Callable[[str], Sink] = found[0].load()
    except ImportError as error:
        raise SinkError(f"{path}: the recorder {found[0].value} cannot be loaded: {error}") from None
    try:
        return opener(str(path))
    except OSError as error:
        raise SinkError(f"{path}: cannot be written: {error.strerror}") from None


def check_link(url: str) -> None:
    """Raise SinkError, one line, for a text that is no connection string."""
    kind, _, rest = url.partition(":")
    if kind in _SOCKETS:
        _, colon, number = rest.rpartition(":")
        if not colon or not number.isdigit() or not 0 <= int(number) <= 65535:
            raise SinkError(f"{url}: no such link; give {_KINDS}")
        return
    device, _, baud = url.partition(",")
    if not device.startswith("/") and not device.upper().startswith("COM"):
        raise SinkError(f"{url}: no such link; give {_KINDS}")
    if baud and not baud.isdigit():
        raise SinkError(f"{url}: {baud!r} is no baud rate; give {_KINDS}")


def open_link(url: str) -> UdpSink | TcpSink | SerialSink:
    """The link a pymavlink connection string names. Raises SinkError, one line."""
    check_link(url)
    kind, _, rest = url.partition(":")
    if kind in _SOCKETS:
        host, _, number = rest.rpartition(":")
        if kind in ("udpout", "udp", "udpin"):
            return UdpSink(host, int(number), server=kind != "udpout")
        return TcpSink(host, int(number), server=kind == "tcpin")
    device, _, baud = url.partition(",")
    return SerialSink(device, int(baud or 57600))
