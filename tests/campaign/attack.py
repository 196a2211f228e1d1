"""Attacks on a service that records an honest vehicle, on this machine alone: what they cost. Prints its table.

Run: python tests/campaign/attack.py [--seconds 15] [--only NAME] [--output FOLDER]
For each attack a service of its own records a vehicle at 500 messages a second, and is asked for its health four times
a second. What has been tried stays in the output folder; a further run goes on from there. Wrong is: a message of the
vehicle lost, health slower than 1 s, more than 600 MB resident in the service, a worker beyond its memory, an answer of
5xx but 503 and 507, a log of more than 10 MB a minute, an end that SIGTERM does not bring within 10 s.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import json
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import httpx
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from processes import free_port, start  # noqa: E402
from traffic import SECOND, Vehicle, ground_station_heartbeat  # noqa: E402

from gcs.jobs.limits import memory_limit  # noqa: E402
from gcs.links.datagrams import Batch  # noqa: E402
from gcs.mavlink.dialect import Dialect  # noqa: E402
from gcs.recording.parts import Provenance  # noqa: E402
from gcs.recording.reader import Recording  # noqa: E402
from gcs.recording.storage import StorageOptions  # noqa: E402
from gcs.station.capture import Capture  # noqa: E402

RATE = 500
ALLOWED = {"lost": 0, "health_s": 1.0, "service_mb": 600.0, "log_mb_min": 10.0, "end_s": 10.0}
EXPECTED_5XX = (503, 507)
_JSON = {"Content-Type": "application/json"}


@dataclass
class Outcome:
    """What one attack cost. lost: messages of the honest vehicle. wrong: in words."""

    attack: str
    sent: int = 0
    lost: int = 0
    flights: int = 0
    jobs: int = 0
    health_s: float = 0.0
    service_mb: float = 0.0
    worker_mb: float = 0.0
    log_mb_min: float = 0.0
    end_s: float = 0.0
    answers: dict[str, int] = field(default_factory=dict)
    note: str = ""
    wrong: list[str] = field(default_factory=list)


class Target:
    """A service under attack, the honest vehicle beside it, and what is measured."""

    def __init__(self, folder: Path, seconds: float) -> None:
        self.folder, self.seconds = folder, seconds
        self.udp, self.forward = free_port(), free_port()
        self.url, self.process = "", 0
        self.answers: Counter[str] = Counter()
        self.note = ""
        self.stopping = threading.Event()
        self.flight = ""

    @property
    def address(self) -> tuple[str, int]:
        parsed = httpx.URL(self.url)
        return parsed.host, int(parsed.port or 0)

    def ask(self, method: str, path: str, **given: Any) -> int:
        """One request; its status, which is counted. 0 where the connection broke."""
        try:
            status = httpx.request(method, self.url + path, timeout=60.0, **given).status_code
        except httpx.HTTPError:
            status = 0
        self.answers[str(status)] += 1
        return status

    def until_over(self, pause_s: float = 0.0) -> Iterator[float]:
        """Seconds since the attack began, again and again until its time is over."""
        began = time.monotonic()
        while (passed := time.monotonic() - began) < self.seconds and not self.stopping.is_set():
            yield passed
            time.sleep(pause_s)

    @contextmanager
    def udp_socket(self, port: int | None = None) -> Iterator[socket.socket]:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.connect(("127.0.0.1", port or self.udp))
            yield sock

    def upload(self, path: Path) -> int:
        return self.ask("POST", f"/api/flights?name={path.name}", content=path.read_bytes())

    def flown(self) -> str:
        """A simulated flight that was uploaded; its id."""
        path = self.folder / "flown.mcap"
        fly = ["fly", "--vehicle", "iitb-mav", "--manoeuvre", "elevator-3211", "--seed", 3, "--record", path]
        process = start("sim-vehicle", fly)
        process.communicate(timeout=300)
        answer = httpx.post(f"{self.url}/api/flights?name=flown.mcap", content=path.read_bytes(), timeout=120.0)
        return str(answer.raise_for_status().json()["id"])


# The attacks.


def nothing(target: Target) -> None:
    """No attack."""
    for _ in target.until_over(0.5):
        pass


def idle_connections(target: Target) -> None:
    """1,100 TCP connections that say nothing."""
    with ExitStack() as held:
        for number in range(1100):
            with contextlib.suppress(OSError):
                held.enter_context(socket.create_connection(target.address, timeout=5.0))
            target.answers["connections"] = number + 1
        for _ in target.until_over(0.5):
            pass


def slow_headers(target: Target) -> None:
    """200 requests of which a byte comes each second."""
    with ExitStack() as held:
        socks = []
        for _ in range(200):
            with contextlib.suppress(OSError):
                socks.append(held.enter_context(socket.create_connection(target.address, timeout=5.0)))
        request = b"GET /api/flights HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + b"y" * 1000
        for passed in target.until_over(1.0):
            for sock in socks:
                with contextlib.suppress(OSError):
                    sock.send(request[int(passed) : int(passed) + 1])


def streams_of_events(target: Target) -> None:
    """300 clients of the stream of events that read nothing."""
    with ExitStack() as held:
        for _ in range(300):
            with contextlib.suppress(OSError):
                sock = held.enter_context(socket.create_connection(target.address, timeout=5.0))
                sock.sendall(b"GET /api/live/stream HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        for _ in target.until_over(0.5):
            pass


def unread_answers(target: Target) -> None:
    """300 clients that ask for a recording of 14 MB and do not read it."""
    path = target.folder / "large.mcap"
    dense_recording(path, 800_000)
    answer = httpx.post(f"{target.url}/api/flights?name=large.mcap", content=path.read_bytes(), timeout=120.0)
    flight = answer.raise_for_status().json()["id"]
    with ExitStack() as held:
        for _ in range(300):
            with contextlib.suppress(OSError):
                sock = held.enter_context(socket.create_connection(target.address, timeout=5.0))
                sock.sendall(f"GET /api/flights/{flight}/recording HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
        for _ in target.until_over(0.5):
            pass


def clock_ahead(target: Target) -> None:
    """Telemetry of another system whose clock jumps an hour ahead with each message."""
    forged = Vehicle(9)
    with target.udp_socket() as sock:
        for _ in target.until_over(0.02):
            forged.boot_ms = (forged.boot_ms + 3_600_000) % 2**32
            sock.send(forged.heartbeat() + forged.attitude() + forged.system_time())
    target.stopping.wait(15.0)  # the flight ends, and its job begins


def foreign_clock(rate_hz: float) -> Callable[[Target], None]:
    """Datagrams in the honest vehicle's name with a clock of their own."""

    def attack(target: Target) -> None:
        forged = Vehicle(1)
        with target.udp_socket() as sock:
            for number, _ in enumerate(target.until_over(1.0 / rate_hz)):
                forged.boot_ms = 5_000 + 700_000 * (number % 2)
                sock.send(forged.attitude() + forged.heartbeat())
        target.stopping.wait(5.0)

    return attack


