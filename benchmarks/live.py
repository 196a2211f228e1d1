"""Live identification in the service: its share of a core, and how old an estimate is when it is told.

Run: python benchmarks/live.py [--seconds 60] [--warm-up 12]

`sim-vehicle` flies multisines in real time and sends its telemetry, every message at 50 Hz, over UDP to `gcs serve`
with a vehicle file. CPU is what the kernel accounts to the live process between the end of the warm-up and that of the
flight. Latency is told by the service: of every datagram with a message that an estimate can hold, from the kernel's
time of its arrival to the first finished estimate that holds it. Its median over the last ten seconds is asked for all
along, and the median of these is printed. The load average says how much else the machine did.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sender import cpu_seconds, free_port

_READY_S = 300.0  # the first start of an installation compiles


def ask(url: str) -> Any:
    """JSON of a GET."""
    with urllib.request.urlopen(url, timeout=60) as answer:
        return json.load(answer)


def events(url: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Server-sent events: name and data."""
    with urllib.request.urlopen(url, timeout=60) as answer:
        name = ""
        for line in answer:
            field, _, rest = line.decode().strip().partition(": ")
            if field == "event":
                name = rest
            elif field == "data":
                yield name, json.loads(rest)


@contextmanager
def service(port: int, data: Path) -> Iterator[tuple[int, str]]:
    """`gcs serve`: its process id and its address, once its live process is ready."""
    command = [sys.executable, "-m", "gcs", "serve", "--connect", f"udpin:127.0.0.1:{port}", "--vehicle", "iitb-mav"]
    command += ["--no-identify", "--data", str(data), "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert process.stdout is not None
        url = process.stdout.readline().split()[-1]
        end = time.monotonic() + _READY_S
        while ask(f"{url}/api/live")["process"]["state"] != "running":
            if time.monotonic() > end:
                sys.exit("the live process did not become ready")
            time.sleep(0.2)
        yield process.pid, url
    finally:
        process.terminate()
        process.wait(timeout=60)


def live_process(service_id: int) -> int:
    """The service's child that identifies."""
    for children in Path(f"/proc/{service_id}/task").glob("*/children"):
        for child in children.read_text().split():
            if "gcs.live.worker" in Path(f"/proc/{child}/cmdline").read_text():
                return int(child)
    sys.exit("the service has no live process")


def flown(seconds: float, warm_up: float) -> None:
    """One flight, and what it showed."""
    port = free_port()
    with tempfile.TemporaryDirectory(prefix="live-") as folder, service(port, Path(folder)) as (process, url):
        worker = live_process(process)
        fly = [sys.executable, "-m", "sim_vehicle", "fly", "--manoeuvre", "multisine", "--seed", "3"]
        fly += ["--duration", str(seconds + warm_up), "--out", f"udpout:127.0.0.1:{port}"]
        vehicle = subprocess.Popen(fly, stdout=subprocess.DEVNULL)
        latencies: list[dict[str, float]] = []
        rates: list[float] = []
        used = used_all = begun = time_s = 0.0
        for kind, told in events(f"{url}/api/live/stream"):
            time_s = told.get("time_s") or time_s
            if kind == "state" and told["state"] == "lost":
                break
            if kind == "estimate" and time_s > warm_up:
                if not begun:
                    used, used_all, begun = cpu_seconds(worker), cpu_seconds(process), time.monotonic()
                latencies.append(told["latency_ms"])
                rates.append(told["updates_per_s"])
                ended, share, ended_all = time.monotonic(), cpu_seconds(worker), cpu_seconds(process)
        vehicle.wait()
        load, end = os.getloadavg()[0], ask(f"{url}/api/live")
    span = ended - begun
    median, tail = (statistics.median(told[name] for told in latencies) for name in ("median", "p95"))
    own = 100.0 * (ended_all - used_all) / span
    print(f"CPU of the live process        {100.0 * (share - used) / span:.1f} % of a core over {span:.0f} s")
    print(f"CPU of the service beside it   {own:.1f} % of a core")
    print(f"latency, datagram to estimate  {median:.0f} ms median of all, 95 % below {tail:.0f} ms")
    print(f"estimates made                 {statistics.median(rates):.1f}/s")
    print(f"reports told                   {len(latencies) / span:.1f}/s")
    print(f"not taken by the live process  {end['process']['dropped_bytes']} bytes")
    print(f"load average of the machine    {load:.1f} on {os.cpu_count()} processors")


def main() -> None:
    """Parse and fly."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="measured (60)")
    parser.add_argument("--warm-up", type=float, default=12.0, help="of flight before it counts (12)")
    arguments = parser.parse_args()
    flown(arguments.seconds, arguments.warm_up)


if __name__ == "__main__":
    main()
