"""Faults of the machine under a service: kills, full and read-only disks, clocks, a damaged catalogue, a bad network.

Run: python tests/campaign/faults.py [--kills 25] [--only NAME] [--output FOLDER]
Kills are of the service while it takes in an upload, runs a job, draws a report or deletes and restores flights (while
it records: crash.py), so many of each; what has been tried stays in the output folder. Wrong is: something acknowledged
that is lost, a job that neither ends nor says why, a service that does not come back, a fault that nobody is told of.
Needs the rights to mount and to make network namespaces; without them the faults of disk and network fail.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import httpx

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from processes import free_port, run  # noqa: E402
from recorder_rig import LINK, Rig  # noqa: E402
from traffic import SECOND, Vehicle  # noqa: E402

from gcs.recording.reader import Recording  # noqa: E402

SENDER = ROOT / "tests" / "support" / "numbered_sender.py"
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


# Kills.


def kill_while(action: str, seed: int, log: bytes) -> Outcome:
    """Kill the service at a random moment of something, start it again, and look whether what it had said holds."""
    chance = random.Random(f"{action} {seed}")
    said: dict[str, list[str]] = {"flights": [], "jobs": []}
    with tempfile.TemporaryDirectory(prefix="fault-") as name:
        served = Served(Path(name) / "data", "--vehicle", "iitb-mav")
        try:
            said["flights"].append(_upload(served.url, log))
            stopping = threading.Event()
            worker = threading.Thread(target=_ACTIONS[action], args=(served.url, log, said, stopping))
            worker.start()
            time.sleep(chance.uniform(0.0, 3.0))
            served.kill()
            stopping.set()
            worker.join()
            served.begin()
            wrong = _broken_promises(served, said)
            left = [path.name for path in (Path(name) / "data").glob("upload-*")]
            if left:
                wrong.append(f"left behind: {left}")
            what = f"{len(said['flights'])} flights and {len(said['jobs'])} jobs acknowledged"
            return Outcome(f"kill in {action}", seed, what, "; ".join(wrong))
        except RuntimeError as error:
            return Outcome(f"kill in {action}", seed, "", str(error))
        finally:
            served.kill()


def _upload(url: str, log: bytes) -> str:
    answer = httpx.post(f"{url}/api/flights?name=flown.mcap", content=log, timeout=120.0)
    return str(answer.raise_for_status().json()["id"])


def _broken_promises(served: Served, said: dict[str, list[str]]) -> list[str]:
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


def _uploads(url: str, log: bytes, said: dict[str, list[str]], stopping: threading.Event) -> None:
    while not stopping.is_set():
        try:
            said["flights"].append(_upload(url, log))
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


_ACTIONS = {"upload": _uploads, "job": _jobs, "report": _reports, "catalogue": _changes}


# The disk.


@contextmanager
def small_disk(options: str) -> Iterator[Path]:
    """A file system in memory."""
    with tempfile.TemporaryDirectory(prefix="fault-") as name:
        subprocess.run(["mount", "-t", "tmpfs", "-o", options, "none", name], check=True)
        try:
            yield Path(name)
        finally:
            subprocess.run(["umount", "--lazy", name], check=True)  # a worker may be about to end


def full_disk(seed: int, log: bytes) -> Outcome:
    """A disk that fills up: uploads are refused in words, what was taken in stays, and there is room again later."""
    with small_disk("size=12m") as folder:
        ballast = folder / "ballast"
        served = Served(folder / "data", "--reserve", "1MB")
        try:
            first = _upload(served.url, log)
            ballast.write_bytes(bytes(shutil.disk_usage(folder).free - 500_000))
            refused = httpx.post(f"{served.url}/api/flights?name=b.mcap", content=log, timeout=60.0)
            wrong = [] if refused.status_code == 507 else [f"an upload on a full disk: {refused.status_code}"]
            ballast.unlink()
            second = _upload(served.url, log)
            wrong += _broken_promises(served, {"flights": [first, second], "jobs": []})
            return Outcome("disk full", seed, refused.json()["detail"], "; ".join(wrong))
        finally:
            served.kill()


def read_only(seed: int, log: bytes) -> Outcome:
    """A disk that takes nothing: said in one line at the start."""
    with small_disk("ro") as folder:
        try:
            Served(folder).kill()
        except RuntimeError as error:
            lines = str(error).strip().splitlines()
            wrong = "" if len(lines) == 1 and "cannot be used" in lines[0] else "not said in one line"
            return Outcome("disk read-only", seed, lines[-1], wrong)
    return Outcome("disk read-only", seed, "", "it started")


# Clocks, the catalogue, the network.


def clock_jumps(seed: int, log: bytes) -> Outcome:
    """This computer's clock set by an hour and a year, forwards and back, while a vehicle is recorded."""
    jumps = [3600, -3600, 31_536_000, -31_536_000]
    with tempfile.TemporaryDirectory(prefix="fault-") as name:
        rig, vehicle = Rig(Path(name)), Vehicle()
        for jump in random.Random(seed).sample(jumps, 4):
            for _ in range(3):
                rig.feed(vehicle.second())
            rig.now += jump * SECOND
        rig.feed(vehicle.second())
        flights = rig.finish()
        kept = sum(flight.messages for flight in flights)
        lost = 13 * 52 - kept
        backwards = [
            flight.id for flight in flights for times in _log_times(rig.folder / flight.file) if times != sorted(times)
        ]
        whole = rig.stream() == rig.sent[LINK] or len(flights) > 1  # pieces are joined by time, which went back
        wrong = [*([f"{lost} messages lost"] if lost else []), *(["times step back"] if backwards else []),
                 *([] if whole else ["bytes differ"])]  # fmt: skip
        return Outcome("clock jumps", seed, f"{len(flights)} recordings, {kept} messages", "; ".join(wrong))


