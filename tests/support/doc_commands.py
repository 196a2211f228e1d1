"""The commands that stand in README.md, CONTRIBUTING.md and docs/: where they stand, and how they are to be tried.

A block of shell commands is fenced as `sh` (commands) or `console` (`$ command` and what it prints). It is run as it
stands, unless the line above it says another way in a comment: `<!-- commands: WAY -->`, see `WAYS`. A `text` block
under `<!-- output -->` shows lines that the block before it prints.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md")))

WAYS = {
    "run": "run as it stands, in the page's order, in one folder; must end with 0",
    "background": "started, stopped with Ctrl-C at the end of the page; must end with 0",
    "make": "targets that set up, test or measure for minutes to hours: they exist, and so do their scripts",
    "hardware": "needs a device or an autopilot: read by the command's parser",
    "system": "changes the computer: only its syntax is checked",
    "data": "needs data that is not part of the project: read by the command's parser",
    "test": "run by the test that the comment names: `<!-- commands: test tests/flow/NAME.py -->`",
}
_SHELL = ("sh", "console", "bash", "shell")
_WAY = re.compile(r"<!-- commands: (\w+)(?: (\S+))? -->")
_PROGRAMS = re.compile(r"^(?:\$ )?(?:\S*bin/)?(?:gcs|sim-vehicle|make|python3?|mavproxy\.py|curl|docker|pip|git|sudo) ")


@dataclass(frozen=True)
class Block:
    """Commands that stand together. line: of the fence, from 1. shown: lines that are said to be printed."""

    page: Path
    line: int
    language: str
    way: str
    by: str
    text: str
    shown: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Where the block stands, as `docs/reference/links.md:31`."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    def commands(self) -> list[list[str]]:
        """The words of each command, comments left out, lines that end with a backslash joined."""
        lines = self.text.replace("\\\n", " ").splitlines()
        if self.language == "console":
            lines = [line[2:] for line in lines if line.startswith("$ ")]
        words = [shlex.split(line, comments=True) for line in lines]
        return [line for line in words if line]


def blocks(page: Path) -> list[Block]:
    """The shell blocks of a page, in order."""
    found: list[Block] = []
    lines = page.read_text(encoding="utf-8").splitlines()
    number = 0
    while number < len(lines):
        if not lines[number].startswith("```"):
            number += 1
            continue
        end = lines.index("```", number + 1)
        language, before = lines[number][3:].strip(), lines[number - 1] if number else ""
        inside = lines[number + 1 : end]
        if language in _SHELL:
            way = _WAY.fullmatch(before.strip())
            kind, by = (way[1], way[2] or "") if way else ("run", "")
            found.append(Block(page, number + 1, language, kind, by, "\n".join(inside)))
        elif before.strip() == "<!-- output -->":
            last = found.pop()
            found.append(Block(**{**last.__dict__, "shown": (*last.shown, *inside)}))
        number = end + 1
    return found


def unfenced(page: Path) -> list[str]:
    """Lines outside shell blocks that look like commands: they would escape every check."""
    fenced: str | None = None
    found = []
    for line in page.read_text(encoding="utf-8").splitlines():
        if line.startswith("```"):
            fenced = line[3:].strip() if fenced is None else None
        elif (fenced is not None and fenced not in _SHELL and _PROGRAMS.match(line)) or (
            fenced is None and line.startswith("    ") and _PROGRAMS.match(line.strip())
        ):
            found.append(line.strip())
    return found
