"""What of this machine may keep a ground station from its work, and the cure of each."""

from __future__ import annotations

import os
import shutil
import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from serial.tools import list_ports

from gcs.links.udp import RECEIVE_BUFFER_BYTES
from gcs.text.sizes import size_text
from sim_vehicle.jit import compiled_mark

# Free space below which a day at the field may fill the disk, and below which recording stops soon.
_LITTLE_BYTES, _LEAST_BYTES = 10_000_000_000, 1_000_000_000
# Nobody has a clock before this software was written: UTC, s.
_WRITTEN_S = 1_735_689_600.0
_SYNCHRONISED = Path("/run/systemd/timesync/synchronized")
_RECEIVE_LIMIT = Path("/proc/sys/net/core/rmem_max")
_PROCESSES = Path("/proc")


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at. level: good, care (it may do harm) or bad. cure: what to do, "" for nothing."""

    name: str
    level: str
    text: str
    cure: str = ""


def examine(data: Path, http: int, udp: int) -> Iterator[Finding]:
    """Everything, one by one. data: where recordings go. http, udp: ports of the service and of its first link."""
    yield _disk(data)
    yield _port("port of the page", socket.SOCK_STREAM, http, "--port N")
    yield _port("port of telemetry", socket.SOCK_DGRAM, udp, "--connect udpin:0.0.0.0:N")
    yield from _serial()
    yield _clock()
    yield _buffer()
    yield _compiled()


def _disk(data: Path) -> Finding:
    """Whether recordings can be written, and for how long."""
    folder = data.absolute()
    while not folder.exists():
        folder = folder.parent
    try:
        with tempfile.TemporaryFile(dir=folder) as trial:
            trial.write(b"x")
    except OSError as error:
        words = (error.strerror or str(error)).lower()
        return Finding("disk", "bad", f"{folder}: {words}", "give a folder that you may write to, with --data")
    free = shutil.disk_usage(folder).free
    text = f"{size_text(free)} free at {folder}"
    if free < _LEAST_BYTES:
        return Finding("disk", "bad", text, "delete something, or give another disk with --data")
    if free < _LITTLE_BYTES:
        return Finding("disk", "care", text, "an hour of flight takes some 100 MB; --keep-size lets old recordings go")
    return Finding("disk", "good", text)


def _port(name: str, kind: socket.SocketKind, number: int, option: str) -> Finding:
    with socket.socket(socket.AF_INET, kind) as trial:
        if kind == socket.SOCK_STREAM:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind(("127.0.0.1" if kind == socket.SOCK_STREAM else "0.0.0.0", number))
        except OSError as error:
            words = (error.strerror or str(error)).lower()
            cure = f"end the program that has it (another ground station?), or take another port: {option}"
            return Finding(name, "care", f"{number}: {words}", cure)
    return Finding(name, "good", f"{number} is free")


def _serial() -> Iterator[Finding]:
    """Devices that are there, whether this user may open them, and what else may take them."""
    devices = [one.device for one in list_ports.comports() if one.hwid != "n/a"]
    if not devices:
        yield Finding("serial ports", "good", "no board is plugged in")
    for device in devices:
        if os.access(device, os.R_OK | os.W_OK):
            yield Finding("serial ports", "good", f"{device} can be opened")
        else:
            cure = "sudo usermod -aG dialout $USER, then log in again"
            yield Finding("serial ports", "bad", f"{device}: you may not open it", cure)
    if devices and "ModemManager" in _running():
        cure = "sudo systemctl stop ModemManager, or a udev rule with ENV{ID_MM_DEVICE_IGNORE}=1"
        yield Finding("serial ports", "care", "ModemManager runs, and talks to boards when they are plugged in", cure)


def _running() -> set[str]:
    """Names of the processes of this machine."""
    names = set()
    for place in _PROCESSES.glob("[0-9]*/comm"):
        try:
            names.add(place.read_text(encoding="utf-8", errors="replace").strip())
        except OSError:
            continue  # it has ended
    return names


def _clock(now: Callable[[], float] = time.time) -> Finding:
    stamp = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(now()))
    if now() < _WRITTEN_S:
        return Finding("clock", "bad", f"it shows {stamp}", "set it: flights are named by it (timedatectl set-time)")
    if not _SYNCHRONISED.exists():
        return Finding("clock", "care", f"{stamp}; whether it is synchronised is not known",
                       "compare it with another clock, or connect to a network once before you fly")  # fmt: skip
    return Finding("clock", "good", f"{stamp}, synchronised")


def _buffer() -> Finding:
    """Room that the kernel gives datagrams while the service is busy."""
    try:
        most = int(_RECEIVE_LIMIT.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return Finding("receive buffer", "good", "its limit is not known here")
    if most < RECEIVE_BUFFER_BYTES and os.geteuid() != 0:
        cure = f"sudo sysctl net.core.rmem_max={RECEIVE_BUFFER_BYTES}"
        return Finding("receive buffer", "care", f"{size_text(most)} at most: busy links may lose datagrams", cure)
    return Finding("receive buffer", "good", f"{size_text(max(most, RECEIVE_BUFFER_BYTES))}")


def _compiled() -> Finding:
    mark = compiled_mark()
    folder = mark.parent
    if mark.exists():
        return Finding("compiled code", "good", f"it is there ({folder})")
    while not folder.exists():
        folder = folder.parent
    if not os.access(folder, os.W_OK):
        cure = "give a folder in XDG_CACHE_HOME, or every analysis compiles anew for a minute"
        return Finding("compiled code", "bad", f"{folder} cannot be written", cure)
    return Finding("compiled code", "care", "not there yet: the first analysis takes a minute longer",
                   "identify any flight once before you go to the field")  # fmt: skip
