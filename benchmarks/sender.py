"""What benchmarks and campaigns over UDP share: the sender in C, its frames, and what the kernel says of a process."""

from __future__ import annotations

import shutil
import socket
import struct
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from telemetry import telemetry

from gcs.mavlink.dialect import Dialect

_NO_STAMP = 255


def build_sender(folder: Path) -> Path:
    """The compiled sender, `udp_sender.c`."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        sys.exit("a C compiler (cc) is needed for the sender; install one")
    program = folder / "udp_sender"
    subprocess.run([compiler, "-O2", "-o", program, Path(__file__).with_name("udp_sender.c")], check=True)
    return program


def write_frames(path: Path, frames: Sequence[bytes]) -> None:
    """MAVLink 2 frames as the sender reads them, with what it needs to number and stamp them anew."""
    dialect = Dialect.load()
    with path.open("wb") as file:
        for frame in frames:
            kind = dialect.by_id[int.from_bytes(frame[7:10], "little")]
            stamp = kind.layout.field(kind.stamp) if kind.stamp_unit else None
            at = stamp.wire_offset if stamp else _NO_STAMP
            size = {"uint32": 4, "uint64": 8}[stamp.type] if stamp else 0
            unit = 1000 if kind.stamp_unit == "ms" else 1
            file.write(struct.pack("<BBBBHxx", len(frame), kind.crc_extra, at, size, unit) + frame)


def vehicle_frames(seconds: float = 60.0) -> list[bytes]:
    """Ordinary telemetry, with a HEARTBEAT of an armed aeroplane in front of every 410 messages."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_FIXED_WING, 0, armed, 0, mavlink.MAV_STATE_ACTIVE, 3)
    heartbeat = bytes(beat.pack(sender))
    frames: list[bytes] = []
    for i, (_, frame) in enumerate(telemetry(seconds)):
        if i % 410 == 0:
            frames.append(heartbeat)
        frames.append(frame)
    return frames


def send(program: Path, port: int, rate: float, count: int, first: int, frames: Path) -> float:
    """Send `count` frames and wait for it; the seconds it took."""
    command = [program, str(port), str(rate), str(count), str(first), frames]
    out = subprocess.run(command, check=True, capture_output=True, text=True)
    return float(out.stdout.split()[1])


def cpu_seconds(process: int) -> float:
    """CPU time of a process and all its threads so far, as the scheduler counts it."""
    tasks = Path(f"/proc/{process}/task").glob("*/schedstat")
    return sum(int(task.read_text().split()[0]) for task in tasks) / 1e9


def free_port() -> int:
    """A UDP port of this machine that nobody uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
