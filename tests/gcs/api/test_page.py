"""The page as a browser gets it: complete, small, kept for good, and nothing in it from anywhere else."""

from __future__ import annotations

import gzip
import re
from collections import Counter
from collections.abc import Iterator
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path
from urllib.parse import urljoin

import httpx
import pytest
from fastapi import FastAPI
from serving import serving

from gcs.api.page import router
from gcs.api.security import Access, Guard
from gcs.settings import Settings

pytestmark = pytest.mark.whole_flight

MOST_BYTES = 1_000_000
MOST_MODULES = 16
LONGEST_LINE = 120


class Document(HTMLParser):
    """Addresses that a document loads, and scripts that stand in it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.plots: list[str] = []
        self.inline = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag == "script":
            self.inline |= "src" not in given
        self.inline |= any(name.startswith("on") for name in given) or tag == "style"
        address = given.get("src") if tag == "script" else given.get("href") if tag == "link" else None
        # The manifest is asked for by who puts the page on a home screen, not to show it.
        if address and not address.startswith("data:") and given.get("rel") != "manifest":
            self.loaded.append(address)
        if given.get("name") == "plots":
            self.plots = (given["content"] or "").split()


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A browser without the token that the service demands."""
    app = FastAPI()
    settings = Settings(data=tmp_path_factory.mktemp("page"), token="token-of-the-page-test")
    app.add_middleware(Guard, access=Access(settings))
    app.include_router(router)
    with serving(app) as made:
        yield made


@pytest.fixture(scope="module")
def document(client: httpx.Client) -> Document:
    return Document(client.get("/").text)


def test_everything_that_the_page_loads_is_there_below_a_megabyte(client: httpx.Client, document: Document) -> None:
    total = len(client.get("/").content)
    addresses = dict.fromkeys([*document.loaded, *document.plots])
    assert len(addresses) > 10
    for address in addresses:
        with client.stream("GET", address, headers={"Accept-Encoding": "gzip"}) as answer:
            assert answer.status_code == 200, address
            assert answer.headers["content-encoding"] == "gzip"
            packed = b"".join(answer.iter_raw())
        plain = client.get(address, headers={"Accept-Encoding": "identity"})
        assert "content-encoding" not in plain.headers
        assert gzip.decompress(packed) == plain.content
        total += len(packed)
    assert total < MOST_BYTES


def test_files_are_kept_for_good_and_the_document_never(client: httpx.Client, document: Document) -> None:
    assert client.get("/").headers["cache-control"] == "no-cache"
    for address in (document.loaded[0], document.plots[0]):
        assert re.fullmatch(r"/page/[0-9a-f]{16}/[\w.-]+", address)
        assert "immutable" in client.get(address).headers["cache-control"]
        other = re.sub(r"/[0-9a-f]{16}/", "/0000000000000000/", address)
        assert client.get(other).status_code == 404
    assert client.get("/page/x/..%2f..%2fsettings.py").status_code in (401, 404)


def test_no_script_stands_in_the_document_and_none_comes_from_elsewhere(
    client: httpx.Client, document: Document
) -> None:
    assert not document.inline
    assert all(address.startswith("/page/") for address in [*document.loaded, *document.plots])
    rules = dict(rule.split(maxsplit=1) for rule in client.get("/").headers["content-security-policy"].split("; "))
    assert rules["default-src"] == "'none'"
    assert rules["script-src"] == rules["connect-src"] == "'self'"
    assert rules["frame-ancestors"] == rules["base-uri"] == "'none'"


def test_modules_import_only_modules_that_are_there(client: httpx.Client, document: Document) -> None:
    modules = {address for address in document.loaded if address.endswith(".js")}
    for name in modules:
        text = client.get(name).text
        named = re.findall(r"from '([^']*)'", text)
        assert all(other.startswith(("./", "../")) for other in named), name
        assert modules >= {urljoin(name, other) for other in named}, name
        assert not re.search(r"https?://(?!www\.w3\.org)", text), name
        assert "innerHTML" not in text, name


def test_a_folder_of_modules_holds_no_more_than_a_reader_takes_in() -> None:
    modules = list(Path(str(files("gcs.page") / "static")).rglob("*.js"))
    counts = Counter(path.parent.name for path in modules)
    assert set(counts) == {"static", "live", "flight", "model", "aircraft", "shared"}
    assert max(counts.values()) <= MOST_MODULES


def test_no_line_of_a_script_is_longer_than_one_of_the_code() -> None:
    scripts = [path for path in Path(str(files("gcs.page") / "static")).rglob("*") if ".js" in path.suffixes]
    lines = [(path.name, line) for path in scripts for line in path.read_text(encoding="utf-8").splitlines()]
    assert [found for found in lines if len(found[1]) > LONGEST_LINE] == []


def test_the_plotting_library_is_served_with_its_licence_and_needs_no_package(
    client: httpx.Client, document: Document
) -> None:
    (folder,) = {address.rpartition("/")[0] for address in document.plots}
    script = client.get(f"{folder}/bokeh.min.js").text
    assert "Redistribution and use in source and binary forms" in script
    assert "Redistribution and use" in (files("gcs.page") / "vendor" / "LICENSE.txt").read_text(encoding="utf-8")
    assert "bokeh" not in (Path(__file__).parents[3] / "pyproject.toml").read_text(encoding="utf-8")


def test_the_page_can_be_put_on_a_home_screen(client: httpx.Client, document: Document) -> None:
    manifest = client.get("/manifest.webmanifest")
    assert manifest.headers["content-type"] == "application/manifest+json"
    found = manifest.json()
    assert (found["display"], found["start_url"]) == ("standalone", "/#/live")
    (picture,) = found["icons"]
    assert "<svg" in client.get(picture["src"]).text
    shell = client.get("/shell.js")
    assert shell.headers["cache-control"] == "no-cache"
    # All that the document loads, and nothing of the interface.
    assert all(f'"{address}"' in shell.text for address in document.loaded)
    assert "/api/" not in shell.text
