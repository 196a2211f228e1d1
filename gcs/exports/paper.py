"""A result as material for a paper: figures at journal size with their data, tables in LaTeX, captions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gcs.errors import ExportError, ReportError
from gcs.exports.exported import estimates_of, require_new
from gcs.exports.tables import csv_side_by_side, latex_number, latex_side_by_side, latex_table
from gcs.report.side_by_side import headings
from gcs.text.files import write_whole
from gcs.text.one_line import one_line
from sim_vehicle.errors import ModelFileError
from sim_vehicle.model.model_file import model_from_json

Result = Mapping[str, Any]


def write_paper(result: Result, folder: Path, beside: Sequence[Result] = ()) -> list[Path]:
    """Write every figure of the report as SVG, PDF and CSV, coefficients.tex, modes.tex and captions.md.

    result: of schema identification/1 or discrepancy/1. beside: identifications whose coefficients stand beside its own
    in methods.tex and methods.csv. The folder is there whole or not at all. Returns the files.
    Raises ExportError where the folder exists or cannot be made, ReportError for a result that does not hold what its
    schema says.
    """
    from gcs.report import discrepancy_figures, figures  # slow to import
    from gcs.report.svg import publish

    require_new(folder)
    of_schema = {"identification/1": figures.every, "discrepancy/1": discrepancy_figures.every}
    if result.get("schema") not in of_schema:
        raise ReportError(f"this is no result that figures can be made of: its schema is {result.get('schema')!r}")
    flights = ", ".join(map(str, result.get("flights", [])))
    heads = headings([result, *beside]) if beside else []
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as scratch:
            made = Path(scratch) / folder.name
            made.mkdir()
            drawings = of_schema[result["schema"]](result)
            for drawing in drawings:
                publish(drawing, made)
            model = model_from_json(result["model"])
            title = one_line(f"{model.name}, identified from {flights}")
            write_whole(made / "coefficients.tex", latex_table(estimates_of(model), title))
            if isinstance(result.get("modes"), list) and result["modes"]:
                write_whole(made / "modes.tex", _modes(result["modes"]))
            if beside:
                every = [estimates_of(model_from_json(one["model"])) for one in (result, *beside)]
                write_whole(made / "methods.tex", latex_side_by_side(heads, every))
                write_whole(made / "methods.csv", csv_side_by_side(heads, every))
            captions = "".join(f"**{one.name}**: {one.caption}.\n\n" for one in drawings)
            write_whole(made / "captions.md", captions)
            made.rename(folder)
    except OSError as error:
        raise ExportError(f"{folder}: cannot be written: {error.strerror}; give another place") from None
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, ModelFileError) as error:
        raise ReportError(
            f"the result does not hold what its schema says ({type(error).__name__}: {error}); make it again"
        ) from error
    return sorted(folder.iterdir())


def _modes(modes: list[Result]) -> str:
    """A table of the modes with their standard errors."""
    rows = [
        rf"{mode['name'].replace('_', ' ')} & {_pair(mode['frequency_hz'])} & {_pair(mode['damping_ratio'])}"
        rf" & {_pair(mode['time_constant_s'])} \\"
        for mode in modes
    ]
    head = r"Mode & Frequency, Hz & Damping ratio & Time constant, s \\"
    lines = [r"\begin{tabular}{lrrr}", r"\toprule", head, r"\midrule", *rows, r"\bottomrule", r"\end{tabular}"]
    return "\n".join(lines) + "\n"


def _pair(entry: Result | None) -> str:
    if entry is None:
        return "--"
    return latex_number(entry["value"], entry.get("std"))
