"""How long a flight of one hour takes to plot. Run: python benchmarks/page.py [FILE] [--browser]

The service runs in a process of its own on a recording of one hour (flown by the simulator, some minutes, unless FILE
is given). The first request reads the recording; later ones find its signals in memory. Timed are the answers of
GET /api/flights/{id}/signals and, with --browser, in Chromium (`make interop` installs what drives it), the way from
the list of flights to the drawn plots, a zoom by a button, and both again.
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


# Until each of the plots has its canvas, which the plotting library hides in trees of its own, and it has been shown.
_SHOWN = """
  const frame = () => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))
  const painted = root => root.querySelector('canvas')
    || [...root.querySelectorAll('*')].some(one => one.shadowRoot && painted(one.shadowRoot))
"""
_DRAWN = f"""async address => {{ {_SHOWN}
  const begun = performance.now()
  location.hash = address
  const drawn = () => [...document.querySelectorAll('.plots .plot')].filter(painted).length >= 5
  while (!drawn()) await new Promise(done => setTimeout(done, 2))
  await frame()
  return performance.now() - begun
}}"""
# A zoom asks anew for finer data: it is over when these are drawn.
_ZOOMED = f"""async () => {{ {_SHOWN}
  const begun = performance.now(), before = location.hash
  document.querySelector('button[aria-label="Zoom in"]').click()
  while (location.hash === before) await new Promise(done => setTimeout(done, 2))
  await frame()
  return performance.now() - begun
}}"""


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


def draw(url: str, flight: str) -> None:
    """Print the times until all plots of a flight's page are drawn, by the browser's own clock."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
    from browser import chromium
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright, chromium(playwright) as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        opened, zoomed = [], []
        for _ in range(ROUNDS):
            page.goto(f"{url}/#/flights")
            page.wait_for_selector("main:not([aria-busy]) h1")
            opened.append(page.evaluate(_DRAWN, f"#/flights/{flight}"))
            zoomed.append(page.evaluate(_ZOOMED))
    for words, found in (("from the list to the drawn plots", opened), ("zoom to the drawn plots", zoomed)):
        print(f"5 signals in Chromium, {words}: {found[0]:.0f} ms first, {statistics.median(found):.0f} ms median")


def measure(url: str, recording: Path, *, browser: bool) -> None:
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
    if browser:
        draw(url, flight)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?", type=Path, help="recording of an hour (else it is flown)")
    parser.add_argument("--browser", action="store_true", help="time the page in Chromium as well")
    arguments = parser.parse_args()
    given = arguments.file
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recording = given or folder / "hour.mcap"
        if given is None:
            fly(recording)
        command = [sys.executable, "-m", "gcs", "serve", "--port", "0", "--no-identify", "--vehicle", VEHICLE]
        with subprocess.Popen([*command, "--data", str(folder / "data")], stdout=subprocess.PIPE, text=True) as service:
            assert service.stdout is not None
            try:
                measure(service.stdout.readline().split()[-1], recording, browser=arguments.browser)
            finally:
                service.terminate()


if __name__ == "__main__":
    main()
