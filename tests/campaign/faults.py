"""Faults of the machine under a service: kills, full and read-only disks, clocks, a damaged catalogue, bad lines.

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
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import httpx

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from fault_rig import Outcome, Served, broken_promises, flown, upload, wait_for  # noqa: E402
from kill_faults import ACTIONS, kill_while  # noqa: E402
from line_faults import bad_network, unplugged  # noqa: E402
from processes import run  # noqa: E402
from recorder_rig import LINK, Rig  # noqa: E402
from traffic import SECOND, Vehicle  # noqa: E402

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
            first = upload(served.url, log)
            ballast.write_bytes(bytes(shutil.disk_usage(folder).free - 500_000))
            refused = httpx.post(f"{served.url}/api/flights?name=b.mcap", content=log, timeout=60.0)
            wrong = [] if refused.status_code == 507 else [f"an upload on a full disk: {refused.status_code}"]
            ballast.unlink()
            second = upload(served.url, log)
            wrong += broken_promises(served, {"flights": [first, second], "jobs": []})
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
        flights = [upload(served.url, log) for _ in range(3)]
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
            wrong = wait_for(lambda: not broken_promises(served, {"flights": flights, "jobs": []}), "the recordings")
            return Outcome(
                "catalogue damaged", seed, repaired.stdout.splitlines()[0], "" if wrong else "flights are gone"
            )
        except RuntimeError as error:
            return Outcome("catalogue damaged", seed, "", str(error))
        finally:
            served.kill()


ONCE: dict[str, Callable[[int, bytes], Outcome]] = {
    "disk-full": full_disk,
    "disk-read-only": read_only,
    "clock": clock_jumps,
    "catalogue": damaged_catalogue,
    "network": bad_network,
    "serial": unplugged,
}
SEEDS = {"clock": 10, "catalogue": 20, "network": 3, "serial": 3}


def trials(kills: int) -> Iterator[tuple[str, int, Callable[[bytes], Outcome]]]:
    """Every trial: name, seed, and how it is run."""
    for action in ACTIONS:
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
