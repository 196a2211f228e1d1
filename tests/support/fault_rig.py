"""What a fault is tried on: a service that can be killed and started again, and what must hold afterwards."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
from processes import run

LONGEST_S = 300.0


@dataclass(frozen=True)
class Outcome:
    """One trial. what: what was seen. wrong: empty where nothing was."""

    fault: str
    seed: int
    what: str
    wrong: str = ""


class Served:
    """`gcs serve` on a data folder, which can be killed and started again."""

    def __init__(self, data: Path, *options: object) -> None:
        self._command = [str(Path(sys.executable).with_name("gcs")), "serve", "--port", "0", "--data", str(data),
                         *map(str, options)]  # fmt: skip
        self.url, self.error = "", ""
        self.begin()

    def begin(self) -> None:
        self._process = subprocess.Popen(self._command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line.startswith("serving on "):
            self.error = self._process.communicate()[1]
            raise RuntimeError(f"the service does not start: {self.error}")
        self.url = line.split()[-1]
        threading.Thread(target=self._process.stderr.read, daemon=True).start()  # type: ignore[union-attr]

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()

    def stop(self) -> None:
        self._process.send_signal(signal.SIGTERM)
        self._process.wait(60.0)

    def get(self, path: str) -> Any:
        return httpx.get(self.url + path, timeout=60.0).raise_for_status().json()


def wait_for(probe: Callable[[], Any], what: str) -> Any:
    """The first true answer of `probe`; RuntimeError when none comes in time."""
    deadline = time.monotonic() + LONGEST_S
    while not (answer := probe()):
        if time.monotonic() > deadline:
            raise RuntimeError(f"waited in vain for {what}")
        time.sleep(0.1)
    return answer


def flown(folder: Path) -> bytes:
    """A simulated flight as a recording."""
    path = folder / "flown.mcap"
    if not path.exists():
        done = run("sim-vehicle", "fly", "--manoeuvre", "elevator-3211", "--seed", 3, "--record", path)
        assert done.returncode == 0, done.stderr
    return path.read_bytes()


def upload(url: str, log: bytes) -> str:
    answer = httpx.post(f"{url}/api/flights?name=flown.mcap", content=log, timeout=120.0)
    return str(answer.raise_for_status().json()["id"])


def broken_promises(served: Served, said: dict[str, list[str]]) -> list[str]:
    """What was acknowledged and does not hold."""
    wrong = []
    there = {flight["id"]: flight for flight in served.get("/api/flights?limit=1000")["flights"]}
    for flight in said["flights"]:
        if flight not in there:
            wrong.append(f"flight {flight} is gone")
        elif not httpx.get(f"{served.url}/api/flights/{flight}/recording", timeout=60.0).is_success:
            wrong.append(f"the recording of {flight} is gone")
    half = [name for name, flight in there.items() if flight["state"] == "recording"]
    if half:
        wrong.append(f"still being recorded: {half}")
    for job in said["jobs"]:
        over = wait_for(
            lambda job=job: (view := served.get(f"/api/jobs/{job}"))["state"] not in ("queued", "running") and view,
            f"job {job}",
        )
        if over["state"] == "failed" and not over["error"]:
            wrong.append(f"job {job} failed without a word")
    return wrong
