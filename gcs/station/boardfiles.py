"""Files onto a board's card over the station's links, by MAVLink FTP (mavlink.io/en/services/ftp.html), with pymavlink.

What was written is asked for again as the board's own checksum: a file that arrived otherwise is none.
"""

from __future__ import annotations

import contextlib
import io
import queue
import threading
import time
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink import mavftp
from pymavlink.dialects.v20 import common

from gcs.errors import JobError
from gcs.mavlink.frameparts import AUTOPILOT
from gcs.mavlink.framing import Frames
from gcs.station.own_sender import COMPONENT, SYSTEM, StationVoice

_FTP = common.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
_PAYLOAD_BYTES = 251
# Within the payload: what was asked, whether it was done, how many bytes the answer has, and where they begin.
_OPCODE, _SIZE, _ASKED, _DATA = 3, 4, 5, 12
_ACK = 128
_LONGEST_S = 60.0
_MOST_BYTES = 200_000
_MOST_WAITING = 500
_ATTEMPTS = 3
# pymavlink's, but for the time for which nothing may come before an answer counts as lost, s: 3.7 there.
_SETTINGS = (
    ("debug", int, 0), ("pkt_loss_tx", int, 0), ("pkt_loss_rx", int, 0), ("max_backlog", int, 5),
    ("burst_read_size", int, 80), ("write_size", int, 80), ("write_qsize", int, 5),
    ("idle_detection_time", float, 1.5), ("read_retry_time", float, 1.0), ("retry_time", float, 0.5),
)  # fmt: skip
_SILENT = (
    "the vehicle does not answer to a file; is it on, is its link good, and does its firmware take files over MAVLink?"
)
_WHY = {
    mavftp.FtpError.FileProtected: "the file there is protected",
    mavftp.FtpError.NoSessionsAvailable: "it has no session left; start it anew",
    mavftp.FtpError.UnknownCommand: "it takes no files over MAVLink",
    mavftp.FtpError.FileNotFound: "there is no such folder on its card",
    mavftp.FtpError.FailErrno: "its card cannot be written; is one in it?",
}


class _Line:
    """The station as pymavlink's client takes a connection: `mav` sends, `recv_match` waits for what was heard."""

    source_system, source_component = SYSTEM, COMPONENT

    def __init__(
        self, voice: StationVoice, say: Callable[[bytes], None], system: int, may_go_on: Callable[[], bool]
    ) -> None:
        self.mav = self
        self._voice, self._say, self._system, self._may_go_on = voice, say, system, may_go_on
        self._heard: queue.Queue[Any] = queue.Queue(_MOST_WAITING)
        self.deadline = time.monotonic() + _LONGEST_S
        # The board's answer to the last question for a checksum.
        self.checksum: int | None = None

    def hear(self, frames: Frames) -> None:
        """Take what the vehicle's autopilot answers to this station."""
        for i in np.flatnonzero(frames.msgid == _FTP).tolist():
            if (frames.sysid[i], frames.compid[i]) != (self._system, AUTOPILOT) or frames.message[i] < 0:
                continue
            start = int(frames.payload_offset[i])
            sent = frames.buffer[start : start + int(frames.payload_length[i])].tobytes()
            whole = sent.ljust(3 + _PAYLOAD_BYTES, b"\0")  # MAVLink 2 does not send trailing zeros
            if (whole[1], whole[2]) == (SYSTEM, COMPONENT):
                message = common.MAVLink_file_transfer_protocol_message(*whole[:3], list(whole[3:]))
                with contextlib.suppress(queue.Full):  # more than a board answers: some are lost, as on the way
                    self._heard.put_nowait(message)

    def file_transfer_protocol_send(self, network: int, system: int, component: int, payload: bytes) -> None:
        """As pymavlink's."""
        message = common.MAVLink_file_transfer_protocol_message(network, system, component, list(payload))
        self._say(self._voice.frame(message))

    def recv_match(self, **given: Any) -> Any:
        """As pymavlink's, of FILE_TRANSFER_PROTOCOL alone. JobError when all of it takes too long."""
        if time.monotonic() > self.deadline:
            raise JobError(_SILENT)
        if not self._may_go_on():
            raise JobError("the vehicle was armed, or is not heard any more: the file is not complete; write it again")
        try:
            message = self._heard.get(timeout=float(given.get("timeout") or 0.1))
        except queue.Empty:
            return None
        payload = bytes(message.payload)
        if payload[_ASKED] == mavftp.OP_CalcFileCRC32 and (payload[_OPCODE], payload[_SIZE]) == (_ACK, 4):
            self.checksum = int.from_bytes(payload[_DATA : _DATA + 4], "little")
        return message


class BoardFiles:
    """Writes files, one at a time. Thread-safe. voice: of the station; say: sends a frame to all vehicles' links."""

    def __init__(self, voice: StationVoice, say: Callable[[bytes], None]) -> None:
        self._voice, self._say = voice, say
        self._turn = threading.Lock()
        self._line: _Line | None = None

    def hear(self, frames: Frames) -> None:
        """Take frames of the vehicles' side that may be believed; costs nothing while no file is written."""
        line = self._line
        if line is not None:
            line.hear(frames)

    def put(self, system: int, path: str, content: bytes, may_go_on: Callable[[], bool]) -> None:
        """Write a file to the card of a vehicle's autopilot; a folder that is missing is made.

        may_go_on: asked again and again meanwhile. Raises JobError, in words: the vehicle does not answer, refuses, or
        holds something else afterwards.
        """
        if len(content) > _MOST_BYTES:
            raise JobError(f"the file has {len(content)} bytes, more than the {_MOST_BYTES} that a script may have")
        if not self._turn.acquire(blocking=False):
            raise JobError("another file is on its way to a vehicle; ask again in a minute")
        try:
            line = self._line = _Line(self._voice, self._say, system, may_go_on)
            for _ in range(_ATTEMPTS):  # of a question whose answer is lost the client says so, and does not ask again
                client = mavftp.MAVFTP(line, system, AUTOPILOT, mavftp.MAVFTPSettings(_SETTINGS))
                client.cmd_mkdir([path.rpartition("/")[0]])  # refused where it is there already
                client.cmd_put([path, path], fh=io.BytesIO(content))
                done = client.process_ftp_reply("put", timeout=_LONGEST_S).error_code
                if done in _WHY:
                    raise JobError(f"the vehicle does not take {path}: {_WHY[done]}")
                if done == mavftp.FtpError.Success:
                    client.cmd_crc([path])
                if line.checksum is not None:
                    break
            if line.checksum is None:
                raise JobError(_SILENT)
            # The boards' checksum is that of zlib, begun at zero and not inverted at its end.
            if line.checksum != zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF:
                raise JobError(f"the vehicle holds something else in {path} than was sent; send it again")
        finally:
            self._line = None
            self._turn.release()
