"""A board that takes files over MAVLink FTP, from the protocol's description (mavlink.io/en/services/ftp.html)."""

from __future__ import annotations

import binascii
import contextlib
import random
import socket
import struct
import threading
import time
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as mavlink

# Operations and errors by the description's numbers.
TERMINATE, RESET, CREATE, WRITE, MAKE_FOLDER, CHECKSUM = 1, 2, 6, 7, 9, 14
ACK, NAK = 128, 129
FAIL, INVALID_SESSION, EXISTS, UNKNOWN, NOT_FOUND, PROTECTED = 1, 4, 8, 7, 10, 9
HEADER = struct.Struct("<HBBBBBBI")
SESSION = 3


@dataclass
class BoardCard:
    """A vehicle at a UDP port of this machine. lost: share of the datagrams that are lost, each way.

    speaks: whether it knows MAVLink FTP. spoils: whether a byte of what it keeps is another. protected: refuses files.
    uid: the board's number. component: who answers; beats_as: who sends HEARTBEAT, if another. arms_at_write: as soon
    as something is written.
    """

    port: int
    system: int = 1
    armed: bool = False
    lost: float = 0.0
    speaks: bool = True
    spoils: bool = False
    protected: bool = False
    uid: int = 0
    component: int = 1
    beats_as: int = 0
    arms_at_write: bool = False
    files: dict[str, bytearray] = field(default_factory=dict)
    folders: set[str] = field(default_factory=lambda: {"APM"})

    def __enter__(self) -> BoardCard:
        self._mav = mavlink.MAVLink(None, srcSystem=self.system, srcComponent=self.component)
        beats_as = self.beats_as or self.component
        self._beats = mavlink.MAVLink(None, srcSystem=self.system, srcComponent=beats_as)
        self._chance = random.Random(5)
        self._open = ""
        self._answers: dict[int, bytes] = {}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", self.port))
        self._socket.settimeout(0.05)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._socket.close()

    def _say(self, message: mavlink.MAVLink_message, mav: mavlink.MAVLink | None = None) -> None:
        mav = mav or self._mav
        with contextlib.suppress(OSError):
            self._socket.send(message.pack(mav))
        mav.seq = (mav.seq + 1) % 256

    def _run(self) -> None:
        hears = mavlink.MAVLink(None)
        hears.robust_parsing = True
        beat = 0.0
        while not self._over.is_set():
            if time.monotonic() - beat > 0.2:
                beat = time.monotonic()
                mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
                self._say(
                    mavlink.MAVLink_heartbeat_message(1, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mode, 0, 3, 3),
                    self._beats,
                )
            try:
                data = self._socket.recv(65536)
            except OSError:
                continue
            for message in hears.parse_buffer(data) or ():
                if message.get_type() == "COMMAND_LONG" and message.param1 == 148 and self.uid:
                    self._say(mavlink.MAVLink_autopilot_version_message(
                        0, 0, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, self.uid))  # fmt: skip
                if message.get_type() == "FILE_TRANSFER_PROTOCOL" and message.target_system == self.system:
                    self._answer(bytes(message.payload), message.get_srcSystem(), message.get_srcComponent())

    def _answer(self, asked: bytes, system: int, component: int) -> None:
        if not self.speaks or self._chance.random() < self.lost:
            return
        number, session, operation, size, _, _, _, offset = HEADER.unpack_from(asked)
        if number not in self._answers or operation == RESET:  # what is asked twice is answered alike, and done once
            code, data = self._do(operation, session, offset, asked[12 : 12 + size])
            session = SESSION if operation == CREATE and code == ACK else session
            head = HEADER.pack((number + 1) % 65536, session, code, len(data), operation, 0, 0, offset)
            self._answers[number] = (head + data).ljust(251, b"\0")
        if self._chance.random() >= self.lost:
            answer = list(self._answers[number])
            self._say(mavlink.MAVLink_file_transfer_protocol_message(0, system, component, answer))

    def _do(self, operation: int, session: int, offset: int, data: bytes) -> tuple[int, bytes]:
        """What is asked; ACK or NAK, and the answer's bytes."""
        name = data.rstrip(b"\0").decode("latin-1")
        if operation == RESET:
            self._answers.clear()  # another client begins, which counts anew
        if operation in (RESET, TERMINATE):
            if operation == TERMINATE and self.spoils and self._open:
                self.files[self._open][0] ^= 1
            self._open = ""
        elif operation == MAKE_FOLDER:
            if name in self.folders:
                return NAK, bytes([EXISTS])
            self.folders.add(name)
        elif operation == CREATE:
            if self.protected:
                return NAK, bytes([PROTECTED])
            if name.rpartition("/")[0] not in self.folders:
                return NAK, bytes([NOT_FOUND])
            self._open = name
            self.files[name] = bytearray()
        elif operation == WRITE:
            if session != SESSION or not self._open:
                return NAK, bytes([INVALID_SESSION])
            if self.arms_at_write and not self.armed:
                self.armed = True
                beat = mavlink.MAVLink_heartbeat_message(1, 3, mavlink.MAV_MODE_FLAG_SAFETY_ARMED, 0, 3, 3)
                self._say(beat, self._beats)
            content = self.files[self._open]
            content.extend(bytes(max(0, offset + len(data) - len(content))))
            content[offset : offset + len(data)] = data
        elif operation == CHECKSUM:
            if name not in self.files:
                return NAK, bytes([NOT_FOUND])
            return ACK, struct.pack("<I", checksum(bytes(self.files[name])))
        else:
            return NAK, bytes([UNKNOWN])
        return ACK, b""


def checksum(content: bytes) -> int:
    """CRC-32 as boards make it, bit by bit: the polynomial 0xEDB88320, begun at zero, not inverted."""
    value = 0
    for byte in content:
        value ^= byte
        for _ in range(8):
            value = (value >> 1) ^ (0xEDB88320 if value & 1 else 0)
    assert binascii.crc32(b"123456789") == 0xCBF43926  # the polynomial is that of the usual one, which differs in both
    return value
