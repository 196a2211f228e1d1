"""A job of a batch that ends its worker; a module by itself, which the workers load at once."""

from __future__ import annotations

import os
from typing import Any


def deadly(flights: tuple[str, ...], vehicle: str, options: dict[str, Any]) -> dict[str, Any]:
    """A job that one flight ends its worker with, and another cannot do just now."""
    if flights == ("deadly",):
        os._exit(9)
    if flights == ("away",):
        return {"error": "the store does not answer", "transient": True, "start_ns": 0, "cost_s": 0.0}
    return {"quality": {"verdict": "good"}, "start_ns": 1, "cost_s": 0.0}
