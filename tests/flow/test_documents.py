"""The documents agree with the code, and no link in them leads nowhere."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def test_the_page_of_effects_is_the_catalogue() -> None:
    page = runpy.run_path(str(ROOT / "docs" / "effects.py"))["page"]()
    assert (ROOT / "docs" / "effects.md").read_text(encoding="utf-8") == page


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target


def test_commands_in_the_readme_exist() -> None:
    from gcs.cli import build_parser

    text = (ROOT / "README.md").read_text(encoding="utf-8")
    named = set(re.findall(r"gcs ([a-z]+)", text))
    assert {"record", "identify", "discrepancy", "serve", "info"} <= named
    known = build_parser().format_help()
    assert all(name in known for name in named)
