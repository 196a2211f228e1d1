"""From asking for a program of the service to its end, which has nothing to do: forked, against `python -m`.

    python benchmarks/programs.py [--rounds 9]

Medians of interleaved rounds, by the clock.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time

from gcs.jobs.programs import begin

PROGRAMS = ("gcs.jobs.viewworker", "gcs.jobs.intakeworker", "gcs.jobs.worker", "gcs.jobs.reportworker")


def forked(module: str) -> None:
    with open(os.devnull, "w") as nowhere, begin((sys.executable, "-m", module), nowhere.fileno(), nowhere.fileno()):
        pass


def apart(module: str) -> None:
    subprocess.run([sys.executable, "-m", module], input=b"", capture_output=True, check=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9)
    rounds = parser.parse_args().rounds
    forked(PROGRAMS[0])  # starts what they are forked from
    for module in PROGRAMS:
        taken: dict[str, list[float]] = {"forked": [], "apart": []}
        for _ in range(rounds):
            for way in (forked, apart):
                begun = time.perf_counter()
                way(module)
                taken[way.__name__].append(time.perf_counter() - begun)
        fork, alone = (statistics.median(taken[way]) for way in ("forked", "apart"))
        print(f"{module:24} forked {fork:6.3f} s   python -m {alone:6.2f} s   {alone / fork:5.0f}x", flush=True)


if __name__ == "__main__":
    main()
