"""Whether two identifications agree."""

from __future__ import annotations

from typing import Any

import pytest


def estimates(result: dict[str, Any]) -> dict[str, float]:
    """Every coefficient, sensor error and standard error of a result, by name."""
    entries = {**result["model"]["coefficients"], **result["sensor_errors"]}
    found = {name: entry["value"] for name, entry in entries.items() if "refused" not in entry}
    return found | {f"{name} std": entry["std"] for name, entry in entries.items() if "refused" not in entry}


def assert_same_result(given: dict[str, Any], expected: dict[str, Any], relative: float) -> None:
    """All estimates, refusals and segments agree; relative: allowed difference as a share of the value or the std."""
    found, wanted = estimates(given), estimates(expected)
    assert found.keys() == wanted.keys()
    for name, value in wanted.items():
        error = wanted.get(f"{name} std", abs(value))
        assert found[name] == pytest.approx(value, rel=relative, abs=relative * error), name
    assert given["refused"] == expected["refused"]
    drop = [{key: value for key, value in segment.items() if key != "flight"} for segment in given["segments"]]
    kept = [{key: value for key, value in segment.items() if key != "flight"} for segment in expected["segments"]]
    assert drop == kept
