"""Crashes of the station under load, files cut off and bits flipped: what they cost. Prints its table.

Run: python tests/campaign/crash.py [--kills 200] [--cuts 1000] [--flips 1000] [--unfinished 300] [--output FOLDER]
What has been tried stays in the output folder; a further run goes on from there. Stations and senders are processes of
their own, forked from one that has all modules loaded, which saves the seconds that two interpreters take to start.
"""

from __future__ import annotations

import argparse
import json
import logging
import multiprocessing
import os
import random
import statistics
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ZEROED = (16, 512, 4096)
sys.path.insert(0, str(ROOT / "tests" / "support"))

import numbered_sender  # noqa: E402
from crash_trials import Fresh, Undamaged, damage_trial, flipped, kill_trial, zeroed  # noqa: E402

import gcs.cli  # noqa: E402
import gcs.serve  # noqa: E402 - loaded for the stations
import gcs.station.capture  # noqa: E402
from gcs.recording.repair import complete  # noqa: E402


class Forked(Fresh):
    """A command in a copy of this process."""

    def __init__(self, arguments: list[object]) -> None:
        read, write = os.pipe()
        process = multiprocessing.get_context("fork").Process(target=_be, args=(list(map(str, arguments)), write))
        process.start()
        os.close(write)
        self._forked = process
        self._stdout = os.fdopen(read)

    def first_line(self) -> str:
        return self._stdout.readline()

    def alive(self) -> bool:
        return self._forked.is_alive()

    def kill(self) -> None:
        self._forked.kill()
        self._forked.join()
        self._stdout.close()


def _be(arguments: list[str], stdout: int) -> None:
    """Be the command: `gcs ...`, or the sender."""
    os.dup2(stdout, 1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    sys.stdout = os.fdopen(1, "w")
    program, *rest = arguments
    if program == "gcs":
        gcs.cli.main(rest)
    else:
        sys.argv = rest
        numbered_sender.main()


def tried(path: Path) -> list[dict[str, object]]:
    """Trials of earlier runs."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def kills(output: Path, count: int) -> list[dict[str, object]]:
    """Kills up to `count`, those of earlier runs included."""
    log = output / "kills.jsonl"
    done = tried(log)
    for seed in range(len(done), count):
        with tempfile.TemporaryDirectory(prefix="crash-") as folder:
            result = kill_trial(seed, Path(folder), begin=Forked).to_json()
        done.append(result)
        with log.open("a") as file:
            file.write(json.dumps(result) + "\n")
        if result["wrong"] or seed % 20 == 19:
            print(f"kill {seed + 1}: {result}", file=sys.stderr, flush=True)
    return done[:count]


def damages(cuts: int, flips: int, unfinished: int) -> dict[str, list[str]]:
    """What was wrong in each trial of each kind of damage, "" where nothing."""
    chance = random.Random(1)
    with tempfile.TemporaryDirectory(prefix="crash-") as name:
        folder = Path(name)
        whole = Undamaged(folder / "whole.mcap")
        trial = folder / "trial.mcap"
        size = len(whole.bytes)
        cut, flip, flip_unfinished, zeros = [], [], [], []
        for _ in range(cuts):
            at = chance.randrange(size)
            cut.append(damage_trial(whole, whole.bytes[:at], whole.expected_after_cut(at), trial, complete))
        for _ in range(flips):
            at, bit = chance.randrange(size), chance.randrange(8)
            damaged = flipped(whole.bytes, at, bit)
            flip.append(damage_trial(whole, damaged, whole.expected_after_damage(at), trial, complete))
        data = whole.unfinished
        for _ in range(unfinished):
            at, bit = chance.randrange(len(data)), chance.randrange(8)
            expected = whole.expected_after_damage(at)
            flip_unfinished.append(damage_trial(whole, flipped(data, at, bit), expected, trial, complete))
        for _ in range(unfinished):
            at, length = chance.randrange(len(data)), chance.choice(ZEROED)
            expected = whole.expected_after_damage(at, length)
            zeros.append(damage_trial(whole, zeroed(data, at, length), expected, trial, complete))
    return {
        "file cut off at a random byte": cut,
        "random bit flipped": flip,
        "random bit flipped in a file without its end": flip_unfinished,
        "random block of zeros in a file without its end": zeros,
    }


def main() -> int:
    """Run the campaign; exit code 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--cuts", type=int, default=1000)
    parser.add_argument("--flips", type=int, default=1000)
    parser.add_argument("--unfinished", type=int, default=300)
    parser.add_argument("--output", type=Path, default=ROOT / "campaign-output" / "crash")
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    logging.getLogger("gcs").setLevel(logging.ERROR)  # that flights are recovered is what is expected here
    damaged = damages(args.cuts, args.flips, args.unfinished)
    killed = kills(args.output, args.kills)
    print("| trial | number | wrong |")
    print("|---|---|---|")
    for trial, results in damaged.items():
        print(f"| {trial} | {len(results)} | {sum(map(bool, results))} |")
    for command in ("record", "serve"):
        of_it = [result for result in killed if result["command"] == command]
        print(f"| `gcs {command}` killed under load | {len(of_it)} | {sum(bool(one['wrong']) for one in of_it)} |")
    missing = sorted(float(str(one["missing_s"])) for one in killed if one["messages"])
    if missing:
        middle, most = statistics.median(missing), missing[-1]
        total = sum(int(str(one["messages"])) for one in killed)
        print(f"\nmissing at the end: median {middle:.2f} s, most {most:.2f} s; {total} messages kept and compared")
    wrong = [
        *(line for results in damaged.values() for line in results if line),
        *(str(one["wrong"]) for one in killed if one["wrong"]),
    ]
    for line in wrong[:20]:
        print(f"wrong: {line}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
