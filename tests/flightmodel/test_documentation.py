"""The examples of the documentation run as they stand, and print what they say."""

from __future__ import annotations

import doctest
import importlib
import re
import shutil
from pathlib import Path

import pytest

import flightmodel
from flightmodel import Aircraft, Flight

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "howto" / "python.md"


@pytest.mark.whole_flight
def test_the_page_s_examples_run_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(ROOT / "docs" / "notebooks" / "flight1.csv", tmp_path)
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) > 4
    space: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, PAGE.name, "exec"), space)
    printed = capsys.readouterr().out
    shown = re.search(r"It prints:\n\n```\n(.*?)\n```", text, re.DOTALL)
    assert shown is not None
    assert printed.splitlines()[-1] == shown[1]
    assert {"result.json", "model.json", "report.html", "mine.toml"} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.whole_flight
@pytest.mark.parametrize("module", ["aircraft", "analyses", "equations", "flight"])
def test_examples_of_docstrings_hold(module: str) -> None:
    """`flight` and `aircraft` in them are those of the notebook."""
    known = {
        "flight": Flight.read(ROOT / "docs" / "notebooks" / "flight1.csv"),
        "aircraft": Aircraft.estimate(
            span=1.27, mass=1.959, area=0.3097, chord=0.25, Ixx=0.0715, Iyy=0.0864, Izz=0.1536, Ixz=0.014,
            surfaces="command", airspeed="true", max_thrust=7.86, thrust_line=(0.297, 0.0, -0.046),
            moving_mass=0.0,
        ),
    }  # fmt: skip
    found = doctest.testmod(importlib.import_module(f"flightmodel.{module}"), extraglobs=known)
    assert found.attempted > 0
    assert found.failed == 0


def test_everything_promised_is_there() -> None:
    assert {name: getattr(flightmodel, name) for name in flightmodel.__all__}
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        flightmodel.nothing  # type: ignore[attr-defined] # noqa: B018
