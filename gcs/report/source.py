"""Reading a result file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from gcs.errors import ReportError


def read_result(path: Path) -> Any:
    """The JSON value of a file. Raises ReportError in one line."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ReportError(
            f"{path} cannot be read: {error.strerror}; give what gcs identify or discrepancy -o wrote"
        ) from None
    except (ValueError, RecursionError):
        raise ReportError(f"{path} is not JSON; give what gcs identify or discrepancy -o wrote") from None
