"""Parquet's library, which is installed with the extra `parquet` alone: it is a fifth of everything else."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

from gcs.errors import RecordingError


def has_arrow() -> bool:
    """Whether it is installed."""
    return find_spec("pyarrow") is not None


def arrow() -> Any:
    """The module pyarrow, with its Parquet. RecordingError in one line where it is not installed."""
    if not has_arrow():
        raise RecordingError(
            "Parquet needs pyarrow (pip install 'flight-model-ground-station[parquet]'); a CSV needs nothing"
        )
    import pyarrow
    import pyarrow.parquet

    return pyarrow
