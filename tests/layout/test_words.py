"""The field's words: what private vocabulary once stood for several things stays gone."""

from __future__ import annotations

import re

from doc_commands import PAGES, ROOT

# Each had several meanings; a textbook has one word for each of them: estimated, reported, identifiable, undelayed ...
PRIVATE = re.compile(r"(?<![a-z])(told|tells?|telling|feign\w*|prompt|punctual\w*)(?![a-z])", re.IGNORECASE)
SOURCES = [
    path
    for package in ("sim_vehicle", "sysid", "gcs", "flightmodel")
    for suffix in ("py", "js", "html")
    for path in sorted((ROOT / package).rglob(f"*.{suffix}"))
    if "vendor" not in path.parts
]
# Python's name of a position in a file.
ALLOWED = ".tell()"


def test_no_private_word_is_left() -> None:
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path in [*SOURCES, *PAGES]
        for line in path.read_text(encoding="utf-8").replace(ALLOWED, "").splitlines()
        if PRIVATE.search(line)
    ]
    assert found == []
