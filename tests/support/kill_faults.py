"""Kills of a service at a random moment of something."""

from __future__ import annotations

import random
import tempfile
import threading
import time
from pathlib import Path

import httpx
from fault_rig import Outcome, Served, broken_promises, upload


def kill_while(action: str, seed: int, log: bytes) -> Outcome:
    """Kill the service at a random moment of something, start it again, and look whether what it had said holds."""
    chance = random.Random(f"{action} {seed}")
    said: dict[str, list[str]] = {"flights": [], "jobs": []}
    with tempfile.TemporaryDirectory(prefix="fault-") as name:
        served = Served(Path(name) / "data", "--vehicle", "iitb-mav")
        try:
            said["flights"].append(upload(served.url, log))
            stopping = threading.Event()
            worker = threading.Thread(target=ACTIONS[action], args=(served.url, log, said, stopping))
            worker.start()
            time.sleep(chance.uniform(0.0, 3.0))
            served.kill()
            stopping.set()
            worker.join()
            served.begin()
            wrong = broken_promises(served, said)
            left = [path.name for path in (Path(name) / "data").glob("upload-*")]
            if left:
                wrong.append(f"left behind: {left}")
            what = f"{len(said['flights'])} flights and {len(said['jobs'])} jobs acknowledged"
            return Outcome(f"kill in {action}", seed, what, "; ".join(wrong))
        except RuntimeError as error:
            return Outcome(f"kill in {action}", seed, "", str(error))
        finally:
            served.kill()


def _uploads(url: str, log: bytes, said: dict[str, list[str]], stopping: threading.Event) -> None:
    while not stopping.is_set():
        try:
            said["flights"].append(upload(url, log))
        except httpx.HTTPError:
            return


def _jobs(url: str, log: bytes, said: dict[str, list[str]], stopping: threading.Event) -> None:
    try:
        for _ in range(2):
            path = f"{url}/api/flights/{said['flights'][0]}/jobs"
            answer = httpx.post(path, json={"kind": "identify", "method": "ee"}, timeout=60.0)
            said["jobs"].append(str(answer.raise_for_status().json()["id"]))
    except httpx.HTTPError:
        return


def _reports(url: str, log: bytes, said: dict[str, list[str]], stopping: threading.Event) -> None:
    _jobs(url, log, said, stopping)
    while not stopping.is_set():
        try:
            httpx.get(f"{url}/api/flights/{said['flights'][0]}/report", timeout=60.0)
        except httpx.HTTPError:
            return


def _changes(url: str, log: bytes, said: dict[str, list[str]], stopping: threading.Event) -> None:
    """Delete and restore flights, again and again: what was restored last is there."""
    while not stopping.is_set():
        flight = said["flights"][0]
        try:
            httpx.delete(f"{url}/api/flights/{flight}", timeout=60.0)
            said["flights"] = []
            restored = httpx.post(f"{url}/api/flights/{flight}/restore", timeout=60.0)
            said["flights"] = [flight] if restored.is_success else []
            if not restored.is_success:
                return
        except httpx.HTTPError:
            return


ACTIONS = {"upload": _uploads, "job": _jobs, "report": _reports, "catalogue": _changes}
