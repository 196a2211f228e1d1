"""The service under load for minutes, with identification jobs beside it. Run: make campaign NAME=load

A sender in another process gives every message a number and a stamp; the service records them as one flight and
identifies it live, while one identification of an uploaded flight after the other runs. Then nothing may be missing by
the sequence counters, and the service's resident memory must have stayed within 5 MB of its middle since the warm-up.
Options: --help.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent.parent / "benchmarks"))

from sender import build_sender, free_port, send, vehicle_frames, write_frames

from gcs.recording.reader import Recording

BIN = Path(sys.executable).parent
ALLOWED_MB = 5.0


def ask(url: str, body: bytes | None = None, kind: str = "application/json") -> Any:
    """GET, or POST with a body; the JSON of the answer."""
    request = urllib.request.Request(url, data=body, headers={"Content-Type": kind})
    with urllib.request.urlopen(request, timeout=120) as answer:
        return json.load(answer)


@contextmanager
def service(folder: Path, port: int) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`gcs serve` and its address; told to stop at the end, and given time to end well."""
    command = [BIN / "gcs", "serve", "--connect", f"udpin:127.0.0.1:{port}", "--vehicle", "iitb-mav", "--no-identify"]
    process = subprocess.Popen(
        [*map(str, command), "--data", str(folder), "--port", "0"], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        yield process, process.stdout.readline().split()[-1]
        process.terminate()
        process.wait(timeout=120)
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


@dataclass
class Beside:
    """Identifications of one flight, one after the other, in a thread of their own."""

    url: str
    flight: str
    done: int = 0
    failed: list[str] = field(default_factory=list)
    stopping: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        """Go on until `stopping`."""
        while not self.stopping.is_set():
            job = ask(f"{self.url}/api/flights/{self.flight}/jobs", b'{"kind": "identify"}')
            while job["state"] in ("queued", "running") and not self.stopping.wait(0.5):
                job = ask(f"{self.url}/api/jobs/{job['id']}")
            if job["state"] == "done":
                self.done += 1
            elif job["state"] not in ("queued", "running"):
                self.failed.append(str(job))


def resident_mb(process: int) -> float:
    """Resident memory of a process."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024.0
    raise RuntimeError(f"process {process} has no resident memory; it has ended")


def upload(url: str, folder: Path) -> str:
    """Fly the simulator and upload what it recorded; the flight's id."""
    path = folder / "beside.mcap"
    fly = [BIN / "sim-vehicle", "fly", "--manoeuvre", "multisine", "--seed", "7", "--record", path]
    subprocess.run(fly, check=True, capture_output=True)
    flight = ask(f"{url}/api/flights?name=beside.mcap", path.read_bytes(), "application/octet-stream")
    return str(flight["id"])


def under_load(arguments: argparse.Namespace, folder: Path) -> list[str]:
    """Run it, print what was measured, and give what is wrong."""
    port, data, frames = free_port(), folder / "data", folder / "frames"
    program = build_sender(folder)
    write_frames(frames, vehicle_frames())
    count = round(arguments.rate * (arguments.warm_up + arguments.seconds))
    memory: list[tuple[float, float]] = []
    with service(data, port) as (process, url):
        beside = Beside(url, upload(url, folder))
        jobs = threading.Thread(target=beside.run)
        took: list[float] = []
        sender = threading.Thread(target=lambda: took.append(send(program, port, arguments.rate, count, 0, frames)))
        jobs.start()
        start = time.monotonic()
        sender.start()
        while sender.is_alive():
            time.sleep(1.0)
            memory.append((time.monotonic() - start, resident_mb(process.pid)))
            print(f"\r{memory[-1][0]:.0f} s, {memory[-1][1]:.1f} MB", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
        time.sleep(1.0)
        beside.stopping.set()
        jobs.join()
        link = ask(f"{url}/api/links")[0]
        live = ask(f"{url}/api/live")["process"]
        print(f"live process                        {live['state']}, {live['dropped_bytes']:,d} bytes not taken by it")
    return judge(arguments, data, count, took[0], memory, beside, link)


def judge(
    arguments: argparse.Namespace,
    data: Path,
    count: int,
    took: float,
    memory: list[tuple[float, float]],
    beside: Beside,
    link: dict[str, Any],
) -> list[str]:
    """Print the figures; what is wrong with them, in words."""
    files = [path for path in (data / "flights").glob("*.mcap") if "udpin" in "".join(Recording(path).links())]
    recorded = sum(sum(Recording(path).counts().values()) for path in files)
    gaps = sum(lost for path in files for lost in Recording(path).lost().values())
    warm = [value for at, value in memory if at > arguments.warm_up]
    swing = (max(warm) - min(warm)) / 2.0
    print(f"sent                                {count:,d} messages in {took:.1f} s, {count / took:,.0f}/s")
    print(f"recorded                            {recorded:,d} in {len(files)} file(s)")
    print(f"missing by the sequence counters    {gaps:,d}")
    print(f"dropped by the kernel               {link['dropped']:,d}")
    print(f"identifications finished beside it  {beside.done}")
    print(
        f"resident memory after {arguments.warm_up:g} s       "
        f"{min(warm):.1f} to {max(warm):.1f} MB: {sum(warm) / len(warm):.1f} on average, +- {swing:.1f}"
    )
    wrong = []
    if recorded != count or gaps or link["dropped"]:
        wrong.append("messages were lost")
    if swing > ALLOWED_MB:
        wrong.append(f"the memory moved by more than +- {ALLOWED_MB:g} MB")
    if beside.failed or not beside.done:
        wrong.append(f"identifications failed: {beside.failed[:3]}")
    return wrong


def main() -> int:
    """1 if something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=float, default=10_000.0, help="messages per second (10000)")
    parser.add_argument("--seconds", type=float, default=600.0, help="behind the warm-up (600)")
    parser.add_argument("--warm-up", type=float, default=60.0, help="seconds before the memory counts (60)")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="load-") as folder:
        wrong = under_load(arguments, Path(folder))
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
