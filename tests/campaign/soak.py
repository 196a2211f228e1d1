"""A service for hours: vehicles at ten times real time, pages that look on, jobs. Prints its table.

Run: python tests/campaign/soak.py [--minutes 120] [--vehicles 5] [--speed 10]
Five simulated vehicles fly, land and fly again; three clients follow the stream of events, one looks through the
flights as the page does, one starts an identification a minute. Wrong is: a message lost between the vehicles' counters
and the recordings or dropped by the kernel, resident memory or open descriptors that grow (the mean of the last third
above that of the middle third by more than 5 %), a job that fails, an answer of 5xx but 503.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import json
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import httpx

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from processes import free_port, run, start  # noqa: E402

from gcs.recording.reader import Recording  # noqa: E402

GROWTH = 1.05
SAMPLE_S = 5.0
WARM_UP = 0.1  # of the whole time, in which memory may still come


class Soak:
    """The service, who uses it, and what is measured."""

    def __init__(self, folder: Path, arguments: argparse.Namespace) -> None:
        self._folder, self._arguments = folder, arguments
        self.udp = free_port()
        command = ["serve", "--port", 0, "--data", folder / "data", "--vehicle", "iitb-mav", "--no-identify",
                   "--silence", 3, "--connect", f"udpin:127.0.0.1:{self.udp}"]  # fmt: skip
        self.process = subprocess.Popen(
            [str(Path(sys.executable).with_name("gcs")), *map(str, command)], stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        self.url = self.process.stdout.readline().split()[-1]
        self.over = threading.Event()
        self.samples: list[tuple[float, float, int]] = []
        self.answers: Counter[int] = Counter()
        self.jobs: Counter[str] = Counter()
        self.failures: list[str] = []
        self.flown = 0
        self.dropped = 0

    def fly(self) -> None:
        """Flights of all vehicles, one after the other."""
        while not self.over.is_set():
            seconds = 60.0 * self._arguments.speed
            flight = ["fly", "--vehicle", "iitb-mav", "--manoeuvre", "multisine", "--duration", seconds,
                      "--seed", self.flown, "--speed", self._arguments.speed, "--vehicles", self._arguments.vehicles,
                      "--out", f"udpout:127.0.0.1:{self.udp}"]  # fmt: skip
            with start("sim-vehicle", flight) as simulator:
                while simulator.poll() is None and not self.over.wait(0.5):
                    pass
                simulator.kill()
            self.flown += 1
            self.over.wait(5.0)

    def follow(self) -> None:
        """A client of the stream of events, which comes again when it ends."""
        address = httpx.URL(self.url)
        while not self.over.is_set():
            connection = http.client.HTTPConnection(address.host, address.port, timeout=30.0)
            with contextlib.suppress(OSError, http.client.HTTPException):
                connection.request("GET", "/api/live/stream")
                answer = connection.getresponse()
                until = time.monotonic() + 60.0
                while not self.over.is_set() and time.monotonic() < until and answer.readline():
                    pass
            connection.close()

    def look(self) -> None:
        """What the page asks for."""
        while not self.over.wait(2.0):
            for path in ("/api/health", "/api/links", "/api/live", "/api/live/minute", "/api/flights", "/api/models"):
                self._get(path)
            over = [one for one in self._get("/api/flights")["flights"] if one["state"] != "recording"]
            if over:
                self._get(f"/api/flights/{over[0]['id']}")
                self._get(f"/api/flights/{over[0]['id']}/signals?names=phi,theta,airspeed")

    def work(self) -> None:
        """An identification of one flight a minute."""
        path = self._folder / "flown.mcap"
        run("sim-vehicle", "fly", "--manoeuvre", "multisine", "--seed", 7, "--record", path)
        answer = httpx.post(f"{self.url}/api/flights?name=flown.mcap", content=path.read_bytes(), timeout=120.0)
        flight = answer.raise_for_status().json()["id"]
        while not self.over.wait(60.0 if self.jobs else 1.0):
            begun = httpx.post(f"{self.url}/api/flights/{flight}/jobs", json={"kind": "identify"}, timeout=60.0).json()
            while (job := self._get(f"/api/jobs/{begun['id']}"))["state"] in ("queued", "running"):
                if self.over.wait(1.0):
                    return
            self.jobs[job["state"]] += 1
            if job["state"] != "done":
                self.failures.append(str(job["error"]))

    def _get(self, path: str) -> Any:
        answer = httpx.get(self.url + path, timeout=60.0)
        self.answers[answer.status_code] += 1
        return answer.json()

    def measure(self) -> None:
        """Memory and descriptors, again and again until the time is over."""
        begun, whole = time.monotonic(), 60.0 * self._arguments.minutes
        own = Path(f"/proc/{self.process.pid}")
        while (passed := time.monotonic() - begun) < whole:
            status = dict(line.split(":", 1) for line in (own / "status").read_text().splitlines())
            descriptors = len(list((own / "fd").iterdir()))
            self.samples.append((passed / whole, int(status["VmRSS"].split()[0]) / 1024.0, descriptors))
            own_kb = int(status["RssAnon"].split()[0])
            line = f"{passed:.0f} s, {self.samples[-1][1]:.1f} MB, {own_kb / 1024.0:.1f} MB of its own"
            print(f"\r{line}", end="", file=sys.stderr, flush=True)
            self.over.wait(SAMPLE_S)
        print(file=sys.stderr)

    def grown(self, column: int) -> tuple[float, float]:
        """Means of the middle and of the last third behind the warm-up."""
        late = [sample for sample in self.samples if sample[0] > WARM_UP]
        third = len(late) // 3
        middle, last = late[third : 2 * third], late[2 * third :]
        return statistics.mean(s[column] for s in middle), statistics.mean(s[column] for s in last)

    def stop(self) -> float:
        """End all; how long the service took for it, s."""
        asked = time.monotonic()
        self.process.terminate()
        self.process.wait(60.0)
        return time.monotonic() - asked


def report(soak: Soak, folder: Path, ended_s: float) -> list[str]:
    """Print the figures; what is wrong with them, in words."""
    kept = missing = 0
    for path in (folder / "data" / "flights").glob("*.mcap"):
        recording = Recording(path)
        if recording.links() and "udpin" in "".join(recording.links()):
            kept += sum(recording.counts().values())
            missing += sum(recording.lost().values())
    memory, descriptors = soak.grown(1), soak.grown(2)
    print(f"messages recorded        {kept:,d}")
    print(f"missing by the counters  {missing:,d}")
    print(f"dropped by the kernel    {soak.dropped:,d}")
    print(f"rounds of flights        {soak.flown}")
    print(f"jobs                     {dict(soak.jobs)}")
    print(f"answers                  {dict(soak.answers)}")
    print(f"resident memory, MB      {memory[0]:.1f} in the middle, {memory[1]:.1f} at the end")
    print(f"descriptors              {descriptors[0]:.1f} in the middle, {descriptors[1]:.1f} at the end")
    print(f"end, s                   {ended_s:.1f}")
    wrong = [f"jobs failed: {soak.failures[:3]}"] if soak.failures or not soak.jobs else []
    wrong += [f"{missing} messages are missing"] if missing or soak.dropped else []
    wrong += ["memory grows"] if memory[1] > GROWTH * memory[0] else []
    wrong += ["descriptors grow"] if descriptors[1] > GROWTH * descriptors[0] + 1 else []
    bad = {code: n for code, n in soak.answers.items() if code >= 500 and code != 503}
    return wrong + ([f"answers {bad}"] if bad else [])


def main() -> int:
    """1 if something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--vehicles", type=int, default=5)
    parser.add_argument("--speed", type=float, default=10.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="soak-") as name:
        soak = Soak(Path(name), arguments)
        users = [soak.fly, soak.look, soak.work, soak.follow, soak.follow, soak.follow]
        threads = [threading.Thread(target=user, daemon=True) for user in users]
        for thread in threads:
            thread.start()
        try:
            soak.measure()
            links = httpx.get(f"{soak.url}/api/links", timeout=60.0).json()
            soak.dropped = sum(link["dropped"] for link in links)
        finally:
            soak.over.set()
            for thread in threads:
                thread.join(70.0)
            time.sleep(4.0)
            ended_s = soak.stop()
        wrong = report(soak, Path(name), ended_s)
    for line in wrong:
        print(f"wrong: {line}", file=sys.stderr)
    print(json.dumps({"minutes": arguments.minutes, "wrong": wrong}))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
