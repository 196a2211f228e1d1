"""JSON as every reader accepts it: no NaN, no Infinity, no numpy types."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np


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


def dumps(value: Any, indent: int | None = None) -> str:
    """JSON text of `value` after `plain`."""
    return json.dumps(plain(value), indent=indent, allow_nan=False, ensure_ascii=False)
