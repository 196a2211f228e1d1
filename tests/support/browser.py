"""The page in a real browser: Debian's Chromium, driven by Playwright, and axe-core's check of accessibility."""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright
from traffic import wait_until

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update",
)  # fmt: skip
SIZES = {"phone": (390, 844), "desktop": (1280, 800)}
OTHER_WIDTHS = (360, 1024, 1440)
PATIENCE_MS = 60_000
_COLOURS = 64
# Captions of tables that go on beyond the screen, where the table may.
_CUT_CAPTIONS = """[...document.querySelectorAll('caption')]
  .filter(one => one.getBoundingClientRect().right > innerWidth + 1).map(one => one.textContent)"""


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser of its own. AssertionError where Chromium is not installed."""
    program = shutil.which("chromium")
    assert program, "these tests need Debian's chromium: apt-get install chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        try:
            yield browser
        finally:
            browser.close()


class Visitor:
    """Somebody who looks at the page, and notes what goes wrong in it."""

    def __init__(self, browser: Browser, url: str, axe: Path, size: str = "desktop") -> None:
        width, height = SIZES[size]
        self._size, self._axe = size, axe.read_text(encoding="utf-8")
        self._context = browser.new_context(
            viewport={"width": width, "height": height}, has_touch=size == "phone", is_mobile=size == "phone"
        )
        self.page: Page = self._context.new_page()
        self.page.set_default_timeout(PATIENCE_MS)
        self.url = url
        self.errors: list[str] = []
        self.strangers: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", self._note)

    def _note(self, request: Any) -> None:
        if not request.url.startswith((self.url, "data:", "blob:")):
            self.strangers.append(request.url)

    def open(self, address: str) -> None:
        """Go to a view, and wait until it is there."""
        self.page.goto(f"{self.url}/{address}")
        self.page.wait_for_selector("main:not([aria-busy]) h1")

    def text(self, selector: str) -> str:
        return self.page.inner_text(selector)

    def wait_for_text(self, selector: str, words: str, timeout_ms: int = PATIENCE_MS) -> None:
        """Wait until the element shows the words."""
        self.page.locator(selector, has_text=words).first.wait_for(timeout=timeout_ms)

    def wait_for_plots(self, count: int) -> None:
        """Wait until so many plots are drawn: each has a canvas of the plotting library."""
        wait_until(lambda: self.page.locator(".plot canvas").count() >= count)

    def check(self, name: str = "") -> None:
        """No violation that axe-core finds, no script error, nothing from elsewhere, nothing wider than the screen.

        name: of the picture, kept where the variable PAGE_PICTURES names a folder.
        """
        session = self._context.new_cdp_session(self.page)
        session.send("Runtime.evaluate", {"expression": self._axe})
        found = self.page.evaluate("axe.run()")
        told = [(v["id"], [node["target"] for node in v["nodes"]], v["help"]) for v in found["violations"]]
        assert told == [], f"{self._size} {name}"
        assert found["passes"]
        assert self.errors == []
        assert self.strangers == []
        assert self.page.evaluate("document.documentElement.scrollWidth") <= SIZES[self._size][0]
        assert self.page.evaluate(_CUT_CAPTIONS) == []
        if name:
            self._check_other_widths()
        folder = os.environ.get("PAGE_PICTURES")
        if folder and name:
            self.page.mouse.move(0, 0)  # else the button pressed last is drawn as pointed at
            picture = Image.open(io.BytesIO(self.page.screenshot()))
            small = picture.convert("RGB").quantize(_COLOURS)
            small.save(Path(folder) / f"page-{name}-{self._size}.png", optimize=True)

    def _check_other_widths(self) -> None:
        """Nothing is wider than the screen on a small phone, a tablet and a wide desk either."""
        width, height = SIZES[self._size]
        for other in OTHER_WIDTHS:
            self.page.set_viewport_size({"width": other, "height": height})
            # Plots follow a moment later.
            wait_until(lambda: self.page.evaluate("document.documentElement.scrollWidth") <= other, 20.0)  # noqa: B023
        self.page.set_viewport_size({"width": width, "height": height})

    def close(self) -> None:
        self._context.close()
