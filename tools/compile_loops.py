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

# Together each row needs about as long; `oe` alone compiles most.
SHARES = (("oe", "ee"), ("map", "fe"))
SECONDS = 600


def main() -> int:
    if compiled_mark().exists():
        return 0
    print("compiling the loops, about a minute, once ...", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        flight = Path(folder) / "flight.mcap"
        fly = [sys.executable, "-m", "sim_vehicle", "fly", "--manoeuvre", "multisine", "--duration", "12"]
        subprocess.run([*fly, "--record", str(flight)], check=True, capture_output=True, timeout=SECONDS)
        running = [
            subprocess.Popen([sys.executable, __file__, str(flight), *methods], stdout=subprocess.DEVNULL)
            for methods in SHARES
        ]
        codes = [process.wait(SECONDS) for process in running]
    if any(codes):
        return 1
    compiled_mark().parent.mkdir(parents=True, exist_ok=True)
    compiled_mark().touch()
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
