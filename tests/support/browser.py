"""The page in Debian's Chromium and Firefox, driven by Playwright, and axe-core's check of accessibility."""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from older_firefox import let_scripts_in
from PIL import Image
from playwright.sync_api import Browser, Page, Playwright
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
def chromium(playwright: Playwright) -> Iterator[Browser]:
    """A browser of its own. AssertionError where Chromium is not installed."""
    program = shutil.which("chromium")
    assert program, "these tests need Debian's chromium: apt-get install chromium"
    browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
    try:
        yield browser
    finally:
        browser.close()


@contextmanager
def firefox(playwright: Playwright) -> Iterator[Browser]:
    """A browser of its own, by the protocol that browsers share, WebDriver BiDi. AssertionError where it is missing."""
    program = shutil.which("firefox-esr") or shutil.which("firefox")
    assert program, "these tests need Debian's Firefox: apt-get install firefox-esr"
    browser = playwright.firefox.launch(channel="moz-firefox", executable_path=program)
    try:
        yield browser
    finally:
        browser.close()


class Visitor:
    """Somebody who looks at the page, and notes what goes wrong in it."""

    def __init__(self, browser: Browser, url: str, axe: Path, size: str = "desktop") -> None:
        width, height = SIZES[size]
        self._size, self._axe = size, axe.read_text(encoding="utf-8")
        # Firefox makes no phone of itself: its window is as wide as one.
        self._chromium = browser.browser_type.name == "chromium"
        phone = {"has_touch": size == "phone", "is_mobile": size == "phone"} if self._chromium else {}
        self._context = browser.new_context(viewport={"width": width, "height": height}, **phone)
        let_scripts_in(self._context, browser)
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

    def downloaded(self, selector: str) -> bytes:
        """What a click on a button or a link hands to the user as a file."""
        if self._chromium:
            with self.page.expect_download() as download:
                self.page.click(selector)
            return Path(download.value.path()).read_bytes()
        # Of what Firefox saves the protocol says nothing yet: seen is what it is given to save.
        if self.page.eval_on_selector(selector, "element => element.matches('a[href]')"):
            fetched = "async link => (await fetch(link.href)).text()"
            return str(self.page.eval_on_selector(selector, fetched)).encode()
        self.page.evaluate("""() => {
            const make = URL.createObjectURL
            window.handed = null
            URL.createObjectURL = blob => { window.handed = blob; return make.call(URL, blob) }
        }""")
        self.page.click(selector)
        wait_until(lambda: self.page.evaluate("window.handed !== null"))
        return str(self.page.evaluate("window.handed.text()")).encode()

    def check(self, name: str = "") -> None:
        """No violation that axe-core finds, no script error, nothing from elsewhere, nothing wider than the screen.

        name: of the picture, kept where the variable PAGE_PICTURES names a folder.
        """
        if self._chromium:
            session = self._context.new_cdp_session(self.page)
            session.send("Runtime.evaluate", {"expression": self._axe})
        else:
            self.page.evaluate(self._axe)
        found = self.page.evaluate("axe.run()")
        told = [(v["id"], [node["target"] for node in v["nodes"]], v["help"]) for v in found["violations"]]
        assert told == [], f"{self._size} {name}"
        assert found["passes"]
        assert self.errors == []
        assert self.strangers == []
        assert self.page.evaluate("document.documentElement.scrollWidth") <= SIZES[self._size][0]
        assert self.page.evaluate(_CUT_CAPTIONS) == []
        if name:
            self.check_other_widths()
        folder = os.environ.get("PAGE_PICTURES")
        if folder and name:
            self.page.mouse.move(0, 0)  # else the button pressed last is drawn as pointed at
            picture = Image.open(io.BytesIO(self.page.screenshot()))
            small = picture.convert("RGB").quantize(_COLOURS)
            small.save(Path(folder) / f"page-{name}-{self._size}.png", optimize=True)

    def check_other_widths(self) -> None:
        """Nothing is wider than the screen on a small phone, a tablet and a wide desk either."""
        width, height = SIZES[self._size]
        for other in OTHER_WIDTHS:
            self.page.set_viewport_size({"width": other, "height": height})
            # Plots follow a moment later.
            wait_until(lambda: self.page.evaluate("document.documentElement.scrollWidth") <= other, 20.0)  # noqa: B023
        self.page.set_viewport_size({"width": width, "height": height})

    def close(self) -> None:
        self._context.close()