def _log_times(path: Path) -> Iterator[list[int]]:
    from mcap.reader import make_reader

    with path.open("rb") as file:
        yield [message.log_time for _, _, message in make_reader(file).iter_messages(log_time_order=False)]


def damaged_catalogue(seed: int, log: bytes) -> Outcome:
    """Pages of the catalogue overwritten: the service says what to do, and after it every recording is listed."""
    chance = random.Random(seed)
    with tempfile.TemporaryDirectory(prefix="fault-") as name:
        data = Path(name) / "data"
        served = Served(data, "--vehicle", "iitb-mav")
        flights = [_upload(served.url, log) for _ in range(3)]
        served.stop()
        database = data / "catalogue.sqlite"
        content = bytearray(database.read_bytes())
        for _ in range(chance.randint(1, 4)):
            at = 4096 * chance.randrange(len(content) // 4096)
            content[at : at + 4096] = chance.randbytes(4096)
        database.write_bytes(content)
        with contextlib.suppress(RuntimeError):
            served.begin()
            with contextlib.suppress(httpx.HTTPError):
                served.get("/api/flights")
            served.kill()
        repaired = run("gcs", "repair", data)
        if repaired.returncode != 0:
            return Outcome("catalogue damaged", seed, "", repaired.stderr)
        try:
            served.begin()
            wrong = wait_for(lambda: not _broken_promises(served, {"flights": flights, "jobs": []}), "the recordings")
            return Outcome(
                "catalogue damaged", seed, repaired.stdout.splitlines()[0], "" if wrong else "flights are gone"
            )
        except RuntimeError as error:
            return Outcome("catalogue damaged", seed, "", str(error))
        finally:
            served.kill()


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


ONCE: dict[str, Callable[[int, bytes], Outcome]] = {
    "disk-full": full_disk,
    "disk-read-only": read_only,
    "clock": clock_jumps,
    "catalogue": damaged_catalogue,
    "network": bad_network,
}
SEEDS = {"clock": 10, "catalogue": 20}


def trials(kills: int) -> Iterator[tuple[str, int, Callable[[bytes], Outcome]]]:
    """Every trial: name, seed, and how it is run."""
    for action in _ACTIONS:
        for seed in range(kills):
            yield f"kill-{action}", seed, lambda log, a=action, s=seed: kill_while(a, s, log)
    for name, fault in ONCE.items():
        for seed in range(SEEDS.get(name, 1)):
            yield name, seed, lambda log, f=fault, s=seed: f(s, log)


def main() -> int:
    """1 if something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=25, help="of each kind (25)")
    parser.add_argument("--only", help="trials whose name begins so")
    parser.add_argument("--output", type=Path, default=ROOT / "campaign-output" / "faults")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    log = flown(arguments.output)
    kept = arguments.output / "trials.jsonl"
    done = (
        {(one["name"], one["seed"]): one for one in map(json.loads, kept.read_text().splitlines())}
        if kept.exists()
        else {}
    )
    for name, seed, trial in trials(arguments.kills):
        if (name, seed) in done or not name.startswith(arguments.only or ""):
            continue
        try:
            outcome = trial(log)
        except Exception as error:
            outcome = Outcome(name, seed, "", f"{type(error).__name__}: {error}")
        done[name, seed] = {"name": name, **asdict(outcome)}
        with kept.open("a") as file:
            file.write(json.dumps(done[name, seed]) + "\n")
        if outcome.wrong or seed == 0:
            print(f"{name} {seed}: {outcome.what} {outcome.wrong}", file=sys.stderr, flush=True)
    print(f"{'fault':22s} trials  wrong  last seen")
    for name in dict.fromkeys(name for name, _ in done):
        of_it = [one for (other, _), one in done.items() if other == name]
        print(f"{name:22s} {len(of_it):6d} {sum(bool(one['wrong']) for one in of_it):6d}  {of_it[-1]['what']}")
    return 1 if any(one["wrong"] for one in done.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
