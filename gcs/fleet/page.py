"""The report of a fleet, as one HTML page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from gcs.fleet.together import Fleet, as_it_is
from gcs.report.markup import estimate, listing, number, p_value, paragraph, section, table, text
from gcs.report.page import document
from gcs.text.utctext import utc_text
from gcs.vehicles.trends import Change, Trend

_MOST_FIGURES = 12


def fleet_page(fleet: Fleet, rows: Sequence[Mapping[str, Any]], what: str = "flights") -> str:
    """The page. rows: the table that the fleet was made of. what: its rows are, flights or campaigns."""
    from gcs.report.svg import Drawing, element

    begun = {str(row["source"]): int(row["start_ns"]) for row in rows}
    figures = [
        Drawing(f"change{place}", f"{name} of {aircraft} over its flights, with 95 % intervals, and the step",
                (7.0, 2.4), partial(_draw, trend=fleet.trends[aircraft][name], change=change))
        for place, (aircraft, name, change) in enumerate(fleet.changes[:_MOST_FIGURES])
    ]  # fmt: skip
    counts = Counter(str(row["aircraft"]) for row in rows if not row["error"])
    flown = ", ".join(f"{aircraft} ({counts[aircraft]} {what})" for aircraft in fleet.trends)
    return document(
        f"Fleet of {len(fleet.trends)} aircraft",
        paragraph(f"{len(rows)} {what}, of which {len(fleet.failed)} have no result. {flown}."),
        section("Changes", *_change_words(fleet, begun), *map(element, figures)),
        section("Flights unlike the others", _outlier_table(fleet)),
        section("Coefficients", _coefficients(fleet)),
        section("Flights without a result", listing([f"{text(name)}: {text(why)}" for name, why in fleet.failed])),
    )


def change_line(aircraft: str, name: str, change: Change, start_ns: int) -> str:
    """One change in words: what, from when on, by how much, and how surely."""
    apart = change.after - change.before
    by = f"{100.0 * apart / change.before:+.1f} %" if abs(change.before) > abs(apart) else f"{apart:+.3g}"
    return (
        f"{aircraft}: {name} changed by {by} between the flights before {utc_text(start_ns)[:16]}Z and those"
        f" from then on ({change.before:.4g} ± {change.before_std:.2g} to {change.after:.4g} ± {change.after_std:.2g};"
        f" p {change.p:.1g} over all coefficients of all aircraft)"
    )


def _change_words(fleet: Fleet, begun: Mapping[str, int]) -> list[str]:
    if not fleet.changes:
        return [paragraph("No coefficient of any aircraft has changed by more than chance explains.")]
    lines = [change_line(aircraft, name, one, begun[one.flight]) for aircraft, name, one in fleet.changes]
    return [listing([text(line) for line in lines])]


def _outlier_table(fleet: Fleet) -> str:
    rows = [
        [text(one.flight), text(one.aircraft), text(one.name), number(one.off, 3), p_value(one.p)]
        for one in fleet.outliers
    ]
    head = ["Flight", "Aircraft", "Coefficient", "Standard errors off", "p"]
    return table("Estimates that are none of their aircraft", head, rows)


def _coefficients(fleet: Fleet) -> str:
    """A row a coefficient: each aircraft's mean, the fleet's, and by how much aircraft differ."""
    changed = {(aircraft, name) for aircraft, name, _ in fleet.changes}
    rows = []
    for name, mean in fleet.means.items():
        own = []
        for aircraft, each in fleet.trends.items():
            is_other = (aircraft, name) in changed
            own.append(
                _pair(*as_it_is(each[name], is_other)) + (" (changed)" if is_other else "") if name in each else ""
            )
        rows.append([text(name), *own, _pair(mean.mean, mean.std), number(mean.scatter, 2)])
    head = ["Coefficient", *map(text, fleet.trends), "Fleet", "Between aircraft, 1 σ"]
    return table("Means over flights, and over aircraft (random effects), ± 1 σ", head, rows)


def _pair(value: float, std: float) -> str:
    return f"{estimate(value, std)} ± {number(std, 2)}"


def _draw(made: Any, trend: Trend, change: Change) -> None:
    plot = made.subplots()
    places = range(1, len(trend.estimates) + 1)
    values, bars = [one.value for one in trend.estimates], [1.96 * one.std for one in trend.estimates]
    plot.errorbar(places, values, yerr=bars, fmt="o", markersize=3.0, linewidth=0.8)
    step = next(place for place, one in enumerate(trend.estimates) if one.flight == change.flight) + 0.5
    plot.hlines([change.before, change.after], [0.5, step], [step, len(trend.estimates) + 0.5], color="#c0392b")
    plot.set_xlabel("flight")
    plot.set_ylabel(trend.name)
