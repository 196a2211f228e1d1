"""A model in another form as one file to hand out."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

from gcs.exports import daveml, gazebo, jsbsim, tables
from gcs.exports.exported import Exported

# What is written without the compiled simulation, which a service that listens must not wait for.
WRITERS = {
    "jsbsim": (jsbsim.write, ""), "gazebo": (gazebo.write, ""), "csv": (tables.write_csv, ".csv"),
    "daveml": (daveml.write, ".dml"), "latex": (tables.write_latex, ".tex"),
}  # fmt: skip


def archived(model: Exported, form: str, name: str) -> tuple[bytes, str]:
    """Content and name of the file: a ZIP archive for a form that may be several. Raises ExportError."""
    writer, ending = WRITERS[form]
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        writer(model, folder / f"{name}{ending}")
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        if form in ("daveml", "latex"):
            return files[0].read_bytes(), files[0].name
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in files:
                archive.write(path, path.relative_to(folder))
    return packed.getvalue(), f"{name}-{form}.zip"
