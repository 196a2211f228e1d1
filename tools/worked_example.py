"""The worked example of docs/howto/missing-effect.md: its commands as they stand there, and its pictures.

Run: make worked-example. The commands run in demo-output/worked-example and print what the page quotes; the pictures go
to docs/images.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from doc_commands import ROOT, blocks

from gcs.report.discrepancy_figures import draw_bars, draw_curves, draw_simulations
from gcs.report.svg import save
from sysid.discrepancy.summary import shrinking

PAGE = ROOT / "docs" / "howto" / "missing-effect.md"
FOLDER = ROOT / "demo-output" / "worked-example"
RESULT = "odd.json"
PICTURES = ROOT / "docs" / "images"
MODULES = {"gcs": "gcs", "sim-vehicle": "sim_vehicle"}
STAGES = ("before", "after")
MOST_OUTPUTS = 3


def run_page() -> int:
    """Run the commands of the page in order; the exit code of the first that fails, or 0."""
    for block in (block for block in blocks(PAGE) if block.way == "run"):
        for program, *arguments in block.commands():
            print(f"$ {' '.join((program, *arguments))}", flush=True)
            command = [sys.executable, "-m", MODULES[program], *arguments]
            done = subprocess.run(command, cwd=FOLDER, check=False)
            if done.returncode:
                return done.returncode
    return 0


def draw(result: dict[str, Any]) -> None:
    """The residual's curves, both simulations over the flight that nothing was fitted to, and its gaps."""
    gap, (flight, *_) = result["gap"]["validation"], result["series"]["validation"]
    outputs = shrinking(gap, *STAGES)[:MOST_OUTPUTS]
    places = result["where"]
    save(PICTURES / "missing-effect-where.png", (2.5 * len(places), 2.4), partial(draw_curves, places=places))
    shown = partial(draw_simulations, flight=flight, outputs=outputs, stages=STAGES)
    save(PICTURES / "missing-effect-flight.png", (7.4, 1.6 * len(outputs) + 0.5), shown)
    save(PICTURES / "missing-effect-gap.png", (7.4, 2.6), lambda made: draw_bars(made.subplots(), gap))


def main() -> int:
    """Run the page and draw."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)
    code = run_page()
    if code:
        print("worked example: a command of the page failed; its words stand above", file=sys.stderr)
        return 1
    draw(json.loads((FOLDER / RESULT).read_text(encoding="utf-8")))
    print(f"pictures in {PICTURES.relative_to(ROOT)}: missing-effect-where, -flight and -gap.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
