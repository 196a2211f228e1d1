"""The site is built strictly, whole, and so that a browser fetches nothing from outside."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from doc_commands import ROOT

from sim_vehicle.effects import EFFECTS


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built into a folder of its own."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_no_page_fetches_anything_from_outside(site: Path) -> None:
    fetched = re.compile(
        r"<(?:script|img|iframe|source)\b[^>]*\ssrc=\"?(?:https?:)?//|<link\b[^>]*\shref=\"?(?:https?:)?//"
    )
    pages = list(site.rglob("*.html"))
    assert len(pages) > 200
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert not fetched.search(text), page
        assert 'class="mermaid"' not in text, page  # its script would come from outside
    for style in site.rglob("*.css"):
        assert not re.search(r"@import|url\([\"']?(?:https?:)?//", style.read_text(encoding="utf-8")), style


def test_equations_are_set(site: Path) -> None:
    methods = (site / "explanation" / "methods.html").read_text(encoding="utf-8")
    assert methods.count("<math ") >= 4
    assert methods.count("<mtr>") == 5  # three lines of kinematics, two of coefficients
    assert "arithmatex" not in methods


def test_the_reference_holds_every_command_address_effect_and_module(site: Path) -> None:
    from gcs.cli import GROUPS

    commands = (site / "reference" / "cli.html").read_text(encoding="utf-8")
    described = [name for names in GROUPS.values() for name in names]
    assert len(described) >= 14
    for name in described:
        assert f"usage: gcs {name} " in commands, name
    assert "usage: sim-vehicle fly " in commands
    rest = (site / "reference" / "rest.html").read_text(encoding="utf-8")
    schema = json.loads((site / "reference" / "openapi.json").read_text(encoding="utf-8"))
    assert {"/api/health", "/api/flights/{flight_id}/identification"} <= set(schema["paths"])
    for path in schema["paths"]:
        assert path in rest
    effects = (site / "reference" / "effects.html").read_text(encoding="utf-8")
    assert all(f"<code>{name}</code>" in effects for name in EFFECTS)
    python = (site / "reference" / "python" / "sysid.identification.identify.html").read_text(encoding="utf-8")
    assert "sysid.identification.identify.identify" in python
    assert "Identify a model." in python