def many_systems(target: Target) -> None:
    """Heartbeats of 255 systems and all their components."""
    with target.udp_socket() as sock:
        for number, _ in enumerate(target.until_over(0.002)):
            sender = Vehicle(1 + number % 255, 1 + number // 255 % 255)
            sock.send(sender.heartbeat() + sender.attitude())


def noise(target: Target) -> None:
    """Random bytes from 40 ports, as fast as one process sends them."""
    random = np.random.default_rng(1)
    with ExitStack() as held:
        socks = [held.enter_context(target.udp_socket()) for _ in range(40)]
        pieces = [random.bytes(300) for _ in range(200)]
        for number, _ in enumerate(target.until_over(0.0005)):
            with contextlib.suppress(OSError):
                socks[number % 40].send(pieces[number % 200])


def forward_copies(target: Target) -> None:
    """All 256 frames that an operator's command could be, from the vehicles' side; then the operator's own."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    def command(seq: int) -> bytes:
        sender = Vehicle(255, 190)
        sender.mav.seq = seq
        return sender.frame(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))

    with target.udp_socket() as vehicles_side, target.udp_socket(target.forward) as operator:
        vehicles_side.send(Vehicle(1).heartbeat())
        operator.send(ground_station_heartbeat())
        for seq in range(256):
            vehicles_side.send(command(seq))
            time.sleep(0.002)
        time.sleep(1.0)
        vehicles_side.setblocking(False)
        _drain(vehicles_side)
        operator.send(command(77))
        time.sleep(1.0)
        target.note = "the operator's command arrives" if command(77) in _drain(vehicles_side) else "command kept away"
    for _ in target.until_over(0.5):
        pass


def commands_from_anywhere(target: Target) -> None:
    """A command to a forward link that others can reach."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    arm = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    with target.udp_socket() as vehicle, target.udp_socket(target.forward + 1) as stranger:
        vehicle.setblocking(False)
        got = b""
        for _ in target.until_over(0.1):
            vehicle.send(Vehicle(1).heartbeat())
            stranger.send(Vehicle(255, 190).frame(arm))
            got += b"".join(_drain(vehicle))
        target.note = "a stranger commands" if b"\x4c\x00\x00" in got else "no command of a stranger arrives"


def _drain(sock: socket.socket) -> list[bytes]:
    found = []
    with contextlib.suppress(OSError):
        while True:
            found.append(sock.recv(65536))
    return found


def dense_recording(path: Path, messages: int) -> None:
    """A recording of so many messages that hold little, which take far more memory than room on the disk."""
    vehicle, begin = Vehicle(1), 1_800_000_000 * SECOND
    frames = b"".join(vehicle.heartbeat() + b"".join(vehicle.attitude() for _ in range(99)) for _ in range(200))
    capture = Capture(path, Dialect.load(), StorageOptions(), Provenance(), begin)
    for number in range(messages // 20_000):
        capture.take("dense", Batch.of([(frames, begin + number * SECOND // 100)]))
    capture.close(begin + 5 * SECOND)


def bomb(target: Target) -> None:
    """A recording of eight million messages, uploaded, looked at and identified."""
    path = target.folder / "bomb.mcap"
    dense_recording(path, 8_000_000)
    target.note = f"{path.stat().st_size / 1e6:.0f} MB"
    target.upload(path)
    for flight in httpx.get(f"{target.url}/api/flights", timeout=60.0).json()["flights"]:
        target.ask("GET", f"/api/flights/{flight['id']}")
        target.ask("GET", f"/api/flights/{flight['id']}/signals?names=phi")
        target.ask("POST", f"/api/flights/{flight['id']}/jobs", json={"kind": "identify"})
    for _ in target.until_over(0.5):
        pass


def crowd(target: Target) -> None:
    """60 reports, 45 times one signal named 1,000 times, and 60 flights asked for, all at once."""
    flight = target.flown()
    job = httpx.post(f"{target.url}/api/flights/{flight}/jobs", json={"kind": "identify"}, timeout=60.0).json()
    deadline = time.monotonic() + 180.0
    while httpx.get(f"{target.url}/api/jobs/{job['id']}", timeout=60.0).json()["state"] in ("queued", "running"):
        assert time.monotonic() < deadline
        time.sleep(0.5)
    often = ",".join(["phi"] * 1000)
    of_flight = ["/report"] * 60 + [f"/signals?names={often}"] * 45 + [""] * 60
    paths = [f"/api/flights/{flight}{ending}" for ending in of_flight]
    # In processes of their own, so that who asks for health waits for none of them.
    with ProcessPoolExecutor(3) as processes:
        for statuses in processes.map(_ask_at_once, [target.url] * 3, [paths[start::3] for start in range(3)]):
            target.answers.update(statuses)


def _ask_at_once(url: str, paths: list[str]) -> list[str]:
    """The statuses of requests that all go out at once."""

    with ThreadPoolExecutor(len(paths)) as pool:
        return list(pool.map(lambda path: str(_status(url, path, 120.0)), paths))


def _status(url: str, path: str, timeout_s: float) -> int:
    """The status of a request over a connection of its own, 0 where that breaks; costs the machine next to nothing."""
    address = httpx.URL(url)
    connection = http.client.HTTPConnection(address.host, address.port, timeout=timeout_s)
    try:
        connection.request("GET", path)
        answer = connection.getresponse()
        answer.read()
        return answer.status
    except (OSError, http.client.HTTPException):
        return 0
    finally:
        connection.close()


def large_bodies(target: Target) -> None:
    """JSON of 400 MB, and an upload that says it has 100 GB."""
    flight = target.flown()

    def body() -> Iterator[bytes]:
        yield b'{"kind": "identify", "validate": ["'
        for _ in range(400):
            yield b"x" * 1_000_000
        yield b'"]}'

    for _ in range(3):
        target.ask("POST", f"/api/flights/{flight}/jobs", content=body(), headers=_JSON)
    with socket.create_connection(target.address, timeout=30.0) as sock:
        head = b"POST /api/flights?name=a.bin HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 100000000000\r\n\r\n"
        sock.sendall(head + b"x")
        target.answers[sock.recv(100).split()[1].decode()] += 1


def many_jobs(target: Target) -> None:
    """600 jobs."""
    path = f"/api/flights/{target.flown()}/jobs"
    with ThreadPoolExecutor(20) as pool:
        list(pool.map(lambda _: target.ask("POST", path, json={"kind": "identify"}), range(600)))


def malformed(target: Target) -> None:
    """Hosts, forms, JSON and queries that are none."""
    flight = target.flown()
    kinds: list[tuple[str, str, dict[str, Any]]] = [
        ("GET", "/api/flights", {"headers": {"Host": "["}}),
        ("POST", "/api/flights", {"content": b"none", "headers": {"Content-Type": "multipart/form-data; boundary=x"}}),
        ("POST", "/api/flights?name=x.bin", {"content": b"\xff" * 5000}),
        (
            "POST",
            f"/api/flights/{flight}/jobs",
            {"content": b"[" * 100_000, "headers": _JSON},
        ),
        ("POST", f"/api/flights/{flight}/jobs", {"json": {"kind": "identify", "from": 1e308}}),
        ("GET", f"/api/flights/{flight}/signals?names=phi&start=nan&end=1e999", {}),
        ("GET", "/api/flights?after=" + "x" * 5000, {}),
        ("GET", "/api/flights/..%2f..%2fetc%2fpasswd/recording", {}),
        ("DELETE", "/api/jobs/%00", {}),
    ]
    for _ in target.until_over(0.0):
        for method, path, given in kinds:
            target.ask(method, path, **given)


ATTACKS: dict[str, Callable[[Target], None]] = {
    "none": nothing,
    "idle-connections": idle_connections,
    "slow-headers": slow_headers,
    "event-streams": streams_of_events,
    "unread-answers": unread_answers,
    "clock-ahead": clock_ahead,
    "foreign-clock-1Hz": foreign_clock(1.0),
    "foreign-clock-50Hz": foreign_clock(50.0),
    "255-systems": many_systems,
    "noise": noise,
    "forward-copies": forward_copies,
    "forward-stranger": commands_from_anywhere,
    "bomb": bomb,
    "crowd": crowd,
    "large-bodies": large_bodies,
    "600-jobs": many_jobs,
    "malformed": malformed,
}


def run(name: str, seconds: float) -> Outcome:
    """One attack from start to end."""
    outcome = Outcome(name)
    with tempfile.TemporaryDirectory(prefix=f"attack-{name}-") as made:
        folder = Path(made)
        target = Target(folder, seconds)
        log = folder / "log"
        arguments = ["serve", "--port", 0, "--data", folder / "data", "--vehicle", "iitb-mav",
                     "--connect", f"udpin:127.0.0.1:{target.udp}",
                     "--forward", f"udpin:127.0.0.1:{target.forward}",
                     "--forward", f"udpin:0.0.0.0:{target.forward + 1}"]  # fmt: skip
        with log.open("w") as stderr:
            process = subprocess.Popen(
                [str(Path(sys.executable).with_name("gcs")), *map(str, arguments)],
                stdout=subprocess.PIPE, stderr=stderr, text=True,
            )  # fmt: skip
            assert process.stdout is not None
            target.url, target.process = process.stdout.readline().split()[-1], process.pid
            sender = subprocess.Popen(
                [sys.executable, str(ROOT / "tests/support/numbered_sender.py"), str(target.udp), str(RATE)],
                stdout=subprocess.DEVNULL,
            )
            watcher = threading.Thread(target=_watch, args=(target, outcome))
            began = time.monotonic()
            try:
                time.sleep(1.0)
                watcher.start()
                ATTACKS[name](target)
            finally:
                time.sleep(1.0)
                lasted = time.monotonic() - began
                with contextlib.suppress(httpx.HTTPError):
                    known = httpx.get(f"{target.url}/api/flights?limit=1000", timeout=30.0).json()
                    outcome.flights = len(known["flights"])
                target.stopping.set()
                watcher.join()
                sender.kill()
                sender.wait()
                time.sleep(0.5)
                process.terminate()
                asked = time.monotonic()
                try:
                    process.wait(60.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
                outcome.end_s = time.monotonic() - asked
        outcome.log_mb_min = log.stat().st_size / 1e6 / max(lasted / 60.0, 0.2)
        outcome.sent, outcome.lost = _honest(folder / "data" / "flights")
        outcome.jobs = _jobs(folder / "data" / "catalogue.sqlite")
        outcome.answers, outcome.note = dict(target.answers), target.note
    outcome.wrong = _wrong(outcome)
    return outcome


def _watch(target: Target, outcome: Outcome) -> None:
    """Ask for health and look at memory until the attack is over."""
    while not target.stopping.wait(0.25):
        asked = time.monotonic()
        status = _status(target.url, "/api/health", 30.0)
        if status != 200:
            outcome.health_s = max(outcome.health_s, 30.0)
        outcome.health_s = max(outcome.health_s, time.monotonic() - asked)
        for process, command, resident in _family(target.process):
            if process == target.process:
                outcome.service_mb = max(outcome.service_mb, resident)
            elif "gcs.jobs" in command:
                outcome.worker_mb = max(outcome.worker_mb, resident)


def _family(root: int) -> Iterator[tuple[int, str, float]]:
    """A process and its children: number, command, resident MB."""
    for status in Path("/proc").glob("[0-9]*/status"):
        with contextlib.suppress(OSError, ValueError):
            lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
            number = int(status.parent.name)
            if number == root or int(lines["PPid"]) == root:
                command = (status.parent / "cmdline").read_bytes().replace(b"\0", b" ").decode()
                yield number, command, int(lines.get("VmRSS", "0 kB").split()[0]) / 1024.0


def _honest(flights: Path) -> tuple[int, int]:
    """Messages of the honest vehicle that the recordings hold, and how many are missing between them."""
    numbers: set[int] = set()
    for path in flights.glob("*.mcap"):
        with contextlib.suppress(Exception):
            for columns in Recording(path).columns("PING"):
                if columns.system == 1:
                    numbers |= set(columns["seq"].tolist())
    return len(numbers), (max(numbers) + 1 - len(numbers)) if numbers else 10**9


def _jobs(database: Path) -> int:
    import sqlite3

    with contextlib.closing(sqlite3.connect(database)) as db:
        return int(db.execute("SELECT count(*) FROM jobs").fetchone()[0])


def _wrong(outcome: Outcome) -> list[str]:
    """What of an outcome is beyond what is allowed."""
    figures = asdict(outcome)
    wrong = [f"{name} {figures[name]:.3g} (allowed {most:g})" for name, most in ALLOWED.items() if figures[name] > most]
    if outcome.worker_mb > memory_limit() / 1e6 * 1.1:
        wrong.append(f"a worker of {outcome.worker_mb:.0f} MB")
    bad = {code: n for code, n in outcome.answers.items() if code.startswith("5") and int(code) not in EXPECTED_5XX}
    if bad:
        wrong.append(f"answers {bad}")
    if outcome.note in ("command kept away", "a stranger commands"):
        wrong.append(outcome.note)
    return wrong


def table(outcomes: list[Outcome]) -> str:
    """The outcomes as text."""
    head = "attack               sent  lost  flights jobs  health s  service MB  worker MB  log MB/min  end s  answers"
    rows = [
        f"{one.attack:18s} {one.sent:6d} {one.lost:5d} {one.flights:8d} {one.jobs:4d} {one.health_s:9.2f}"
        f" {one.service_mb:11.0f} {one.worker_mb:10.0f} {one.log_mb_min:11.3f} {one.end_s:6.1f}"
        f"  {' '.join(f'{code}:{n}' for code, n in sorted(one.answers.items()))} {one.note}"
        f"{'  WRONG: ' + '; '.join(one.wrong) if one.wrong else ''}"
        for one in outcomes
    ]
    return "\n".join([head, *rows])


def main() -> int:
    """1 if something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=15.0, help="how long an attack goes on (15)")
    parser.add_argument("--only", choices=ATTACKS, action="append", help="this attack alone; repeatable")
    parser.add_argument("--output", type=Path, default=ROOT / "campaign-output" / "attack")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    outcomes = []
    for name in arguments.only or ATTACKS:
        kept = arguments.output / f"{name}.json"
        if kept.exists() and not arguments.only:
            outcomes.append(Outcome(**json.loads(kept.read_text())))
            continue
        outcomes.append(run(name, arguments.seconds))
        kept.write_text(json.dumps(asdict(outcomes[-1])))
        print(table(outcomes[-1:]).splitlines()[1], file=sys.stderr, flush=True)
    print(table(outcomes))
    return 1 if any(one.wrong for one in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
