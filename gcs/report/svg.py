"""Figures of matplotlib as SVG inside a page, and as files."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from sysid.arrays import Array

_STYLE: Any = {
    "svg.fonttype": "none", "svg.hashsalt": "report", "font.size": 8.0, "font.family": "sans-serif", "axes.grid": True,
    "grid.alpha": 0.3, "axes.axisbelow": True, "lines.linewidth": 0.9, "figure.facecolor": "none",
}  # fmt: skip
_DOTS_PER_INCH = 130
# From so many columns on, matplotlib's own number of ticks leaves no room for labels like -0.005.
_NARROW, _FEW_INTERVALS = 3, 3
MEASURED, PREDICTED, LIMIT = "#4c78a8", "#c0392b", "#777777"


@dataclass(frozen=True)
class Drawing:
    """A figure before it is drawn, by `draw` on a Figure of `size` (inches).

    name: unique in the page; it goes before every identifier. caption: text, which is the picture's description too.
    """

    name: str
    caption: str
    size: tuple[float, float]
    draw: Callable[[Figure], None]

    def drawn(self, facecolor: str = "none") -> Figure:
        """The figure, in the report's style."""
        with mpl.rc_context(_STYLE):
            made = Figure(figsize=self.size, layout="constrained", facecolor=facecolor)
            self.draw(made)
        return made


def element(drawing: Drawing) -> str:
    """A figure element with an SVG inside."""
    name, caption = drawing.name, drawing.caption
    made = drawing.drawn()
    with mpl.rc_context(_STYLE):
        buffer = io.StringIO()
        made.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    label = f'<svg role="img" aria-label="{escape(caption)}"'
    inside = _inline(buffer.getvalue(), name).replace("<svg", label, 1)
    return f"<figure>\n{inside}\n<figcaption>{escape(caption)}</figcaption>\n</figure>"


def save(path: Path, size: tuple[float, float], draw: Callable[[Figure], None]) -> None:
    """The same figure as a PNG file on white."""
    Drawing(path.stem, "", size, draw).drawn("white").savefig(path, dpi=_DOTS_PER_INCH, metadata={"Software": None})


def publish(drawing: Drawing, folder: Path) -> list[Path]:
    """The figure as SVG and PDF with letters that stay letters, and what it shows as CSV, in files named after it."""
    made = drawing.drawn("white")
    base = re.sub(r"[^A-Za-z0-9_-]+", "-", drawing.name)
    with mpl.rc_context({**_STYLE, "pdf.fonttype": 42}):
        for ending, metadata in ((".svg", {"Date": None}), (".pdf", {"CreationDate": None})):
            made.savefig(folder / f"{base}{ending}", metadata=metadata)
    data = folder / f"{base}.csv"
    with data.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("plot", "curve", "x", "y", "value"))
        for number, plot in enumerate(made.axes, 1):
            title = f"{number} {plot.get_title() or plot.get_ylabel()}".strip()
            for curve, points in _shown(plot):
                rows.writerows((title, curve, *point) for point in points)
    return [folder / f"{base}{ending}" for ending in (".svg", ".pdf")] + [data]


def _shown(plot: Axes) -> Iterator[tuple[str, Array]]:
    """What a plot shows: name of each curve, and its (N, 2) points; of a bar its middle and height, of a picture
    (N, 3) column, row and value; of a band the corners of its outline.
    """
    for place, line in enumerate(plot.get_lines(), 1):
        label = str(line.get_label())
        yield str(place) if label.startswith("_") else label, np.asarray(line.get_xydata(), dtype=np.float64)
    for stems in plot.collections:
        if isinstance(stems, PolyCollection):
            for path in stems.get_paths():
                yield "band", np.asarray(path.vertices, dtype=np.float64)
        elif isinstance(stems, LineCollection):
            yield "stems", np.array([segment[-1] for segment in stems.get_segments()], dtype=np.float64)
    bars = [patch for patch in plot.patches if isinstance(patch, Rectangle)]
    if bars:
        yield "bars", np.array([(bar.get_x() + 0.5 * bar.get_width(), bar.get_height()) for bar in bars])
    for image in plot.images:
        values = np.asarray(image.get_array(), dtype=np.float64)
        yield "picture", np.array([(x, y, value) for (y, x), value in np.ndenumerate(values)])


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
