"""A design and a comparison of designs as tables for a terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from gcs.design.prediction import COMPARED

_DEGREES = ("alpha", "beta", "phi", "theta", "p", "q", "r")


def design_text(result: dict[str, Any]) -> str:
    """A result of schema design/1 as lines."""
    air = f"turbulence of {result['gusts']:g} m/s" if result["gusts"] else "calm air"
    lines = [f"{result['vehicle']}, model {result['model']}: {result['duration_s']:.1f} s in {air}"]
    lines += [_segment_line(segment) for segment in result["plan"]["segments"] if segment["manoeuvre"] != "cruise"]
    if result["peak_factors"]:
        factors = ", ".join(f"{axis} {factor:.2f}" for axis, factor in result["peak_factors"].items())
        lines.append(f"relative peak factors: {factors}")
    lines += ["flown: " + ", ".join(_reach(result, name) for name in ("V", "alpha", "beta", "phi", "theta")), ""]
    lines.append(f"  {'coefficient':<14} {'prior':>10} {'std':>10} {'percent':>9}")
    lines += [_row(entry) for entry in result["coefficients"]]
    lines += ["", f"  {'sensor error':<25} {'std':>10}"]
    lines += [f"  {entry['name']:<25} {entry['std']:>10.2g} {entry['unit']}" for entry in result["sensor_errors"]]
    lines.append("")
    for refusal in result["refused"]:
        lines.append(f"refused: {refusal['name']}: {refusal['reason']}; fly the manoeuvre {refusal['manoeuvre']}")
    lines += [f"warning: {warning}" for warning in result["warnings"]]
    return "\n".join(lines).rstrip()


def _segment_line(segment: dict[str, Any]) -> str:
    peaks = segment.get("amplitudes") or {"": segment["amplitude"]}
    size = ", ".join(f"{axis} {math.degrees(peak):.2f} deg".strip() for axis, peak in peaks.items())
    width = f", unit pulse {segment['width']:g} s" if "width" in segment else ""
    return f"  {segment['manoeuvre']}: {segment['duration']:g} s, {size}{width}"


def _reach(result: dict[str, Any], name: str) -> str:
    low, high = result["excursions"][name]
    if name in _DEGREES:
        return f"{name} {math.degrees(low):.1f} to {math.degrees(high):.1f} deg"
    return f"{name} {low:.1f} to {high:.1f} m/s"


def _row(entry: dict[str, Any]) -> str:
    percent = "" if entry["percent"] is None else f"{entry['percent']:.2g} %"
    note = ""
    if "correlated" in entry:
        note = f"  with {entry['correlated']['with']} ({entry['correlated']['correlation']:+.2f})"
    return f"  {entry['name']:<14} {entry['value']:>10.4g} {entry['std']:>10.2g} {percent:>9}{note}".rstrip()


def comparison_text(rows: Sequence[dict[str, Any]]) -> str:
    """Candidates as a table of standard errors, percent of the prior's value (absolute where that is 0)."""
    names = [name for name in COMPARED if any(name in row["coefficients"] for row in rows)]
    lines = [f"{'manoeuvre':<22}{'s':>6}{'estimated':>11}{'score':>9}" + "".join(f"{name:>10}" for name in names)]
    for row in rows:
        cells = "".join(f"{_cell(row['coefficients'].get(name)):>10}" for name in names)
        lines.append(f"{row['name']:<22}{row['duration_s']:>6.0f}{row['estimated']:>11}{row['score']:>9.2g}{cells}")
    lines += ["", "standard errors in percent of the prior's value, absolute where that is 0; -: refused.",
              "score: geometric mean of standard errors over the coefficients' usual sizes."]  # fmt: skip
    return "\n".join(lines)


def _cell(entry: dict[str, Any] | None) -> str:
    if entry is None:
        return "-"
    return f"{entry['std']:.2g}" if entry["percent"] is None else f"{entry['percent']:.2g} %"
