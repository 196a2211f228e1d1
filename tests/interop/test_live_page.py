"""The live view in Chromium as somebody reads it: nothing is taken from under the eyes, nothing old passes for new."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from browser import Visitor, chromium
from ground import Ground
from node_reader import NodeReader
from playwright.sync_api import Browser
from processes import TIMEOUT_S, free_port, start
from traffic import wait_until

COEFFICIENTS = ".wide:has(caption:text-matches('^Coefficients in flight'))"
LINKS = ".wide:has(th:text-is('Stray bytes'))"
# What hangs on an element staying in the page: the focus, how far it is moved sideways, where its row stands.
PLACE = """region => [document.activeElement === region, region.scrollLeft,
  Math.round(region.querySelector('tbody tr').getBoundingClientRect().top)]"""
# In large type the table of coefficients is wider than this and is moved sideways; on a phone its rows wrap.
TABLET = {"width": 740, "height": 844}


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ground]:
    made = Ground(tmp_path_factory.mktemp("live"), free_port(), free_port())
    made.start()
    yield made
    made.stop()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as opened:
        yield opened


@pytest.fixture
def phone(browser: Browser, ground: Ground, node: NodeReader) -> Iterator[Visitor]:
    made = Visitor(browser, ground.url, node.folder / "node_modules" / "axe-core" / "axe.min.js", "phone")
    yield made
    made.close()


@contextmanager
def flying(ground: Ground, *options: object) -> Iterator[None]:
    """A vehicle that flies in real time; straight on, so that hardly any coefficient becomes known."""
    command = ("fly", "--vehicle", "iitb-mav", "--seed", 5, "--duration", 600, *options)
    simulator = start("sim-vehicle", [*command, "--out", f"udpout:127.0.0.1:{ground.udp}"])
    with simulator:
        try:
            yield
        finally:
            simulator.kill()
            simulator.communicate(timeout=TIMEOUT_S)


def counted(ground: Ground) -> Callable[[], float]:
    """How many seconds of flight went into the estimates since it was called."""
    begun = ground.get("/api/live")["identification"]["time_s"]
    return lambda: float(ground.get("/api/live")["identification"]["time_s"]) - begun


def test_tables_are_read_in_peace(phone: Visitor, ground: Ground) -> None:
    with flying(ground, "--manoeuvre", "cruise"):
        phone.open("#/live")
        phone.wait_for_text(f"{COEFFICIENTS} tbody tr:last-child", "rudder-multisine")
        phone.wait_for_text(LINKS, "receiving")
        phone.wait_for_plots(3)
        for table in (COEFFICIENTS, LINKS):
            assert phone.page.locator(table).evaluate("one => one.scrollWidth <= one.clientWidth"), (
                "wider than the phone"
            )
        phone.check()
        stay_where_they_are(phone, ground)
        phone.page.set_viewport_size(TABLET)
        phone.page.evaluate("document.documentElement.style.fontSize = '28px'")
        phone.page.wait_for_timeout(2000)  # the plots above the tables are laid out anew
        stay_where_they_are(phone, ground)
        assert phone.page.locator(COEFFICIENTS).evaluate("one => one.scrollLeft") == 50


def stay_where_they_are(phone: Visitor, ground: Ground) -> None:
    """Both tables keep the focus and their places over estimates and news of the links."""
    for table in (COEFFICIENTS, LINKS):
        region = phone.page.locator(table)
        region.evaluate("one => one.focus({ preventScroll: true })")
        region.evaluate("one => one.querySelector('tbody tr').scrollIntoView({ behavior: 'instant' })")
        region.evaluate("one => { one.scrollLeft = 50 }")
        focused, *before = region.evaluate(PLACE)
        assert focused
        seconds = counted(ground)
        wait_until(lambda more=seconds: more() > 3.0)  # the links are asked for every 2 s
        focused, *after = region.evaluate(PLACE)
        assert focused
        assert after[0] == before[0]
        if table == COEFFICIENTS:  # the links are the end of the page, which cannot be brought to the top
            assert after[1] == pytest.approx(before[1], abs=2.0)
