"""How long a flight of one hour takes to plot: GET /api/flights/{id}/signals. Run: python benchmarks/page.py [FILE]

The service runs in a process of its own on a recording of one hour (flown by the simulator, some minutes, unless FILE
is given). The first request reads the recording; later ones find its signals in memory.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

VEHICLE = "iitb-mav"
NAMES = "airspeed,alpha,beta,q,de"
POINTS = 1000
ROUNDS = 9


def fly(path: Path) -> None:
    """A recording of one hour of multisines."""
    command = [sys.executable, "-m", "sim_vehicle", "fly", "--vehicle", VEHICLE, "--manoeuvre", "multisine"]
    subprocess.run([*command, "--duration", "3600", "--seed", "3", "--record", str(path)], check=True)


def timed(url: str) -> tuple[float, bytes]:
    """Seconds until the whole answer is there, and the answer."""
    begun = time.perf_counter()
    with urllib.request.urlopen(url, timeout=600) as answer:
        body: bytes = answer.read()
    return time.perf_counter() - begun, body


def measure(url: str, recording: Path) -> None:
    """Upload the recording and print the times of the requests that the page makes."""
    upload = urllib.request.Request(f"{url}/api/flights?name=hour.mcap", recording.read_bytes(), method="POST")
    with urllib.request.urlopen(upload, timeout=600) as answer:
        flight = json.load(answer)["id"]
    signals = f"{url}/api/flights/{flight}/signals?names={NAMES}&points={POINTS}"
    first, _ = timed(f"{url}/api/flights/{flight}")
    print(f"summary, which reads the recording: {first:.2f} s")
    again, _ = timed(f"{url}/api/flights/{flight}")
    print(f"summary again: {again:.3f} s")
    for words, address in (("whole hour", signals), ("a tenth of it", f"{signals}&start=1000&end=1360")):
        rounds = [timed(address) for _ in range(ROUNDS)]
        middle = statistics.median(seconds for seconds, _ in rounds)
        print(f"5 signals, {words}: {1e3 * middle:.0f} ms, {len(rounds[0][1]) / 1e3:.0f} kB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?", type=Path, help="recording of an hour (else it is flown)")
    given = parser.parse_args().file
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recording = given or folder / "hour.mcap"
        if given is None:
            fly(recording)
        command = [sys.executable, "-m", "gcs", "serve", "--port", "0", "--no-identify", "--vehicle", VEHICLE]
        with subprocess.Popen([*command, "--data", str(folder / "data")], stdout=subprocess.PIPE, text=True) as service:
            assert service.stdout is not None
            try:
                measure(service.stdout.readline().split()[-1], recording)
            finally:
                service.terminate()


if __name__ == "__main__":
    main()
