"""What MkDocs asks while it builds the site: generated pages, links out of docs/, equations as MathML."""

from __future__ import annotations

import re
from pathlib import Path

import command_pages
import equations
import python_pages
import rest_page
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[2]
# What pages link to outside docs/ goes along with the site: these files as they are, and this page as one of its own.
SHIPPED = "sim_vehicle/vehicles"
SCRIPTS, SCRIPTS_PAGE = "benchmarks/README.md", "explanation/benchmark-scripts.md"
_OUTSIDE = re.compile(rf"\]\((?:\.\./)+({SHIPPED}/[^)#]+|{SCRIPTS})\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made from parsers, the service and docstrings, and the files linked to."""
    schema = rest_page.schema()
    made = {
        "reference/cli.md": command_pages.page(),
        "reference/rest.md": rest_page.page(schema),
        "reference/openapi.json": rest_page.text(schema),
        SCRIPTS_PAGE: (ROOT / SCRIPTS).read_text(encoding="utf-8").replace("](../docs/", "](../"),
        **python_pages.pages(ROOT),
    }
    for name, content in made.items():
        files.append(File.generated(config, name, content=content))
    for path in sorted((ROOT / SHIPPED).iterdir()):
        if path.suffix in (".toml", ".json", ".csv"):
            files.append(File.generated(config, f"files/{SHIPPED}/{path.name}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links to files of the repository outside docs/ lead to the copies that the site carries."""
    up = "../" * page.file.src_uri.count("/")

    def inside(found: re.Match[str]) -> str:
        target = found.group(1)
        return f"]({up}{SCRIPTS_PAGE if target == SCRIPTS else f'files/{target}'})"

    return _OUTSIDE.sub(inside, markdown)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Equations become MathML, which browsers set by themselves."""
    return equations.as_mathml(html)
