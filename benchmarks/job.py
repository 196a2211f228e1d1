"""The post-flight job against the length of the flight that it works on. Run: python benchmarks/job.py

`gcs identify` in a process of its own, from file to result: of a one-minute flight on an empty cache of compiled code
and again on the full one, and of a ten-minute flight. Each ratio is the flight's own length over the time by the clock.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

VEHICLE = "iitb-mav"
FLIGHTS = {"one minute": 60.0, "ten minutes": 600.0}
# What the job says it begins -> stage.
STAGES = {
    "reading": "read", "compiling": "compile", "signals": "time base", "units": "check, compatibility",
    "data": "delay of the commands", "equation": "equation error", "maximum": "output error", "output": "output error",
    "timing": "timing, thrust, bench", "systematic": "systematic", "validation": "validation, linear model",
}  # fmt: skip


def fly(folder: Path, seconds: float) -> Path:
    """A recording of a multisine flight."""
    path = folder / f"{seconds:g}.mcap"
    command = [sys.executable, "-m", "sim_vehicle", "fly", "--vehicle", VEHICLE, "--manoeuvre", "multisine"]
    command += ["--duration", f"{seconds:g}", "--seed", "7", "--record", str(path)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return path


def timed(command: list[str], environment: dict[str, str]) -> tuple[float, float, str]:
    """Seconds by the clock and of CPU time of a process and those that it starts, and what it prints."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - begin, cpu, done.stdout


def identify(flight: Path, environment: dict[str, str]) -> tuple[float, float]:
    """Seconds by the clock and of CPU time that the command takes."""
    seconds, cpu, _ = timed([sys.executable, "-m", "gcs", "identify", str(flight), "--vehicle", VEHICLE], environment)
    return seconds, cpu


def stages(flight: Path) -> None:
    """Print the CPU seconds of each stage of the job on `flight`, as JSON."""
    begin = time.process_time()
    from gcs.analysis.postflight import identify as job

    spent: dict[str, float] = {"start of the program": time.process_time()}
    begin, now = time.process_time(), "read"

    def turn(share: float, text: str) -> None:
        nonlocal begin, now
        spent[now] = spent.get(now, 0.0) + time.process_time() - begin
        begin, now = time.process_time(), STAGES.get(text.split()[0].rstrip(","), now)

    job([flight], Path(VEHICLE), progress=turn)
    turn(1.0, "end")
    print(json.dumps(spent))


def report(name: str, length_s: float, runs: list[tuple[float, float]]) -> None:
    """One line: medians, and how many times shorter than the flight."""
    seconds, cpu = (statistics.median(run[i] for run in runs) for i in range(2))
    print(f"  {name:28s} {seconds:7.1f} s by the clock, {cpu:7.1f} s of CPU, 1/{length_s / seconds:.0f} of the flight")


def main() -> None:
    """Print times, ratios and stages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--no-cold", action="store_true", help="leave out the run on an empty cache")
    parser.add_argument(
        "--stages", metavar="FILE", type=Path, help="print the stages of one run on this flight as JSON"
    )
    arguments = parser.parse_args()
    if arguments.stages:
        stages(arguments.stages)
        return
    with tempfile.TemporaryDirectory() as folder:
        flights = {name: fly(Path(folder), seconds) for name, seconds in FLIGHTS.items()}
        print("gcs identify, from file to result")
        if not arguments.no_cold:
            empty = {**os.environ, "XDG_CACHE_HOME": f"{folder}/cache"}
            report("one minute, empty cache", 60.0, [identify(flights["one minute"], empty)])
        # Python keeps what it compiles beside its sources, unless it is told not to.
        warm = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
        warm["PYTHONPYCACHEPREFIX"] = f"{folder}/bytecode"
        runs: dict[str, list[tuple[float, float]]] = {name: [] for name in flights}
        spent: dict[str, list[dict[str, float]]] = {name: [] for name in flights}
        for turn in range(arguments.rounds + 1):
            for name, path in flights.items():
                run = identify(path, warm)
                told = timed([sys.executable, __file__, "--stages", str(path)], warm)[2]
                if turn > 0:  # the first only fills the caches
                    runs[name].append(run)
                    spent[name].append(json.loads(told))
        for name, seconds in FLIGHTS.items():
            report(f"{name}, full cache", seconds, runs[name])
        for name in flights:
            print(f"CPU seconds of each stage, {name}")
            for stage in spent[name][0]:
                print(f"  {stage:28s} {statistics.median(one.get(stage, 0.0) for one in spent[name]):7.2f}")


if __name__ == "__main__":
    main()
