"""The table of `discrepancy_peers.py`: gaps over the true model's, share of the gap closed, right names and terms."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

CONTESTANTS = {"sindy": "PySINDy", "sindy_sparse": "PySINDy, sparse", "gp": "Gaussian process", "ours": "this project"}
# Effect -> axes and factors of the terms that say it: what the contest counts as the right term.
RIGHT_TERMS: dict[str, tuple[frozenset[str], frozenset[str]]] = {
    "pitch_damping": (frozenset({"Cm"}), frozenset({"q"})),
    "roll_damping": (frozenset({"Cl"}), frozenset({"p"})),
    "side_force": (frozenset({"CY"}), frozenset({"beta"})),
    "pitch_curvature": (frozenset({"Cm"}), frozenset({"alpha"})),
    "adverse_yaw": (frozenset({"Cn"}), frozenset({"da"})),
    "reynolds_drag": (frozenset({"CD"}), frozenset({"V"})),
    "thrust_line_offset": (frozenset({"Cm"}), frozenset({"thrust"})),
    "stall": (frozenset({"CL", "CD"}), frozenset({"alpha"})),
}
# Below this gap over the true model's, little is left to close, and shares of it say nothing.
_TO_CLOSE = 1.1


def excess(over: Mapping[str, float], under: Mapping[str, float]) -> float:
    """Quadratic mean over the outputs of one gap over another: 1 for as good; infinite where a run diverged."""
    return float(np.sqrt(np.mean([(over[name] / value) ** 2 for name, value in under.items()])))


def closed(before: float, after: float) -> float:
    """Share of the gap above the true model's that a correction closes; negative where it opens it."""
    return (before - after) / (before - 1.0)


def is_right(effect: str, axis: str, factors: Iterable[str]) -> bool:
    """Whether a term says the effect: on one of its axes, made of nothing but its factors."""
    axes, allowed = RIGHT_TERMS[effect]
    return axis in axes and set(factors) <= allowed


def of_baseline(names: Iterable[str], axis: str, factors: Sequence[str]) -> bool:
    """Whether the baseline has this term itself, so that to correct it is no false name."""
    return len(factors) == 1 and f"{axis}_{factors[0]}" in names


def naming(line: Mapping[str, Any], key: str) -> tuple[bool, int, int]:
    """Whether the strongest term is right, how many terms there are, and how many of them are false."""
    terms = [(axis, factors) for axis, factors, _ in line["terms"][key]]
    right = bool(terms) and is_right(line["effect"], *terms[0])
    false = [t for t in terms if not is_right(line["effect"], *t) and not of_baseline(line["baseline"], *t)]
    return right, len(terms), len(false)


def _strongest(line: Mapping[str, Any], key: str) -> str:
    if not line["terms"][key]:
        return "none"
    right, count, false = naming(line, key)
    axis, factors, _ = line["terms"][key][0]
    return f"{'' if right else 'wrong: '}{axis} {' '.join(factors)} ({count}, {false} false)"


def _named(line: Mapping[str, Any]) -> str:
    names = [name for name, _ in line["named"]]
    return " + ".join(names) or str(line["verdict"])


def named_right(line: Mapping[str, Any]) -> bool:
    """Whether this project names the effect, and nothing besides."""
    return [name for name, _ in line["named"]] == [line["effect"]]


def ratios(line: Mapping[str, Any]) -> dict[str, float]:
    """Gap over the true model's by stage: "before", then every contestant."""
    return {name: excess(line["gap"][name], line["gap"]["true"]) for name in ("before", *CONTESTANTS)}


def report(lines: Sequence[Mapping[str, Any]]) -> str:
    """Markdown: flights, then medians in calm air and in turbulence."""
    head = [
        "effect",
        "air",
        "re-fitted baseline",
        *CONTESTANTS.values(),
        "PySINDy, sparse: strongest term",
        "named here",
    ]
    rows = []
    for line in lines:
        values = [f"{value:.2f}" if value < 1e3 else "diverges" for value in ratios(line).values()]
        air = f"{line['gust']:g} m/s" if line["gust"] else "calm"
        rows.append([line["effect"], air, *values, _strongest(line, "sindy_sparse"), _named(line)])
    groups = {"calm": [one for one in lines if not one["gust"]], "turbulent": [one for one in lines if one["gust"]]}
    parts = [_markdown(head, rows)]
    parts += [_markdown(*_summary(name, group)) for name, group in groups.items() if group]
    return "\n\n".join(parts)


def _summary(air: str, lines: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Medians over flights of one kind of air."""
    told = [ratios(line) for line in lines]
    names = {key: [naming(line, key) for line in lines] for key in ("sindy", "sindy_sparse")}
    right = {key: f"{sum(r for r, _, _ in found)} of {len(lines)}" for key, found in names.items()}
    false = {key: f"{statistics.mean(f for _, _, f in found):.1f}" for key, found in names.items()}
    right["ours"] = f"{sum(named_right(line) for line in lines)} of {len(lines)}"
    false["ours"] = f"{statistics.mean(sum(n != line['effect'] for n, _ in line['named']) for line in lines):.1f}"
    rows = []
    for key, title in CONTESTANTS.items():
        shares = [closed(one["before"], one[key]) for one in told if one["before"] > _TO_CLOSE]
        seconds = [line["seconds"][key] + (0.0 if key == "ours" else line["seconds"]["refit"]) for line in lines]
        rows.append(
            [
                title,
                f"{statistics.median(one[key] for one in told):.2f}",
                f"{100.0 * statistics.median(shares):.0f} %" if shares else "-",
                f"{100.0 * min(shares):.0f} %" if shares and math.isfinite(min(shares)) else "-",
                right.get(key, "names nothing"),
                false.get(key, "-"),
                f"{statistics.median(seconds):.0f}",
            ]
        )  # fmt: skip
    head = [
        f"{len(lines)} {air} flights", "gap over the true model's, median", "gap closed, median", "least",
        "right name or term", "false names or terms a flight", "CPU s, median",
    ]  # fmt: skip
    return head, rows


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
