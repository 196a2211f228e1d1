"""Equations of the pages: LaTeX between dollars becomes MathML when the site is built, so no script sets it later."""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError

# What arithmatex (generic) leaves: \( \) inside a span, \[ \] inside a div.
_FOUND = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def as_mathml(page: str) -> str:
    """The HTML of a page with each equation as MathML."""
    return _FOUND.sub(_equation, page)


def _equation(found: re.Match[str]) -> str:
    tag, kind, latex = found.groups()
    set_as = convert(html.unescape(latex), display="block" if kind == "[" else "inline")
    if "&</" in set_as or "\\" in set_as:  # what the converter does not know it leaves standing
        raise PluginError(f"this equation cannot be set: {latex}")
    return f'<{tag} class="equation">{set_as}</{tag}>'
