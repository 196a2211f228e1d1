"""What the tests of other readers and browsers share."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import SIZES, Visitor, chromium, firefox
from ground import Ground
from made_once import made_once
from node_reader import NodeReader
from older_firefox import commands_unknown_are_passed_over
from playwright.sync_api import Browser, Playwright, sync_playwright
from processes import free_port, start

DEMO_S = 600.0


@pytest.fixture(scope="session")
def node(tmp_path_factory: pytest.TempPathFactory) -> NodeReader:
    """The viewers' libraries, installed once a run."""
    return NodeReader(made_once(tmp_path_factory, "node", NodeReader.installed))


def _demo(folder: Path) -> None:
    demo = start("gcs", ["demo", "--data", folder])
    _, error = demo.communicate(timeout=DEMO_S)
    assert demo.returncode == 0, error


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Flights and results of `gcs demo`, a copy: two flights identified, two of an aircraft that hides a stall.

    The variable DEMO_OUTPUT may name the folder of an earlier run.
    """
    kept = os.environ.get("DEMO_OUTPUT")
    made = Path(kept) if kept else made_once(tmp_path_factory, "demo", _demo)
    # Services write into it, one after another; another worker's write into theirs.
    copy = tmp_path_factory.mktemp("demo")
    shutil.copytree(made / "service", copy / "service")
    return copy / "service"


@pytest.fixture(scope="module")
def ground(data: Path) -> Iterator[Ground]:
    made = Ground(data, free_port(), free_port())
    made.start()
    yield made
    made.stop()


@pytest.fixture(scope="module")
def playwright() -> Iterator[Playwright]:
    """What drives browsers; one at a time, and not for longer than a module: its event loop runs meanwhile."""
    with commands_unknown_are_passed_over(), sync_playwright() as started:
        yield started


@pytest.fixture(scope="module")
def browser(playwright: Playwright) -> Iterator[Browser]:
    """Chromium."""
    with chromium(playwright) as opened:
        yield opened


@pytest.fixture(params=list(SIZES))
def visitor(request: pytest.FixtureRequest, browser: Browser, ground: Ground, node: NodeReader) -> Iterator[Visitor]:
    made = Visitor(browser, ground.url, node.folder / "node_modules" / "axe-core" / "axe.min.js", request.param)
    yield made
    made.close()


@pytest.fixture(scope="module")
def fox(playwright: Playwright) -> Iterator[Browser]:
    """Firefox."""
    with firefox(playwright) as opened:
        yield opened
