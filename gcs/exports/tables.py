"""Estimates as tables: CSV for programs, LaTeX (booktabs) for papers."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from gcs.exports.exported import AXES_AND_SIGNS, Z95, Exported, described, require_new
from gcs.report.markup import decimals
from gcs.text.files import write_whole
from gcs.text.one_line import one_line
from sim_vehicle.effects import EFFECTS
from sim_vehicle.errors import ModelFileError
from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.model_file import Coefficient

_REGRESSORS = {
    "alpha": r"\alpha", "alphadot": r"\hat{\dot{\alpha}}", "beta": r"\beta", "p": r"\hat{p}", "q": r"\hat{q}",
    "r": r"\hat{r}", "de": r"\delta_e", "da": r"\delta_a", "dr": r"\delta_r", "CL": "C_L", "throttle": r"\delta_t",
}  # fmt: skip


def write_csv(model: Exported, path: Path) -> list[str]:
    """A row for each estimate, and beside it PATH-correlation.csv where the model has one. Returns what is left out."""
    correlations = path.with_name(f"{path.stem}-correlation{path.suffix}")
    require_new(path)
    require_new(correlations)
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("name", "value", "std", "low95", "high95", "unit", "meaning"))
    for name, entry in model.estimates.items():
        value, std = float(entry.value or 0.0), entry.std
        bars = ("", "", "") if std is None else (std, value - Z95 * std, value + Z95 * std)
        rows.writerow((name, value, *bars, _unit(name), described(name)))
    for name in model.model.not_identified():
        entry = model.model.coefficients[name]
        rows.writerow((name, entry.mean, entry.mean_std, "", "", _unit(name), f"not identified: {entry.refused}"))
    write_whole(path, text.getvalue())
    if model.model.correlation is not None:
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(("", *model.model.correlation.names))
        for name, row in zip(model.model.correlation.names, model.model.correlation.matrix, strict=True):
            rows.writerow((name, *row))
        write_whole(correlations, text.getvalue())
    return model.left_out


def _unit(name: str) -> str:
    """Coefficients are per radian, rates nondimensional; parameters of effects have their own units."""
    effect, _, parameter = name.partition(".")
    return EFFECTS[effect].parameter(parameter).unit if parameter else "1"


def write_latex(model: Exported, path: Path) -> list[str]:
    """A table for the package booktabs: symbol, value with standard error, 95 % interval. Returns what is left out."""
    require_new(path)
    write_whole(path, latex_table(model.estimates, model.title))
    return model.left_out


def latex_table(estimates: Mapping[str, Coefficient], title: str) -> str:
    """The table itself, behind remarks of what it is."""
    lines = [
        f"% {title}.",
        f"% {AXES_AND_SIGNS}",
        r"\begin{tabular}{lrr}",
        r"\toprule",
        r"Coefficient & Value $\pm$ 1$\sigma$ & 95\,\% interval \\",
        r"\midrule",
        *(_latex_row(name, entry) for name, entry in estimates.items()),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def latex_side_by_side(heads: Sequence[str], results: Sequence[Mapping[str, Coefficient]]) -> str:
    """A table of several results: a row each coefficient, a column each result."""
    names = list(dict.fromkeys(name for one in results for name in one))
    rows = [" & ".join([_symbol(name), *(_latex_cell(one.get(name)) for one in results)]) + r" \\" for name in names]
    return "\n".join([
        f"% {AXES_AND_SIGNS} Values with one standard error.",
        rf"\begin{{tabular}}{{l{'r' * len(results)}}}", r"\toprule",
        " & ".join(["Coefficient", *(_latex_text(head) for head in heads)]) + r" \\", r"\midrule",
        *rows, r"\bottomrule", r"\end{tabular}", "",
    ])  # fmt: skip


def _latex_text(text: str) -> str:
    return re.sub(r"([#$%&_{}])", r"\\\1", one_line(text)).replace("~", r"\textasciitilde{}").replace("^", r"\^{}")


def _latex_cell(entry: Coefficient | None) -> str:
    return "--" if entry is None else latex_number(float(entry.value or 0.0), entry.std)


def csv_side_by_side(heads: Sequence[str], results: Sequence[Mapping[str, Coefficient]]) -> str:
    """The same as CSV: of each result value and standard error."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("name", *(f"{head}{part}" for head in heads for part in ("", ", std"))))
    for name in dict.fromkeys(name for one in results for name in one):
        entries = [one.get(name) for one in results]
        cells = [("", "") if e is None else (e.value, "" if e.std is None else e.std) for e in entries]
        rows.writerow((name, *(part for pair in cells for part in pair)))
    return text.getvalue()


def _latex_row(name: str, entry: Coefficient) -> str:
    value, std = float(entry.value or 0.0), entry.std
    if not std:
        return rf"{_symbol(name)} & {latex_number(value, None)} & -- \\"
    low, high = (latex_number(value + side * Z95 * std, std, bare=True) for side in (-1.0, 1.0))
    return rf"{_symbol(name)} & {latex_number(value, std)} & ${low} \ldots {high}$ \\"


def latex_number(value: float, std: float | None, *, bare: bool = False) -> str:
    """A value with as many digits as its standard error warrants, which follows unless it is to stand `bare`."""
    if not std:
        return f"{value:.4g}" if bare else f"${value:.4g}$"
    places = decimals(value, std)
    places = 6 if places is None else places
    return f"{value:.{places}f}" if bare else rf"${value:.{places}f} \pm {std:.{places}f}$"


def _factor(name: str) -> str:
    """A regressor; a control of another name as a deflection with that name."""
    word = name.replace("_", r"\,")
    return _REGRESSORS.get(name, rf"\delta_{{\mathrm{{{word}}}}}")


def _symbol(name: str) -> str:
    """A coefficient as the field writes it; other names as they are."""
    try:
        term = parse_term(name)
    except ModelFileError:
        return rf"\texttt{{{name.replace('_', chr(92) + '_')}}}"
    if name == "CD_k":
        return "$k$"
    counted = {one: term.factors.count(one) for one in term.factors}
    index = " ".join(_factor(one) + (f"^{count}" if count > 1 else "") for one, count in counted.items()) or "0"
    return f"$C_{{{term.axis[1:]}_{{{index}}}}}$"
