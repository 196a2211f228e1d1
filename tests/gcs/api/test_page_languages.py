"""The page's catalogues of other languages: each text is one of the page's, and what changes in it is kept."""

from __future__ import annotations

import json
import re
from importlib.resources import files
from pathlib import Path

import pytest

from gcs.page.assets import load_assets

STATIC = files("gcs.page") / "static"
CATALOGUES = sorted(entry.name for entry in STATIC.iterdir() if entry.name.startswith("language-"))
# Texts that are said in pieces, or come from the service: composed, so that no source holds them whole.
COMPOSED = (
    *("Live: {}", "No message from the vehicle", "Flight over: the vehicle is disarmed", "A multisine of 20 s"),
    *(
        "a multisine of 20 s",
        "A 3-2-1-1",
        "a 3-2-1-1",
        "Doublets on",
        "doublets on",
        "Steps on",
        "steps on",
        "A pulse on",
    ),
    *(
        "a pulse on",
        "A roller-coaster",
        "{} and {}",
        "Identifications queued",
        "Deleted (for a day",
        "Delete {} flights?",
    ),
    *(
        "no surface has moved",
        "the first estimate",
        "the flight has only begun",
        "the aircraft is not in the air",
        "{} free",
        "{}, low",
    ),
    *("on, {}", "off, {}", "Fly now", "{}/s,", "{} of {} links connected"),
    *(
        "Attitude: roll",
        "Old attitude: roll",
        "elevator",
        "ailerons and",
        "{}, ",
        "vehicle file: mass",
        "the {} moved",
        "✓ Flown: {}.",
    ),
)


def sources() -> str:
    """All text of the page's modules and document, expressions as {} and lines joined."""
    entries = [entry for entry in sorted(Path(str(STATIC)).rglob("*")) if entry.suffix in (".js", ".html")]
    texts = [entry.read_text(encoding="utf-8") for entry in entries]
    joined = re.sub(r"['`]\s*\n\s*\+\s*['`]", "", "\n".join(texts))
    return joined + re.sub(r"\$\{[^{}]*(?:\{[^{}]*\}[^{}]*)*\}", "{}", joined)


@pytest.mark.parametrize("name", CATALOGUES)
def test_every_text_of_a_catalogue_is_one_of_the_page(name: str) -> None:
    catalogue, page = json.loads((STATIC / name).read_text(encoding="utf-8")), sources()
    assert catalogue[""]
    unknown = [english for english in catalogue if english and english not in page and not english.startswith(COMPOSED)]
    assert unknown == []


@pytest.mark.parametrize("name", CATALOGUES)
def test_what_changes_in_a_text_changes_in_the_other_language_too(name: str) -> None:
    catalogue = json.loads((STATIC / name).read_text(encoding="utf-8"))
    assert [
        english for english, other in catalogue.items() if english.count("{}") != other.replace("{t}", "{}").count("{}")
    ] == []
    assert [english for english, other in catalogue.items() if not other.strip()] == []


def test_a_language_is_only_a_file() -> None:
    assert CATALOGUES == ["language-de.json"]
    assets = load_assets()
    assert '<meta name="languages" content="de=Deutsch">' in assets.document
    (found,) = [one for address, one in assets.files.items() if address.endswith("/language-de.json")]
    assert (found.kind, json.loads(found.content)["Flights"]) == ("application/json", "Flüge")
