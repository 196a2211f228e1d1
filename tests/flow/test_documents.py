"""The documents agree with the code, no link in them leads nowhere, and no command in them escapes being tried."""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import runpy
import subprocess
from pathlib import Path

import pytest
from doc_commands import PAGES, ROOT, WAYS, Block, blocks, unfenced

from gcs.cli import build_parser as gcs_parser
from sim_vehicle.cli.main import build_parser as simulator_parser

BLOCKS = [block for page in PAGES for block in blocks(page)]
PARSERS = {"gcs": gcs_parser, "sim-vehicle": simulator_parser}
# Pages that the site makes (tools/site): no link from the repository may lead there.
MADE = {"docs/reference/cli.md", "docs/reference/rest.md", "docs/reference/python/index.md"}


def test_the_page_of_effects_is_the_catalogue() -> None:
    page = runpy.run_path(str(ROOT / "tools" / "effects.py"))["page"]()
    assert (ROOT / "docs" / "reference" / "effects.md").read_text(encoding="utf-8") == page


def test_the_page_of_settings_is_the_code_and_none_stands_without_a_word() -> None:
    made = runpy.run_path(str(ROOT / "tools" / "settings.py"))
    assert (ROOT / "docs" / "reference" / "settings.md").read_text(encoding="utf-8") == made["page"]()
    silent = [
        (path, group.entries) for path, found in made["settings"]().items() for group in found if not group.meaning
    ]
    assert silent == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).resolve().exists(), target


def test_every_page_has_its_place_in_the_site() -> None:
    listed = re.findall(r": ([\w/-]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in PAGES if page.parent != ROOT}
    assert pages | {path.removeprefix("docs/") for path in MADE} | {"explanation/benchmark-scripts.md"} == set(listed)
    assert len(listed) == len(set(listed))


def test_commands_in_the_readme_exist() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    named = set(re.findall(r"gcs ([a-z]+)", text))
    assert {"record", "identify", "discrepancy", "serve", "info"} <= named
    known = gcs_parser().format_help()
    assert all(name in known for name in named)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_no_command_stands_outside_a_shell_block(page: Path) -> None:
    assert unfenced(page) == []


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.name)
def test_a_block_says_how_it_is_tried_and_its_commands_are_understood(block: Block) -> None:
    assert block.way in WAYS
    assert (block.way == "test") == bool(block.by)
    if block.language == "sh":
        subprocess.run(["bash", "-n"], input=block.text, text=True, check=True)
    for program, *arguments in block.commands():
        if program in PARSERS:
            _parse(PARSERS[program](), arguments)
        elif block.way == "make" or program == "make":
            assert program == "make", f"{program} is no target"
            assert block.way == "make"
            _make(arguments)
    if block.by:
        assert block.page.name in (ROOT / block.by).read_text(encoding="utf-8")


def _parse(parser: argparse.ArgumentParser, arguments: list[str]) -> None:
    for stop, word in enumerate(arguments):  # the shell's own words end a command
        if word in ("&", "|", "&&", ";", ">"):
            arguments = arguments[:stop]
            break
    parser.parse_args(arguments)


def _make(arguments: list[str]) -> None:
    """The target exists, and so does the script that it runs: make says what it would do, and does nothing."""
    done = subprocess.run(["make", "-n", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for script in re.findall(r"python ((?:tests|benchmarks)/\S+\.py)", done.stdout):
        assert (ROOT / script).is_file(), script


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_options_named_in_a_sentence_exist(page: Path) -> None:
    for program, words in re.findall(r"`(gcs|sim-vehicle) ([^`]+)`", page.read_text(encoding="utf-8")):
        name, *rest = words.split()
        if name.isupper():
            continue
        parser = PARSERS[program]()
        known = parser.format_help() if name.startswith("-") else command_help(parser, name)
        for option in re.findall(r"(?<!\S)--?[a-z][\w-]*", " ".join(rest)):
            assert re.search(rf"(?<!\S)\[?{re.escape(option)}\b", known), f"{program} {name} has no {option}"


def command_help(parser: argparse.ArgumentParser, name: str) -> str:
    """What a command prints with --help."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), pytest.raises(SystemExit) as stop:
        parser.parse_args([name, "--help"])
    assert stop.value.code == 0, f"there is no {name}"
    return out.getvalue()
