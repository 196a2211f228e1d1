"""Results of a batch as one table: a row for each flight or campaign, a column for each number."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gcs.fleet.orders import Order
from gcs.formats.arrow import arrow
from gcs.text.intervals import of_the_flight

Row = dict[str, Any]
_FINDINGS = {
    "none": "as the model has it", "parameter_error": "other coefficients", "missing_effect": "missing effect",
    "unexplained": "unexplained",
}  # fmt: skip


def rows_of(orders: Sequence[Order], results: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Rows, oldest flight first. `NAME`, `NAME_std`: a coefficient and its standard error, None where it is refused."""
    return sorted((_row(*pair) for pair in zip(orders, results, strict=True)), key=lambda row: int(row["start_ns"]))


def findings_of(orders: Sequence[Order], results: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Rows of comparisons with a model, oldest flight first.

    `finding`: the verdict of schema discrepancy/1; `effect`: what is missing, by name; `probability`: of the first;
    `EFFECT.PARAMETER`, `..._std`: its sizes; `gap_OUTPUT`, `left_OUTPUT`: the gap of the model as given, and with what
    was found.
    """
    found = []
    for order, result in zip(orders, results, strict=True):
        row = {**_about(order, result), "finding": result.get("verdict", ""), "effect": "", "probability": None}
        named = result.get("effects", ())
        if named:
            every = " and ".join(effect["name"] for effect in named)
            row |= {"effect": every, "probability": named[0]["probability"]}
        for effect in named:
            for name, entry in effect["parameters"].items():
                sizes = f"{effect['name']}.{name}"
                row |= {sizes: entry.get("value"), f"{sizes}_std": entry.get("std")}
        gap = result.get("gap", {}).get("estimation", {})
        for key, of in (("given", "gap"), ("after", "left")):
            row |= {f"{of}_{output}": value for output, value in gap.get(key, {}).items()}
        found.append(row)
    return sorted(found, key=lambda row: int(row["start_ns"]))


def finding_lines(rows: Sequence[Row], what: str = "flights") -> list[str]:
    """How often each finding was made, a line for each aircraft and finding. what: rows are."""
    counts = Counter((row["aircraft"], row["finding"], row["effect"]) for row in rows if not row["error"])
    every = Counter(row["aircraft"] for row in rows if not row["error"])
    return [
        f"{aircraft}: {_FINDINGS[finding]}{effect and f' by {effect}'}: {count} of {every[aircraft]} {what}"
        for (aircraft, finding, effect), count in sorted(counts.items())
    ]


def _about(order: Order, result: Mapping[str, Any]) -> Row:
    return {
        "flight": _clean(order.name), "source": _clean(order.source), "aircraft": order.aircraft,
        "flights": int(result.get("flights_used", 0)), "left_out": _clean("; ".join(result.get("left_out", ()))),
        "start_ns": int(result["start_ns"]), "cost_s": float(result["cost_s"]), "error": result.get("error", ""),
        "verdict": result.get("quality", {}).get("verdict", ""), "method": result.get("method", ""),
    }  # fmt: skip


def _row(order: Order, result: Mapping[str, Any]) -> Row:
    row = _about(order, result)
    for name, entry in result.get("model", {}).get("coefficients", {}).items():
        row[name], row[f"{name}_std"] = entry.get("value"), of_the_flight(entry)
    return row


def _clean(name: str) -> str:
    """A name whose bytes are no text, as letters that a table can hold."""
    return name.encode(errors="replace").decode()


def coefficients_of(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of all coefficients, in the order of their first appearance."""
    return list(dict.fromkeys(name[:-4] for row in rows for name in row if name.endswith("_std")))


def write_table(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write a table; its ending names the form, .parquet or .csv."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    if path.suffix.lower() == ".parquet":
        pyarrow = arrow()
        table = pyarrow.Table.from_pydict({name: [row.get(name) for row in rows] for name in names})
        pyarrow.parquet.write_table(table, path)
        return
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
