"""Compile every loop once, before anything needs it: a short flight, identified by every method on all processors.

    python tools/compile_loops.py

The machine code is kept on disk under a name of the sources, so that only the first run after a change takes a minute.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from sim_vehicle.jit import compiled_mark

# What is left behind the loops that every identification calls, in two shares.
SHARES = (("ee", "map"), ("oe", "fe"))
LONGEST_S = 600


def main() -> int:
    mark = compiled_mark().with_suffix(".every-method")
    if mark.exists():
        return 0
    print("compiling the loops, about a minute, once ...", flush=True)
    from sysid.identification.compile_ahead import CompileAhead  # takes a second, for nothing where all is there

    with CompileAhead() as ahead:
        ahead.wait()
    with tempfile.TemporaryDirectory() as folder:
        flight = Path(folder) / "flight.mcap"
        fly = [sys.executable, "-m", "sim_vehicle", "fly", "--manoeuvre", "multisine", "--duration", "12"]
        flown = subprocess.run(
            [*fly, "--record", str(flight)], check=False, capture_output=True, text=True, timeout=LONGEST_S
        )
        if flown.returncode:
            print(flown.stderr, file=sys.stderr, end="")
            return 1
        running = [
            subprocess.Popen([sys.executable, __file__, str(flight), *methods], stdout=subprocess.DEVNULL)
            for methods in SHARES
        ]
        codes = [process.wait() for process in running]
    if any(codes):
        return 1
    mark.parent.mkdir(parents=True, exist_ok=True)
    mark.touch()
    return 0


def identified(flight: str, methods: list[str]) -> int:
    """Identify the flight by each method; what comes of it is no matter."""
    from gcs.cli import main as gcs

    with tempfile.TemporaryDirectory() as folder:
        for method in methods:
            result = f"{folder}/{method}.json"
            gcs(["identify", flight, "--vehicle", "iitb-mav", "--method", method, "-o", result, "--quiet"])
    return 0


if __name__ == "__main__":
    sys.exit(identified(sys.argv[1], sys.argv[2:]) if sys.argv[1:] else main())
