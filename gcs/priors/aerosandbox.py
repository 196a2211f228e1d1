"""AeroSandbox: the dictionary that `run_with_stability_derivatives` gives, as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from gcs.errors import PriorError
from gcs.priors.estimate import Estimates, of_program
from gcs.priors.names import DERIVATIVES, ours


def read(text: str, where: str) -> Estimates:
    """Coefficients of such a dictionary: per radian, rates nondimensional, moments about body axes.

    where: the file's name, for errors. It has no control derivatives. Raises PriorError, one line, where it is no such
    dictionary or a derivative is missing.
    """
    try:
        data = json.loads(text)
    except (ValueError, RecursionError):
        data = None
    if not isinstance(data, Mapping):
        raise PriorError(
            f"{where}: is no JSON object; write AeroSandbox's result with json.dump(result, file, default=list)"
        )
    found = {name: _number(data[name]) for name in DERIVATIVES if name in data}
    return Estimates(
        of_program(ours(found, where, "run_with_stability_derivatives")),
        ("what the surfaces do: AeroSandbox's derivatives are none of controls",),
    )


def _number(value: Any) -> float:
    """A number, or the only one of a list, as arrays of one element are written; else NaN."""
    while isinstance(value, list) and len(value) == 1:
        value = value[0]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan
