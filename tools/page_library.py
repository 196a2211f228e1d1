"""The plotting library of the page, anew: BokehJS out of the Python package of that version, with its licence.

    python tools/page_library.py 3.9.2

The page needs two scripts of it and nothing of its Python, which would be a twentieth of what is installed.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from zipfile import ZipFile

FOLDER = Path(__file__).resolve().parents[1] / "gcs" / "page" / "vendor"
KEPT = (
    "bokeh/server/static/js/bokeh.min.js",
    "bokeh/server/static/js/bokeh-api.min.js",
    "bokeh/LICENSE.txt",
)


def main() -> None:
    version = sys.argv[1]
    with tempfile.TemporaryDirectory() as place:
        pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary", ":all:"]
        subprocess.run([*pip, "--dest", place, f"bokeh=={version}"], check=True)
        (wheel,) = Path(place).glob("*.whl")
        with ZipFile(wheel) as archive:
            for name in KEPT:
                (FOLDER / Path(name).name).write_bytes(archive.read(name))
    print(f"{FOLDER}: BokehJS {version}")


if __name__ == "__main__":
    main()
