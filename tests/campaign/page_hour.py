"""An hour of the live page in Chromium: its share of a core, its memory, and links that are lost and found.

Run: make campaign NAME=page, or for six minutes make campaign NAME=page MINUTES=6

The simulator flies over UDP in real time into the service; every twelfth of the time it is stopped for 8 s, so that the
page sees a flight end and another begin. Every half minute the page's heap is collected and measured, in turn at its
top, with instruments and one plot in sight, and moved down to the plots, of which four are. On standard output: a row
each half minute, then the verdict; 1 where the page did not recover, or memory grew.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from browser import chromium
from ground import Ground
from processes import free_port, start
from traffic import wait_until

LOSSES = 10
AWAY_S = 8.0
LOOK_S = 30.0
# MB an hour by which a heap may seem to grow that does not.
LEAST_GROWTH_MB = 2.0
PLOT = ".plot canvas"
# By name, what of the page stands at the top of the window.
VIEWS = {"top": "body", "plots": ".plots"}


def simulator(ground: Ground) -> subprocess.Popen[str]:
    """A vehicle that flies test inputs for longer than anybody looks."""
    command = ("fly", "--vehicle", "iitb-mav", "--manoeuvre", "multisine", "--duration", 4000)
    return start("sim-vehicle", [*command, "--out", f"udpout:127.0.0.1:{ground.udp}"])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    given = parser.parse_args()
    end = 60.0 * given.minutes
    with TemporaryDirectory() as folder, sync_playwright() as playwright, chromium(playwright) as browser:
        ground = Ground(Path(folder), free_port(), free_port())
        ground.start()
        wait_until(lambda: ground.get("/api/live")["process"]["state"] == "running", 180.0)
        vehicle = simulator(ground)
        page = browser.new_context(viewport={"width": 1440, "height": 900}).new_page()
        page.goto(f"{ground.url}/#/live")
        page.wait_for_selector(PLOT, state="attached", timeout=60_000)
        inside, whole = page.context.new_cdp_session(page), browser.new_browser_cdp_session()

        def used_s() -> float:
            return sum(one["cpuTime"] for one in whole.send("SystemInfo.getProcessInfo")["processInfo"])

        def heap_mb() -> tuple[float, int]:
            inside.send("HeapProfiler.collectGarbage")
            found = {one["name"]: one["value"] for one in inside.send("Performance.getMetrics")["metrics"]}
            return found["JSHeapUsedSize"] / 1e6, int(found["Nodes"])

        inside.send("Performance.enable")
        begin = time.monotonic()
        due = [end * (i + 1.0) / (LOSSES + 1.0) for i in range(LOSSES)]
        seen: list[tuple[float, float, int]] = []
        shares: dict[str, list[float]] = {view: [] for view in VIEWS}
        lost = found_again = 0
        print("minute  view   core %  heap MB  nodes  lost")
        while (now := time.monotonic() - begin) < end:
            if due and now >= due[0]:
                due.pop(0)
                lost += 1
                vehicle.kill()
                vehicle.communicate()
                page.wait_for_timeout(1000.0 * AWAY_S)
                vehicle = simulator(ground)
                shown = page.evaluate("() => document.querySelector('main').innerText.length")
                ground_time = wait_until(lambda: ground.get("/api/live")["time_s"], 60.0)
                page.wait_for_timeout(5000)
                after = page.locator(PLOT).count()
                found_again += bool(shown and ground_time and after)
            view = min(VIEWS, key=lambda one: len(shares[one]))
            page.locator(VIEWS[view]).first.evaluate("one => one.scrollIntoView({ behavior: 'instant' })")
            page.wait_for_timeout(1000)
            before, at = used_s(), time.monotonic()
            page.wait_for_timeout(1000.0 * LOOK_S)
            share = 100.0 * (used_s() - before) / (time.monotonic() - at)
            heap, nodes = heap_mb()
            now = time.monotonic() - begin
            seen.append((now, heap, nodes))
            shares[view].append(share)
            print(f"{now / 60.0:6.1f}  {view:5s}  {share:6.1f}  {heap:7.2f}  {nodes:5d}  {lost:4d}", flush=True)
        vehicle.kill()
        vehicle.communicate()
        ground.stop()
    times, heaps = np.array([one[0] for one in seen]), np.array([one[1] for one in seen])
    # What the first minutes fill is the minute that is plotted.
    later = times > min(180.0, 0.3 * end)
    growth = 3600.0 * float(np.polyfit(times[later], heaps[later], 1)[0]) if later.sum() > 3 else 0.0
    for view, found in shares.items():
        print(f"share of a core, {view}: median {np.median(found):.1f} %, most {max(found):.1f} %")
    print(f"heap: {heaps[later].min():.1f} to {heaps[later].max():.1f} MB, {growth:+.2f} MB an hour")
    print(f"link lost {lost} times, found again {found_again} times")
    return 0 if found_again == lost and growth < LEAST_GROWTH_MB else 1


if __name__ == "__main__":
    sys.exit(main())
