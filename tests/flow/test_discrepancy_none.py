"""No effect is named where none of the catalogue is missing."""

from __future__ import annotations

from pathlib import Path

from discrepancy_flights import over_floor, run_discrepancy


def test_where_nothing_is_missing_nothing_is_named(tmp_path: Path) -> None:
    found = run_discrepancy(tmp_path, 14, 0.0)
    assert found["verdict"] == "none", found["reasons"]
    assert found["effects"] == []
    assert over_floor(found["gap"]["validation"], "given") < 1.3


def test_wrong_coefficients_are_no_missing_effect(tmp_path: Path) -> None:
    found = run_discrepancy(tmp_path, 15, 0.1, validate=False)
    assert found["verdict"] == "parameter_error", found["reasons"]
    assert found["effects"] == []
    assert over_floor(found["gap"]["estimation"], "after") < 1.3


def test_turbulence_is_no_missing_effect(tmp_path: Path) -> None:
    found = run_discrepancy(tmp_path, 22, 0.0, "--effect", "turbulence:sigma=0.3", validate=False)
    assert found["verdict"] in ("none", "parameter_error"), found["reasons"]
    assert found["effects"] == []
    assert 0.15 < found["turbulence"] < 0.6


def test_what_no_effect_of_the_catalogue_is_stays_unexplained(tmp_path: Path) -> None:
    """A pitch gyro that lags: the kinematics take it for turbulence, but the floor of sensors and gusts does not."""
    found = run_discrepancy(tmp_path, 23, 0.0, "--set", "sensors.q.lag=0.05", validate=False)
    assert found["verdict"] == "unexplained", found["reasons"]
    assert found["effects"] == []
