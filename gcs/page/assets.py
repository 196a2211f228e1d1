"""The page's files: read and compressed once, under addresses that change with their content."""

from __future__ import annotations

import gzip
import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from html import escape
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

#: Where the addresses of all files begin.
PREFIX = "/page/"
#: What the browser may load: nothing but what this service sends, no scripts and no style sheets inside the document.
#: The plots set the style of their own elements, which only 'unsafe-inline' styles allow.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self'; manifest-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
_KINDS = {
    ".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8", ".json": "application/json",
}  # fmt: skip
#: The page in other languages: language-CODE.json, English text -> the other one, "" -> the language's own name.
_LANGUAGE = re.compile(r"language-([a-z]{2})\.json")
#: What a phone asks for before it puts the page on its home screen.
MANIFEST = {
    "name": "Ground station", "short_name": "Ground station", "start_url": "/#/live", "scope": "/",
    "display": "standalone", "background_color": "#ffffff", "theme_color": "#0842a0",
    "icons": [{"src": "/icon.svg", "sizes": "any", "type": "image/svg+xml", "purpose": "any"}],
}  # fmt: skip
ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16"><rect width="16" height="16" fill="#fff"/>'
    '<path d="M8 1l1.5 5L15 9v2L9.5 9.5V13l1.5 1.5v.5H5v-.5L6.5 13V9.5L1 11V9l5.5-3z" fill="#0842a0"/></svg>'
)
_PLOTTING = ("bokeh.min.js", "bokeh-api.min.js")


@dataclass(frozen=True)
class Asset:
    """One file: what it holds, the same compressed by gzip, and its media type."""

    content: bytes
    packed: bytes
    kind: str


@dataclass(frozen=True)
class Assets:
    """The document of GET / and the files that it names, by their addresses. shell: the script that keeps them in the
    browser.
    """

    document: str
    files: dict[str, Asset]
    shell: str


@cache
def load_assets() -> Assets:
    """The page of this version."""
    here = files(__package__)
    folder = here / "static"
    own = dict(_below(folder))
    own_at, own_files = _bundle(own)
    plots_at, plots_files = _bundle(_plotting(here / "vendor"))
    modules = sorted(name for name in own if name.endswith(".js"))
    document = (folder / "index.html").read_text(encoding="utf-8")
    marks = {
        "{own}": own_at,
        "{plots}": " ".join(plots_at + name for name in _PLOTTING),
        "{languages}": ",".join(f"{code}={escape(name)}" for code, name in sorted(_languages(own).items())),
        "{modules}": "\n".join(f'<link rel="modulepreload" href="{escape(own_at + name)}">' for name in modules),
    }
    for mark, text in marks.items():
        document = document.replace(mark, text)
    every = own_files | plots_files
    shell = (folder / "shell.js.in").read_text(encoding="utf-8").replace("{files}", json.dumps(sorted(every)))
    return Assets(document, every, shell)


def _below(folder: Traversable, at: str = "") -> Iterator[tuple[str, bytes]]:
    """What is served of a folder and of those in it, by its path there."""
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _below(entry, f"{at}{entry.name}/")
        elif Path(entry.name).suffix in _KINDS:
            yield at + entry.name, entry.read_bytes()


def _languages(own: dict[str, bytes]) -> dict[str, str]:
    """By code the own names of the languages that there are catalogues of."""
    found = {match[1]: name for name in own if (match := _LANGUAGE.fullmatch(name))}
    return {code: json.loads(own[name])[""] for code, name in found.items()}


def _bundle(contents: dict[str, bytes]) -> tuple[str, dict[str, Asset]]:
    """Files by their paths, in a folder named by what they hold: its address, and the files by theirs."""
    digest = hashlib.sha256()
    for name in sorted(contents):
        digest.update(name.encode() + b"\0" + contents[name] + b"\0")
    address = f"{PREFIX}{digest.hexdigest()[:16]}/"
    return address, {address + name: _asset(name, content) for name, content in contents.items()}


def _asset(name: str, content: bytes) -> Asset:
    return Asset(content, gzip.compress(content, 9, mtime=0), _KINDS[Path(name).suffix])


def _plotting(folder: Traversable) -> dict[str, bytes]:
    """BokehJS, put there by tools/page_library.py."""
    return {name: (folder / name).read_bytes() for name in _PLOTTING}
