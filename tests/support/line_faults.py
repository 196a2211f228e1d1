"""Faults of the ways to a vehicle: losses and a cut in a network of its own, a serial device that is pulled out."""

from __future__ import annotations

import os
import random
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from fault_rig import Outcome, Served, wait_for
from processes import free_port
from pseudo_terminal import plugged
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from traffic import Vehicle

from gcs.recording.reader import Recording

SENDER = Path(__file__).parent / "numbered_sender.py"


@contextmanager
def network(name: str) -> Iterator[None]:
    """A namespace `name` whose 10.99.0.2 reaches this one's 10.99.0.1."""

    def ip(*words: str) -> None:
        subprocess.run(["ip", *words], check=True)

    ip("netns", "add", name)
    try:
        ip("link", "add", f"{name}-a", "type", "veth", "peer", "name", f"{name}-b", "netns", name)
        ip("addr", "add", "10.99.0.1/24", "dev", f"{name}-a")
        ip("link", "set", f"{name}-a", "up")
        ip("-n", name, "addr", "add", "10.99.0.2/24", "dev", f"{name}-b")
        ip("-n", name, "link", "set", f"{name}-b", "up")
        yield
    finally:
        ip("netns", "del", name)


class Lossy:
    """Passes datagrams on from `host`:`port`, but for a share that is lost."""

    def __init__(self, host: str, target: tuple[str, int]) -> None:
        self.lost = 0.0
        self._chance = random.Random(1)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((host, 0))
        self.port = int(self._socket.getsockname()[1])
        self._target = target
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while True:
            data = self._socket.recv(65536)
            if self._chance.random() >= self.lost:
                self._socket.sendto(data, self._target)


def bad_network(seed: int, log: bytes) -> Outcome:
    """A fifth of the datagrams lost, then the line cut for 4 s, then all is well: what is missing is counted."""
    with ExitStack() as stack:
        name = f"fault{os.getpid() % 10000}"
        stack.enter_context(network(name))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="fault-")))
        port = free_port()
        served = Served(folder / "data", "--connect", f"udpin:127.0.0.1:{port}")
        lossy = Lossy("10.99.0.1", ("127.0.0.1", port))
        sender = subprocess.Popen(
            ["ip", "netns", "exec", name, sys.executable, str(SENDER), str(lossy.port), "500", "10.99.0.1"],
            stdout=subprocess.DEVNULL,
        )
        try:
            wait_for(lambda: served.get("/api/health")["recording"], "a flight")
            time.sleep(2.0)
            lossy.lost = 0.2
            time.sleep(6.0)
            subprocess.run(["ip", "link", "set", f"{name}-a", "down"], check=True)
            time.sleep(4.0)
            lossy.lost = 0.0
            subprocess.run(["ip", "link", "set", f"{name}-a", "up"], check=True)
            time.sleep(4.0)
            flights = len(served.get("/api/flights")["flights"])
        finally:
            sender.kill()
            sender.wait()
            served.stop()
        (path,) = (folder / "data" / "flights").glob("*.mcap")
        recording = Recording(path)
        numbers = {int(number) for one in recording.columns("PING") for number in one["seq"]}
        missing = max(numbers) - min(numbers) + 1 - len(numbers)
        said = sum(recording.lost().values())
        # HEARTBEATs are lost too. The frames' counter has but 256 values: of a long gap the rest by 256 is counted.
        beats = 40
        counted = any(abs(said + 256 * turns - missing) <= beats for turns in range(missing // 256 + 1))
        wrong = [f"{flights} flights"] if flights != 1 else []
        wrong += [] if counted and said > 500 else ["the losses are not counted"]
        return Outcome("20 % lost, line cut", seed, f"{missing} PING missing, {said} frames counted", "; ".join(wrong))


def unplugged(seed: int, log: bytes) -> Outcome:
    """A serial device pulled out and put in again five times, within frames: one flight, and no whole frame lost."""
    chance = random.Random(seed)
    with tempfile.TemporaryDirectory(prefix="fault-") as name:
        folder, vehicle = Path(name), Vehicle(1)
        device = folder / "ttyVehicle"
        served = Served(folder / "data", "--connect", f"{device},115200")
        number, cut, said = 0, 0, set[str]()
        try:
            for turn in range(5):
                with plugged(device) as (end, _):
                    wait_for(lambda: served.get("/api/links")[0]["connected"], "the device")
                    for _ in range(chance.randint(40, 120)):
                        os.write(end, vehicle.heartbeat() + _ping(vehicle, number))
                        number += 1
                        time.sleep(0.01)
                    torn = _ping(vehicle, number)
                    os.write(end, torn[: chance.randint(1, len(torn) - 1)])
                    number, cut = number + 1, cut + 1
                    expected = number - cut
                    wait_for(lambda n=expected: _frames(served) >= 2 * n, f"all frames of turn {turn}")
                said.add(wait_for(lambda: served.get("/api/links")[0]["problem"], "what became of the device"))
            flights = len(served.get("/api/flights")["flights"])
        finally:
            served.stop()
        (path,) = (folder / "data" / "flights").glob("*.mcap")
        pings = np.concatenate([one["seq"] for one in Recording(path).columns("PING")])
        wrong = [f"{flights} flights"] if flights != 1 else []
        wrong += [f"{number - cut - pings.size} frames lost"] if pings.size != number - cut else []
        return Outcome("serial unplugged", seed, f"{pings.size} of {number - cut} frames; {'; '.join(said)}",
                       "; ".join(wrong))  # fmt: skip


def _ping(vehicle: Vehicle, number: int) -> bytes:
    return vehicle.frame(mavlink.MAVLink_ping_message(0, number, 0, 0))


def _frames(served: Served) -> int:
    return int(served.get("/api/links")[0]["frames"])
