"""The page in German, its keys, and the countdown of what to fly next, in Chromium."""

from __future__ import annotations

import re

import pytest
from browser import SIZES, Visitor
from ground import Ground
from node_reader import NodeReader
from playwright.sync_api import Browser

VIEWS = ("#/flights", "#/aircraft", "#/aircraft/new", "#/compare", "#/live")
# English words that no German text has.
ENGLISH = re.compile(r"\b(the|is|and|with|flight|which|from|are|not|this)\b", re.IGNORECASE)


@pytest.fixture
def german(browser: Browser, ground: Ground, node: NodeReader) -> Visitor:
    made = Visitor(browser, ground.url, node.folder / "node_modules" / "axe-core" / "axe.min.js", "phone")
    made.open("#/live")
    made.page.select_option("#language", "de")
    made.page.wait_for_selector("html[lang=de]")
    return made


def test_every_view_is_german(german: Visitor) -> None:
    for view in VIEWS:
        german.open(view)
        left = [
            line
            for line in german.page.inner_text("body").splitlines()
            if len(ENGLISH.findall(line)) > 1 and "GCS" not in line
        ]
        assert not left, f"{view}: {left}"
        german.check()
    german.open("#/flights")
    assert german.page.title() == "Flüge – Bodenstation"
    assert german.text("h1") == "Flüge"
    german.close()


def test_a_key_does_what_its_list_says_and_none_is_taken_from_who_types(browser: Browser, ground: Ground) -> None:
    page = browser.new_page(viewport={"width": SIZES["desktop"][0], "height": SIZES["desktop"][1]})
    page.goto(f"{ground.url}/#/live")
    page.wait_for_selector("main:not([aria-busy]) h1")
    page.keyboard.press("2")
    page.wait_for_selector("h1:text-is('Flights')")
    page.keyboard.press("?")
    page.wait_for_selector("dialog[open]")
    assert "Mark this moment" in page.inner_text("dialog")
    page.keyboard.press("Escape")
    page.wait_for_selector("dialog", state="detached")
    page.keyboard.press("1")
    page.wait_for_selector(".note-form")
    page.keyboard.press("n")
    page.keyboard.type("2 gusts?")
    assert page.input_value(".note-form input") == "2 gusts?"
    assert page.url.endswith("#/live")
    page.keyboard.press("Tab")
    page.keyboard.press("?")
    page.uncheck("dialog input")
    page.keyboard.press("Escape")
    page.keyboard.press("2")
    page.wait_for_timeout(300)
    assert page.url.endswith("#/live")
    page.close()


def test_a_manoeuvre_is_counted_down_and_judged_by_the_surface(browser: Browser, ground: Ground) -> None:
    page = browser.new_page()
    page.goto(f"{ground.url}/#/live")
    page.wait_for_selector("main:not([aria-busy]) h1")
    # The card alone, with signals made here: an elevator that moves by 3 deg, and one that rests.
    addresses = "[...document.querySelectorAll('link[rel=modulepreload]')].map(link => link.href)"
    module = next(one for one in page.evaluate(addresses) if one.endswith("/flynext.js"))
    page.evaluate(
        """async address => {
          const { FlyNext } = await import(address)
          const card = new FlyNext()
          window.card = card
          document.body.append(card.element)
          card.element.id = 'card'
          card.show({ Cm_de: { known: false, fly: 'elevator-pulse' } })
          card.begin()
          window.size = 0.05
          let n = 0
          setInterval(() => card.feel({ de: window.size * (n++ % 2 ? 1 : -1) }), 20)
        }""",
        module,
    )
    page.wait_for_selector("#card :text('Begins in')")
    page.wait_for_selector("#card :text('Fly now')", timeout=10_000)
    page.wait_for_selector("#card :text('✓ Flown: the elevator moved by 2.9° rms.')", timeout=10_000)
    page.evaluate("() => { window.size = 0.001; window.card.begin() }")
    page.wait_for_selector("#card :text('The elevator hardly moved (0.1° rms)')", timeout=15_000)
    assert page.inner_text("#card .next-count") == "The elevator hardly moved (0.1° rms): fly it again, larger."
    assert page.inner_text("#card button") == "Count down"
    page.close()
