"""JSON as every reader accepts it: no NaN, no Infinity, no numpy types."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np

# A list of numbers and nulls as `indent` breaks it; no string of JSON holds a line break.
_BROKEN = re.compile(r"\[\n\s+((?:-?\d[\d.e+-]*|null)(?:,\n\s+(?:-?\d[\d.e+-]*|null))*)\n\s+\]")


def plain(value: Any) -> Any:
    """The same value with numpy types made plain, paths made text, and what is not finite made None."""
    if isinstance(value, dict):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


def _made_plain(value: Any) -> Any:
    """What JSON has no type for. TypeError for what `plain` makes nothing of either."""
    if isinstance(value, np.ndarray | np.generic | Path):
        return plain(value)
    raise TypeError(f"{type(value).__name__} is no value of JSON")


def dumps(value: Any, indent: int | None = None) -> str:
    """JSON text of `value` after `plain`; with an indent, lists of numbers stay on one line each."""
    try:  # most values need no more than a few plain types, and going through all of them takes longer than the text
        text = json.dumps(value, default=_made_plain, indent=indent, allow_nan=False, ensure_ascii=False)
    except (ValueError, TypeError):  # what is not finite, and keys that are no text
        text = json.dumps(plain(value), indent=indent, allow_nan=False, ensure_ascii=False)
    return text if indent is None else _BROKEN.sub(lambda found: f"[{' '.join(found[1].split())}]", text)
