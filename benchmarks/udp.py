"""Receiving UDP and recording it: CPU per datagram and loss, against mavutil and mcap-python.

Run: python benchmarks/udp.py [--rates 410,60000] [--seconds 10] [--rounds 5] [--loss-rate 100000 --loss-seconds 60]

The sender is a program in C (compiled with cc), in a process of its own, with one MAVLink 2 frame in each datagram.
CPU is what the kernel accounts to the receiving process and its threads while the datagrams come, its idle work
included. Loss is what was sent less what is in the recording.
"""

from __future__ import annotations

import argparse
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mcap.reader import make_reader
from sender import build_sender, cpu_seconds, free_port, send, vehicle_frames, write_frames

from gcs.recording.reader import Recording

HERE = Path(__file__).parent
WARM_UP = 2048
RECORD, SERVE, PEER = "gcs record", "gcs serve", "mavutil + mcap-python"


@dataclass(frozen=True)
class Run:
    """One receiver under one load. cpu_us: per datagram received. seconds: the sender's."""

    sent: int
    received: int
    cpu_us: float
    seconds: float


@contextmanager
def receiver(name: str, port: int, path: Path) -> Iterator[subprocess.Popen[str]]:
    """The process that receives, ready to."""
    gcs, url = str(Path(sys.executable).with_name("gcs")), f"udpin:127.0.0.1:{port}"
    command = {
        RECORD: [gcs, "record", "--connect", url, "-o", str(path)],
        SERVE: [gcs, "serve", "--connect", url, "--data", str(path), "--port", "0"],
        PEER: [sys.executable, str(HERE / "udp_peer.py"), str(port), str(path)],
    }[name]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert process.stdout is not None
        if name == RECORD:
            while not path.exists() and process.poll() is None:
                time.sleep(0.05)
        else:
            process.stdout.readline()
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()


def settled(process: int) -> float:
    """CPU time once the process has nothing left to do."""
    used = cpu_seconds(process)
    while True:
        time.sleep(0.3)
        now = cpu_seconds(process)
        if now - used < 0.05:
            return now
        used = now


def measure(name: str, rate: float, seconds: float, sender: Path, data: Path, folder: Path) -> Run:
    """Send `rate` datagrams per second to a new receiver and count what comes out of it."""
    port, count = free_port(), round(rate * seconds)
    with tempfile.TemporaryDirectory(dir=folder) as own, receiver(name, port, Path(own) / "udp.mcap") as process:
        send(sender, port, 2000, WARM_UP, 0, data)
        before = settled(process.pid)
        took = send(sender, port, rate, count, WARM_UP, data)
        used = settled(process.pid) - before
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=120)
        received = recorded(name, Path(own)) - WARM_UP
    return Run(count, received, 1e6 * used / max(received, 1), took)


def recorded(name: str, folder: Path) -> int:
    """Messages in the files that a receiver left."""
    files = list(folder.rglob("*.mcap"))
    if name != PEER:
        return sum(sum(Recording(path).counts().values()) for path in files if path.is_file())
    with files[0].open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    return summary.statistics.message_count


def compare_cpu(rate: float, seconds: float, rounds: int, sender: Path, data: Path, folder: Path) -> None:
    """CPU per datagram of each, forward and backward in turn, and the median of the rounds' ratios."""
    runs: dict[str, list[Run]] = {PEER: [], RECORD: [], SERVE: []}
    for turn in range(rounds):
        for name in list(runs)[:: 1 if turn % 2 == 0 else -1]:
            runs[name].append(measure(name, rate, seconds, sender, data, folder))
    print(f"{rate:,.0f} datagrams/s for {seconds:g} s, {rounds} rounds")
    for name, results in runs.items():
        ratios = [peer.cpu_us / own.cpu_us for peer, own in zip(runs[PEER], results, strict=True)]
        cpu = statistics.median(run.cpu_us for run in results)
        lost = [f"{1 - run.received / run.sent:.2%}" for run in results]
        print(f"  {name:24s} {cpu:8.2f} us/datagram {statistics.median(ratios):7.1f} x   lost {' '.join(lost)}")


def loss(rate: float, seconds: float, sender: Path, data: Path, folder: Path) -> None:
    """What is lost at a rate."""
    run = measure(RECORD, rate, seconds, sender, data, folder)
    print(
        f"{rate:,.0f} datagrams/s for {seconds:g} s: sent {run.sent:,d} at {run.sent / run.seconds:,.0f}/s,"
        f" lost {run.sent - run.received:,d}, {run.cpu_us:.2f} us/datagram"
    )


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rates", default="410,60000", help="datagrams per second, with commas")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each run")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--loss-rate", default="100000", help="datagrams per second, with commas; empty for none")
    parser.add_argument("--loss-seconds", type=float, default=60.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="udp-") as name:
        folder = Path(name)
        sender, data = build_sender(folder), folder / "datagrams"
        write_frames(data, vehicle_frames())
        for rate in filter(None, arguments.rates.split(",")):
            compare_cpu(float(rate), arguments.seconds, arguments.rounds, sender, data, folder)
        for rate in filter(None, arguments.loss_rate.split(",")):
            loss(float(rate), arguments.loss_seconds, sender, data, folder)


if __name__ == "__main__":
    main()
