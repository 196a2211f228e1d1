"""The notebooks of the documentation run in Jupyter's own kernel and come to what they say."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def answers(notebook: Any) -> list[str]:
    """The plain text of every output."""
    found = []
    for cell in notebook.cells:
        for one in cell.get("outputs", []):
            found.append("".join(one["data"].get("text/plain", "")) if "data" in one else "".join(one.get("text", "")))
    return found


def pictures(notebook: Any) -> int:
    return sum("image/png" in one.get("data", {}) for cell in notebook.cells for one in cell.get("outputs", []))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_says_what_it_said(path: Path) -> None:
    tool = runpy.run_path(str(ROOT / "tools" / "notebooks.py"))
    kept, run = tool["nbformat"].read(path, as_version=4), tool["executed"](path)
    assert pictures(run) == pictures(kept) > 1
    verdicts = [
        [one for one in answers(each) if one.startswith(("Identification(", "Discrepancy("))] for each in (kept, run)
    ]
    assert verdicts[0] == verdicts[1] != []


def test_there_are_two() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["csv-to-model", "missing-effect"]
