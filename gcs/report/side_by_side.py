"""Results of several methods, or of several flights, side by side: one row a coefficient."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gcs.errors import ReportError
from gcs.report.markup import NONE, estimate, section, shown, table, text
from gcs.text.meanings import meaning

Result = Mapping[str, Any]
_SHORT = {"ee": "equation error", "oe": "output error", "fe": "filter error", "map": "output error with priors"}


def headings(results: Sequence[Result]) -> list[str]:
    """What distinguishes each result: its method, and its flights where these differ.

    Raises ReportError for a result of another schema.
    """
    for one in results:
        if not isinstance(one, dict) or one.get("schema") != "identification/1":
            raise ReportError("only results of gcs identify stand beside one another")
    flights = [", ".join(map(str, one.get("flights") or [])) for one in results]
    methods = [_SHORT.get(str(one.get("method")), str(one.get("method"))) for one in results]
    found = methods
    if len(set(flights)) > 1:
        found = [f"{method}, {flight}" for method, flight in zip(methods, flights, strict=True)]
    return found if len(set(found)) == len(found) else [f"{number}: {one}" for number, one in enumerate(found, 1)]


def names(results: Sequence[Result]) -> list[str]:
    """Coefficients that any of them has a value of, in the order of the first."""
    return list(
        dict.fromkeys(n for one in results for n, e in one["model"]["coefficients"].items() if e["value"] is not None)
    )


def side_by_side(results: Sequence[Result]) -> str:
    """A section with the table; nothing for a single result."""
    if len(results) < 2:
        return ""
    rows = []
    for name in names(results):
        cells = [f'<abbr title="{text(meaning(name) or name)}">{text(name)}</abbr>']
        for one in results:
            entry = one["model"]["coefficients"].get(name) or {"value": None}
            cells.append(_cell(entry))
        rows.append(cells)
    head = ["coefficient", *(text(one) for one in headings(results))]
    caption = "Estimates with one standard error. Where a method gives none, its reason stands in its own report"
    return section("Side by side", table(caption, head, rows))


def _cell(entry: Result) -> str:
    if entry["value"] is None:
        return NONE
    bar = f" ± {shown(entry['std'], 2)}" if entry.get("std") else ""
    return f"{estimate(entry['value'], entry.get('std'))}{bar}"
