"""`gcs report`: a result as one page to read, print and keep."""

import argparse
from pathlib import Path

NAME = "report"
HELP = "write a result of identify or discrepancy as one HTML page"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("result", metavar="RESULT.json", type=Path, help="what identify -o or discrepancy -o wrote")
    parser.add_argument("-o", "--output", metavar="REPORT.html", type=Path, required=True)


def run(args: argparse.Namespace) -> int:
    """Read the result, write the page."""
    from gcs.analysis.results import check_targets
    from gcs.errors import ReportError
    from gcs.report.page import report
    from gcs.report.source import read_result
    from gcs.text.files import write_whole

    check_targets(args.output, inputs=[args.result])
    result = read_result(args.result)
    try:
        page = report(result)
    except ReportError as error:
        raise ReportError(f"{args.result}: {error}") from error
    write_whole(args.output, page)
    print(f"{args.output} written")
    return 0
