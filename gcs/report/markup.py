"""Pieces of HTML: escaped text, numbers that keep their full value beside what is shown, tables, sections."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from html import escape, unescape
from typing import Any

from gcs.text.probability_text import probability_text
from sysid.discrepancy.wording import LEAST_EXPONENT, too_small

NONE = '<span aria-label="none">–</span>'


def number(value: float | None, digits: int = 4, factor: float = 1.0) -> str:
    """A number to `digits` significant digits, times `factor`; the element's value is the result file's own."""
    if value is None:
        return NONE
    return f'<data value="{value!r}">{shown(value * factor, digits)}</data>'


def p_value(value: float | None, digits: int = 2) -> str:
    """A p value; what underflow left as zero is below what can be shown."""
    if value is None or not too_small(value):
        return number(value, digits)
    return f'<data value="{value!r}">&lt; 10<sup>{str(LEAST_EXPONENT).replace("-", "−")}</sup></data>'


def probability(value: float | None) -> str:
    """A posterior probability, certain to no more digits than it is."""
    return NONE if value is None else f'<data value="{value!r}">{escape(probability_text(value))}</data>'


def shown(value: float, digits: int = 4) -> str:
    """The number as people read it: a true minus sign, powers of ten in words of the field."""
    text = f"{value:.{digits}g}"
    if "e" in text:
        mantissa, _, power = text.partition("e")
        return f"{mantissa.replace('-', '−')}·10<sup>{str(int(power)).replace('-', '−')}</sup>"
    return text.replace("-", "−")


def estimate(value: float, std: float | None, factor: float = 1.0) -> str:
    """A value to the digits that its standard error allows."""
    places = decimals(value * factor, None if std is None else std * factor)
    if places is None:
        return number(value, 4, factor)
    digits = f"{value * factor:.{places}f}".replace("-", "−")
    digits = digits if digits.strip("−0.") else digits.lstrip("−")
    return f'<data value="{value!r}">{digits}</data>'


def standard_error(std: float | None) -> str:
    """A standard error to two digits, the last one too where it is zero."""
    return NONE if std is None else estimate(std, std)


def decimals(value: float, std: float | None) -> int | None:
    """Decimal places that show two digits of the standard error; None where digits do not show it."""
    if std is None or not 0.0 < std < math.inf or abs(value) >= 1e6:
        return None
    places = 1 - math.floor(math.log10(std))
    return max(places, 0) if places <= 8 else None


def table(caption: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table whose first column names its rows. caption: text. head, cells: HTML. Nothing where there are no rows."""
    if not rows:
        return ""
    top = "".join(f'<th scope="col">{cell}</th>' for cell in head)
    # On a phone the cells of a row stand below one another, each behind its heading.
    names = [escape(unescape(re.sub(r"<[^>]*>", "", cell)), quote=True) for cell in head[1:]]
    body = "\n".join(
        f'<tr><th scope="row">{row[0]}</th>'
        + "".join(f'<td data-heading="{name}">{cell}</td>' for name, cell in zip(names, row[1:], strict=True))
        + "</tr>"
        for row in rows
    )
    return (
        f'<div class="wide"><table>\n<caption>{escape(caption)}</caption>\n<thead><tr>{top}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody>\n</table></div>"
    )


def listing(items: Sequence[str]) -> str:
    """A list of HTML items; nothing where there are none."""
    return "<ul>" + "".join(f"<li>{item}</li>" for item in items) + "</ul>" if items else ""


def paragraph(text: str) -> str:
    """A paragraph of plain text; nothing where there is none."""
    return f"<p>{escape(text)}</p>" if text else ""


def section(title: str, *parts: str) -> str:
    """A section with its heading; nothing where there is nothing in it."""
    inside = "\n".join(part for part in parts if part)
    if not inside:
        return ""
    name = anchor(title)
    return f'<section aria-labelledby="{name}">\n<h2 id="{name}">{escape(title)}</h2>\n{inside}\n</section>'


def folded(title: str, *parts: str) -> str:
    """A section that opens by its heading; printed it is open. Nothing where there is nothing in it."""
    inside = "\n".join(part for part in parts if part)
    if not inside:
        return ""
    heading = f"<summary><h2>{escape(title)}</h2></summary>"
    # A link to what a closed one holds opens it.
    return f'<details class="more">\n{heading}\n<div id="{anchor(title)}">\n{inside}\n</div>\n</details>'


def contents(parts: Sequence[str]) -> str:
    """Links to folded sections, in their order."""
    titles = [found[1] for part in parts if (found := re.search(r"<summary><h2>(.*?)</h2>", part))]
    links = "".join(f'<li><a href="#{anchor(unescape(title))}">{title}</a></li>' for title in titles)
    return f'<nav aria-label="Contents"><ul class="contents">{links}</ul></nav>' if titles else ""


def anchor(title: str) -> str:
    """What links to a section of that title name."""
    return "".join(letter if letter.isalnum() else "-" for letter in title.lower())


def text(value: Any) -> str:
    """Any value as escaped text."""
    return escape(str(value))
