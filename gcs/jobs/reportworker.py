"""One report in a process of its own: a result as JSON on standard input, the page on standard output."""

from __future__ import annotations

import json
import sys

from gcs.errors import ReportError
from gcs.jobs.limits import NICENESS_WAITED_FOR, memory_limit, stand_back
from gcs.report.page import report


def main() -> int:
    """Write the page. Exit code 1 with the reason on standard error where the result cannot be shown."""
    stand_back(memory_limit(), NICENESS_WAITED_FOR)
    try:
        sys.stdout.write(report(json.load(sys.stdin)))
    except ReportError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
