"""Results of a batch as one table: a row for each flight, a column for each number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gcs.fleet.orders import Order

Row = dict[str, Any]


def rows_of(orders: Sequence[Order], results: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Rows, oldest flight first. `NAME`, `NAME_std`: a coefficient and its standard error, None where it is refused."""
    return sorted((_row(*pair) for pair in zip(orders, results, strict=True)), key=lambda row: int(row["start_ns"]))


def _row(order: Order, result: Mapping[str, Any]) -> Row:
    row: Row = {
        "flight": _clean(Path(order.source).stem), "source": _clean(order.source), "aircraft": order.aircraft,
        "start_ns": int(result["start_ns"]), "cost_s": float(result["cost_s"]), "error": result.get("error", ""),
        "verdict": result.get("quality", {}).get("verdict", ""), "method": result.get("method", ""),
    }  # fmt: skip
    for name, entry in result.get("model", {}).get("coefficients", {}).items():
        row[name], row[f"{name}_std"] = entry.get("value"), entry.get("std")
    return row


def _clean(name: str) -> str:
    """A name whose bytes are no text, as letters that a table can hold."""
    return name.encode(errors="replace").decode()


def coefficients_of(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of all coefficients, in the order of their first appearance."""
    return list(dict.fromkeys(name[:-4] for row in rows for name in row if name.endswith("_std")))


def write_table(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write a table; its ending names the form, .parquet or .csv."""
    import pyarrow
    from pyarrow import csv, parquet

    names = list(dict.fromkeys(name for row in rows for name in row))
    table = pyarrow.Table.from_pydict({name: [row.get(name) for row in rows] for name in names})
    (parquet.write_table if path.suffix.lower() == ".parquet" else csv.write_csv)(table, path)
