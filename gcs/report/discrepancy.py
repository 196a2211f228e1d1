"""Tables and figure of a discrepancy's result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gcs.report.discrepancy_figures import STAGES, shown_gaps
from gcs.report.markup import estimate, number, p_value, probability, standard_error, table, text
from gcs.text.intervals import interval

Result = Mapping[str, Any]


def where(result: Result) -> str:
    """Axes and variables with which measurement and model disagree."""
    rows = [
        [text(one["axis"]), text(one["variable"]), number(one.get("share"), 3), p_value(one.get("p_value")),
         str(len(one.get("intervals", [])))]
        for one in result.get("where", [])
    ]  # fmt: skip
    head = ["axis", "over", "share of the gap", "p value", "intervals"]
    return table("Where the model and the flight disagree", head, rows)


def effects(result: Result) -> list[str]:
    """Per effect its probability, its parameters, and what it may be instead."""
    found = []
    for effect in result.get("effects", []):
        rows = []
        for name, entry in effect.get("parameters", {}).items():
            ends, std = interval(entry), entry.get("std")
            between = "–" if ends is None else f"{estimate(ends[0], std)} … {estimate(ends[1], std)}"
            value, error = estimate(entry["value"], std), standard_error(std)
            rows.append([f"<code>{text(name)}</code>", value, error, between, text(entry.get("unit", ""))])
        title = effect.get("title", effect["name"])
        found.append(f"<p>{text(title)}: probability {probability(effect.get('probability'))}.</p>")
        head = ["parameter", "value", "± (1 σ)", "95 % interval", "unit"]
        found.append(table(f"Parameters of {title}", head, rows))
        others = [f"{text(o['name'])} ({probability(o.get('probability'))})" for o in effect.get("alternatives", [])]
        if others:
            found.append(
                f"<p>Or: {', '.join(others)}. To distinguish them: {text(effect['separating_manoeuvre'])}.</p>"
            )
    return found


def gaps(result: Result) -> list[str]:
    """RMS of measured minus free-running simulation, on the flights fitted to and on others."""
    found = []
    for use, gap in shown_gaps(result).items():
        stages = [stage for stage in STAGES if gap.get(stage)]
        outputs = list(dict.fromkeys(name for stage in stages for name in gap[stage]))
        rows = [[text(name), *(number(gap[stage].get(name)) for stage in stages)] for name in outputs]
        caption = f"Gap on the {use} flights: RMS over windows of 5 s (SI units, rad)"
        found.append(table(caption, ["output", *(STAGES[stage] for stage in stages)], rows))
    return found
