"""Figures of matplotlib as SVG inside a page, and as files."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

_STYLE: Any = {
    "svg.fonttype": "none", "svg.hashsalt": "report", "font.size": 8.0, "font.family": "sans-serif", "axes.grid": True,
    "grid.alpha": 0.3, "axes.axisbelow": True, "lines.linewidth": 0.9, "figure.facecolor": "none",
}  # fmt: skip
_DOTS_PER_INCH = 130
# From so many columns on, matplotlib's own number of ticks leaves no room for labels like -0.005.
_NARROW, _FEW_INTERVALS = 3, 3
MEASURED, PREDICTED, LIMIT = "#4c78a8", "#c0392b", "#777777"


def figure(name: str, caption: str, size: tuple[float, float], draw: Callable[[Figure], None]) -> str:
    """A figure element with an SVG drawn by `draw` on a Figure of `size` (inches).

    name: unique in the page; it goes before every identifier. caption: text, which is the picture's description too.
    """
    with mpl.rc_context(_STYLE):
        made = Figure(figsize=size, layout="constrained")
        draw(made)
        buffer = io.StringIO()
        made.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    label = f'<svg role="img" aria-label="{escape(caption)}"'
    inside = _inline(buffer.getvalue(), name).replace("<svg", label, 1)
    return f"<figure>\n{inside}\n<figcaption>{escape(caption)}</figcaption>\n</figure>"


def save(path: Path, size: tuple[float, float], draw: Callable[[Figure], None]) -> None:
    """The same figure as a PNG file on white."""
    with mpl.rc_context(_STYLE):
        made = Figure(figsize=size, layout="constrained", facecolor="white")
        draw(made)
        made.savefig(path, dpi=_DOTS_PER_INCH, metadata={"Software": None})


def _inline(svg: str, name: str) -> str:
    """An SVG document as an element of HTML: no prologue, no namespaces, no metadata, identifiers of its own."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<style.*?</style>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\s+xmlns(:\w+)?="[^"]*"', "", svg)
    svg = re.sub(r"<!--.*?-->", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = svg.replace("url(#", f"url(#{name}-")
    return re.sub(r'xlink:href="#', f'href="#{name}-', svg)


def pages(figure_: Figure, count: int, columns: int) -> list[Any]:
    """`count` axes in so many columns."""
    rows = -(-count // columns)
    axes = figure_.subplots(rows, columns, squeeze=False).ravel().tolist()
    for empty in axes[count:]:
        empty.set_visible(False)
    if columns >= _NARROW:
        for plot in axes[:count]:
            plot.locator_params(axis="x", nbins=_FEW_INTERVALS)
    return axes[:count]
