"""Every view of the page in Firefox, at the widths of phones and desks."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from browser import SIZES, Visitor
from ground import Ground, flight_with
from node_reader import NodeReader
from playwright.sync_api import Browser
from traffic import wait_until


@pytest.fixture(params=list(SIZES))
def visitor(request: pytest.FixtureRequest, fox: Browser, ground: Ground, node: NodeReader) -> Iterator[Visitor]:
    made = Visitor(fox, ground.url, node.folder / "node_modules" / "axe-core" / "axe.min.js", request.param)
    yield made
    made.close()


def test_every_view_is_whole_in_firefox(visitor: Visitor, ground: Ground) -> None:
    identified, questioned = (flight_with(ground, kind) for kind in ("identify", "discrepancy"))
    views = {
        "#/live": 0,
        "#/flights": 0,
        f"#/flights/{identified}?signals=airspeed,alpha~q,de": 3,
        f"#/flights/{identified}?signals=q&as=spectrum": 1,
        f"#/flights/{identified}?signals=q&as=spectrogram": 1,
        f"#/flights/{identified}?signals=alpha,q&as=xy": 1,
        f"#/flights/{identified}/model": 3,
        f"#/flights/{questioned}/discrepancy": 4,
        f"#/flights/{identified}/plan": 0,
        "#/aircraft": 0,
        "#/aircraft/new": 0,
        "#/compare": 0,
    }
    for address, plots in views.items():
        visitor.open(address)
        visitor.wait_for_plots(plots)
        visitor.check()
        visitor.check_other_widths()


def test_firefox_zooms_and_reads_values(visitor: Visitor, ground: Ground) -> None:
    visitor.open(f"#/flights/{flight_with(ground, 'identify')}?signals=airspeed,q")
    visitor.wait_for_plots(2)
    whole = visitor.text("output.span")
    visitor.page.click("button[aria-label='Zoom in']")
    wait_until(lambda: visitor.text("output.span") != whole)
    visitor.page.focus(".cursor")
    visitor.page.keyboard.press("ArrowRight")
    visitor.wait_for_text(".cursor", "airspeed")
    assert visitor.page.locator(".cursor-line:not([hidden])").count() == 2
    visitor.check()
