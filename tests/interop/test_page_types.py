"""The page's modules as a compiler reads them: names, arguments and properties that are not there are found."""

import shutil
from pathlib import Path

from node_reader import NodeReader

PAGE = Path(__file__).resolve().parents[2] / "gcs" / "page"


def test_the_pages_modules_are_what_typescript_takes_them_for(node: NodeReader) -> None:
    assert node.check_types(PAGE / "tsconfig.json") == ""


def test_a_name_that_is_not_there_is_found(node: NodeReader, tmp_path: Path) -> None:
    page = tmp_path / "page"
    shutil.copytree(PAGE, page, ignore=shutil.ignore_patterns("*.py", "__pycache__"))
    with (page / "static" / "flight" / "flights.js").open("a") as module:
        module.write("\nasked('once')\n")
    assert "flights.js" in node.check_types(page / "tsconfig.json")
