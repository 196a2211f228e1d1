"""Attacks on a service from the network, each a function of its target."""

from __future__ import annotations

import contextlib
import http.client
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from processes import free_port, start
from traffic import SECOND, Vehicle, ground_station_heartbeat

from gcs.links.datagrams import Batch
from gcs.mavlink.dialect import Dialect
from gcs.recording.parts import Provenance
from gcs.recording.storage import StorageOptions
from gcs.station.capture import Capture

_FLOOD = 50e6  # bytes a second
_JSON = {"Content-Type": "application/json"}


class Target:
    """A service under attack, the honest vehicle beside it, and what is measured."""

    def __init__(self, folder: Path, seconds: float) -> None:
        self.folder, self.seconds = folder, seconds
        self.udp, self.forward = free_port(), free_port()
        self.url, self.process = "", 0
        self.answers: Counter[str] = Counter()
        self.note = ""
        self.headers: dict[str, str] = {}
        self.wrong: list[str] = []
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

    def expect(self, wanted: int, *statuses: int) -> None:
        """Note what was answered otherwise."""
        if others := sorted({status for status in statuses if status != wanted}):
            self.wrong.append(f"{others} where {wanted} is right")

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
        answer = httpx.post(f"{self.url}/api/flights?name=flown.mcap", content=path.read_bytes(), timeout=120.0,
                            headers=self.headers)  # fmt: skip
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


def flood(target: Target) -> None:
    """Large datagrams of random bytes from four ports, 400 megabits a second of them."""
    with ProcessPoolExecutor(1) as processes:
        ports = processes.submit(_flood, target.udp, target.seconds)
        for _ in target.until_over(0.5):
            pass
        target.note = f"{ports.result() / 1e6:.0f} MB sent"


def _flood(port: int, seconds: float) -> int:
    """Send from four ports for so long; how many bytes."""
    data, sent, began = np.random.default_rng(1).bytes(1400), 0, time.monotonic()
    with ExitStack() as held:
        socks = [held.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(4)]
        while time.monotonic() - began < seconds:
            if sent > _FLOOD * (time.monotonic() - began):
                time.sleep(0.0002)
            for sock in socks:
                with contextlib.suppress(OSError):
                    sent += sock.sendto(data, ("127.0.0.1", port))
    return sent


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
        return list(pool.map(lambda path: str(status_of(url, path, 120.0)), paths))


def status_of(url: str, path: str, timeout_s: float) -> int:
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


def held_bodies(target: Target) -> None:
    """200 bodies of as much JSON as is taken, all but their last byte, which then comes of all at once."""
    for most, parts in ((4_000_000, 33_000), (255_000, 6000), (63_000, 1500)):
        body = b'{"toml": "", "form": {"x": [' + parts * b"{}," + b'{}], "pad": "'
        body += (most - len(body)) * b"x" + b'"}}'
        head = f"POST /api/vehicles/check HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {len(body)}\r\n"
        head += "Content-Type: application/json\r\nConnection: close\r\n\r\n"
        with ExitStack() as held:
            waiting = []
            for _ in range(200):
                one = held.enter_context(socket.create_connection(target.address, timeout=30.0))
                with contextlib.suppress(OSError):
                    one.sendall(head.encode() + body[:-1])
                waiting.append(one)
            for one in waiting:
                with contextlib.suppress(OSError):
                    one.sendall(body[-1:])
            for one in waiting:
                with contextlib.suppress(OSError):
                    target.answers[one.recv(100).split()[1].decode()] += 1


def tiny_chunks(target: Target) -> None:
    """Bodies of a token in chunks of a byte, from 40 connections at a time."""
    head = b"POST /api/login HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\n"
    request = head + 50_000 * b"1\r\n \r\n"

    def send() -> None:
        for _ in target.until_over(0.05):
            with contextlib.suppress(OSError), socket.create_connection(target.address, timeout=20.0) as sock:
                sock.sendall(request)
                sock.recv(100)

    senders = [threading.Thread(target=send) for _ in range(40)]
    for one in senders:
        one.start()
    for one in senders:
        one.join()


def slow_texts(target: Target) -> None:
    """Texts of vehicle files that take long to put a form into."""
    form = {"name": "x", "numbers": {"mass_kg": 1.0}}
    texts = [
        "[zz]\n" + "\n".join(f"a.b.c.d{number} = 1" for number in range(999)),
        "\n".join(f"[a.b.c{number}]" for number in range(7000)),
        "z = [" + 45_000 * "1," + "]",
    ]
    with ThreadPoolExecutor(10) as pool:
        for _ in target.until_over(0.0):
            asked = [pool.submit(target.ask, "POST", "/api/vehicles/check", json={"toml": one, "form": form})
                     for one in texts for _ in range(5)]  # fmt: skip
            for one in asked:
                one.result()


def cancelled_jobs(target: Target) -> None:
    """Jobs with as large a model as is taken, each cancelled for the next; then the flight's summary, 40 at a time."""
    flight = target.flown()
    coefficients = {"CL_0": {"value": 0.25}}
    validity = {f"{number}{185 * 'v'}": [0.0, 1.0] for number in range(1100)}
    model = {"schema": "model/1", "name": "large", "coefficients": coefficients, "effects": [], "validity": validity}
    for _ in target.until_over(0.0):
        asked = {"kind": "identify", "prior": model}
        answer = httpx.post(f"{target.url}/api/flights/{flight}/jobs", json=asked, timeout=60.0)
        target.answers[str(answer.status_code)] += 1
        if answer.status_code == 202:
            target.ask("POST", f"/api/jobs/{answer.json()['id']}/cancel")
    with ThreadPoolExecutor(40) as pool:
        list(pool.map(lambda _: target.ask("GET", f"/api/flights/{flight}"), range(200)))


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
    "flood": flood,
    "forward-copies": forward_copies,
    "forward-stranger": commands_from_anywhere,
    "bomb": bomb,
    "crowd": crowd,
    "large-bodies": large_bodies,
    "600-jobs": many_jobs,
    "malformed": malformed,
    "held-bodies": held_bodies,
    "tiny-chunks": tiny_chunks,
    "slow-texts": slow_texts,
    "cancelled-jobs": cancelled_jobs,
}
