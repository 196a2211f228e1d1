"""Run the notebooks of the documentation in Jupyter and keep what their cells give.

    python tools/notebooks.py docs/notebooks

Needs nbclient, nbformat and ipykernel (pip install '.[interop]'). What the notebooks write goes to a folder of its own.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

_LONGEST_S = 900


def executed(path: Path) -> Any:
    """The notebook with new outputs; raises CellExecutionError where a cell fails."""
    notebook: Any = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as work:
        for table in path.parent.glob("*.csv"):
            shutil.copy(table, work)
        NotebookClient(notebook, timeout=_LONGEST_S, resources={"metadata": {"path": work}}).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            # Progress bars are drawn over themselves: nothing of them is to be kept.
            cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr"]
    notebook.metadata.pop("language_info", None)
    return notebook


def main() -> None:
    for path in sorted(Path(sys.argv[1]).glob("*.ipynb")):
        nbformat.write(executed(path), path)
        print(path)


if __name__ == "__main__":
    main()
