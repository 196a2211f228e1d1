"""The pictures of docs/howto/report.md: a flight of the simulator, identified, and the figures of its report as PNG.

Run: python tools/report_pictures.py
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from gcs.report import figures
from gcs.report.svg import save

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
SHOWN = ("history0", "bode-de", "fit0", "correlation")


def main() -> None:
    """Fly, identify, draw."""
    with tempfile.TemporaryDirectory() as folder:
        for command in (
            ("sim_vehicle", "fly", "--manoeuvre", "multisine", "--seed", "3", "--duration", "40", "--record", "f.mcap"),
            ("gcs", "identify", "f.mcap", "--vehicle", "iitb-mav", "-o", "found.json", "--quiet"),
        ):
            subprocess.run([sys.executable, "-m", *command], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        result = json.loads((Path(folder) / "found.json").read_text(encoding="utf-8"))
    for drawing in figures.every(result):
        if drawing.name in SHOWN:
            save(IMAGES / f"report-{drawing.name}.png", drawing.size, drawing.draw)


if __name__ == "__main__":
    main()
