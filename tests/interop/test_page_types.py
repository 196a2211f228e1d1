"""The page's modules as a compiler reads them: names, arguments and properties that are not there are found."""

import shutil
from pathlib import Path

import pytest
from node_reader import NodeReader

PAGE = Path(__file__).resolve().parents[2] / "gcs" / "page"


def test_the_pages_modules_are_what_typescript_takes_them_for(node: NodeReader) -> None:
    assert node.check_types(PAGE / "tsconfig.json") == ""


@pytest.mark.parametrize(
    "wrong",
    [
        "asked('once')",
        "document.querySelector('h1').focus()",
        "try { get('') } catch (error) { error.message() }",
    ],
    ids=["a name", "what may be null", "what was thrown"],
)
def test_what_is_not_there_is_found(node: NodeReader, tmp_path: Path, wrong: str) -> None:
    page = tmp_path / "page"
    shutil.copytree(PAGE, page, ignore=shutil.ignore_patterns("*.py", "__pycache__"))
    with (page / "static" / "flight" / "flights.js").open("a") as module:
        module.write(f"\n{wrong}\n")
    assert "flights.js" in node.check_types(page / "tsconfig.json")
