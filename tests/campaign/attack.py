"""Attacks on a service that records an honest vehicle, on this machine alone: what they cost. Prints its table.

Run: python tests/campaign/attack.py [--seconds 15] [--only NAME] [--output FOLDER]
For each attack a service of its own records a vehicle at 500 messages a second (through all at once for five minutes
at 2,000), and is asked for its health four times a second. What has been tried stays in the output folder; a further
run goes on from there. Wrong is: a message of the vehicle lost, health slower than 1 s (all at once: 95 % of it), more
than 600 MB resident in the service, a worker beyond its memory, an answer of 5xx but 503 and 507, a log of more than 10
MB a minute, an end that SIGTERM does not bring within 10 s.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import httpx

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from attacks import ATTACKS as FROM_THE_NETWORK  # noqa: E402
from attacks import Target, status_of  # noqa: E402
from attacks_at_once import ATTACKS_AT_ONCE, LEAST_S  # noqa: E402
from attacks_at_once import RATE as RATE_AT_ONCE  # noqa: E402
from attacks_by_users import ATTACKS_BY_USERS  # noqa: E402

from gcs.jobs.limits import memory_limit  # noqa: E402
from gcs.recording.reader import Recording  # noqa: E402

ATTACKS = {**FROM_THE_NETWORK, **ATTACKS_BY_USERS, **ATTACKS_AT_ONCE}
RATE = 500
ALLOWED = {"lost": 0, "health_s": 1.0, "service_mb": 600.0, "log_mb_min": 10.0, "end_s": 10.0}
EXPECTED_5XX = (503, 507)


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


def run(name: str, seconds: float) -> Outcome:
    """One attack from start to end."""
    outcome, rate = Outcome(name), RATE
    if name in ATTACKS_AT_ONCE:
        seconds, rate = max(seconds, LEAST_S), RATE_AT_ONCE
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
                [sys.executable, str(ROOT / "tests/support/numbered_sender.py"), str(target.udp), str(rate)],
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
                    known = httpx.get(
                        f"{target.url}/api/flights?limit=1000", timeout=30.0, headers=target.headers
                    ).json()
                    outcome.flights = len(known.get("flights", ()))
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
    outcome.wrong = [*_wrong(outcome), *dict.fromkeys(target.wrong)]
    return outcome


def _watch(target: Target, outcome: Outcome) -> None:
    """Ask for health and look at memory until the attack is over."""
    took, unanswered = [], 0
    outcome.health_s = 30.0  # until it is known
    while not target.stopping.wait(0.25):
        asked = time.monotonic()
        status = status_of(target.url, "/api/health", 30.0)
        took.append(time.monotonic() - asked)
        unanswered += status != 200
        for process, command, resident in _family(target.process):
            if process == target.process:
                outcome.service_mb = max(outcome.service_mb, resident)
            elif "gcs.jobs" in command:
                outcome.worker_mb = max(outcome.worker_mb, resident)
    if unanswered:
        target.wrong.append(f"{unanswered} of {len(took)} times no health")
    share = 0.95 if outcome.attack in ATTACKS_AT_ONCE else 1.0
    outcome.health_s = sorted(took)[math.ceil(share * len(took)) - 1] if took else 30.0


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
