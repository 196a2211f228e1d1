"""Firefox before 153 under Playwright, which asks for what only later ones know.

Debian's release has 140; a later one comes from its security archive, which is at times out of reach.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

from playwright.sync_api import Browser, BrowserContext, Route

# The first version that the tests run in as it is.
_FIRST_WHOLE = 153
_DRIVER = Path(__file__).with_suffix(".cjs")
_POLICY = "content-security-policy"


@contextmanager
def commands_unknown_are_passed_over() -> Iterator[None]:
    """The driver that starts meanwhile goes on where Firefox does not know a command."""
    options = f"{os.environ.get('NODE_OPTIONS', '')} --require={_DRIVER}".strip()
    with patch.dict(os.environ, {"NODE_OPTIONS": options}):
        yield


def let_scripts_in(context: BrowserContext, browser: Browser) -> None:
    """An older Firefox holds Playwright's own questions to the page's policy: the page comes without one there."""
    if browser.browser_type.name == "firefox" and int(browser.version.split(".")[0]) < _FIRST_WHOLE:
        context.route("**/*", _without_policy)
        # The service worker would bring the page again, with its policy.
        context.add_init_script("delete Navigator.prototype.serviceWorker")


def _without_policy(route: Route) -> None:
    if route.request.resource_type != "document":
        route.continue_()
        return
    answer = route.fetch()
    kept = {name: value for name, value in answer.headers.items() if name.lower() != _POLICY}
    route.fulfill(response=answer, headers=kept)
