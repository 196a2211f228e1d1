"""`gcs report`: a result as one page to read, print and keep."""

import argparse
from pathlib import Path

NAME = "report"
HELP = "write a result of identify or discrepancy as one HTML page"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.outputs import HTML, NEW, add_output

    parser.add_argument("result", metavar="RESULT.json", type=Path, help="what identify -o or discrepancy -o wrote")
    parser.add_argument("--beside", metavar="RESULT.json", type=Path, nargs="+", default=[],
        help="results of other methods or flights, coefficients side by side")  # fmt: skip
    add_output(parser, "-o", "--output", metavar="REPORT.html", kind=HTML)
    add_output(parser, "--paper", metavar="FOLDER", kind=NEW, help="figures as SVG, PDF and CSV, tables in LaTeX")


def run(args: argparse.Namespace) -> int:
    """Read the result, write the page."""
    from gcs.errors import ReportError, SettingsError
    from gcs.exports.paper import write_paper
    from gcs.report.page import report
    from gcs.report.source import read_result
    from gcs.text.files import write_whole

    if args.output is None and args.paper is None:
        raise SettingsError("give -o REPORT.html, --paper FOLDER, or both")
    result, beside = read_result(args.result), [read_result(one) for one in args.beside]
    try:
        page = report(result, beside) if args.output is not None else ""
        if args.paper is not None:
            written = write_paper(result, args.paper, beside)
            print(f"{args.paper}: {len(written)} files written")
    except ReportError as error:
        raise ReportError(f"{', '.join(map(str, [args.result, *args.beside]))}: {error}") from error
    if args.output is not None:
        write_whole(args.output, page)
        print(f"{args.output} written")
    return 0
