"""The page on bench calibration: every command prints what it says, the curves are those the points were made from."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest
from doc_commands import blocks
from numpy.typing import NDArray

from gcs.cli import main
from sysid.calibration import calibrate, read_points

ROOT = Path(__file__).resolve().parents[2]
BENCH = ROOT / "docs" / "calibration"
PAGE = ROOT / "docs" / "howto" / "calibration.md"
G = 9.80665

Array = NDArray[np.float64]


def shown() -> list[tuple[str, str]]:
    """Every command of the page and what it prints there."""
    found = [block.text.split("\n", 1) for block in blocks(PAGE) if block.language == "console"]
    return [(command.removeprefix("$ "), printed + "\n") for command, printed in found]


@pytest.mark.parametrize(("command", "expected"), shown(), ids=[command for command, _ in shown()])
def test_a_command_prints_what_the_page_says(
    command: str, expected: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    assert main(shlex.split(command)[1:]) == 0
    assert capsys.readouterr().out == expected


def test_the_page_works_every_sensor_of_the_paper_and_every_form() -> None:
    commands = " ".join(command for command, _ in shown())
    for name in ("airspeed", "thrust", "alpha", "beta", "beta2", "elevator"):
        assert f"{name}.csv" in commands
    for form in ("linear", "polynomial:", "spline", "pitot"):
        assert f"--form {form}" in commands


@pytest.mark.parametrize(
    ("name", "form", "unit", "volts", "at"),
    [
        ("airspeed", "pitot", "mmH2O", lambda V: 0.618 + 0.0049 * V**2, np.array([8.0, 15.0, 22.0])),
        ("thrust", "polynomial:2", "gf", lambda T: 0.9346 + 0.3127 * T - 0.0031 * T**2, np.array([-0.5, 3.0, 7.0])),
        ("alpha", "linear", "deg", lambda a: 2.4312 + 0.9573 * a, np.array([-0.2, 0.05, 0.3])),
        ("beta", "linear", "deg", lambda a: 2.5487 - 0.9491 * a, np.array([-0.2, 0.05, 0.3])),
        ("beta2", "linear", "deg", lambda a: 2.4755 + 0.9612 * a, np.array([-0.2, 0.05, 0.3])),
    ],
)
def test_the_curve_is_the_hidden_one_within_its_standard_error(
    name: str, form: str, unit: str, volts: object, at: Array
) -> None:
    assert callable(volts)
    curve = calibrate(read_points(BENCH / f"{name}.csv"), form, unit)
    error = curve.apply(volts(at))[0] - at
    std = np.sqrt(np.sum(curve.error_modes(at) ** 2, axis=0))
    assert np.all(np.abs(error) < 3.5 * std)
    assert np.all(std < 0.005 * np.ptp(at))


def test_standard_errors_are_those_of_statsmodels() -> None:
    import statsmodels.api as sm

    for name, form, unit, degree in (("alpha", "linear", "deg", 1), ("thrust", "polynomial:2", "gf", 2)):
        points = read_points(BENCH / f"{name}.csv")
        curve = calibrate(points, form, unit)
        peer = sm.OLS(points.reference, np.vander(points.reading, degree + 1, increasing=True)).fit()
        np.testing.assert_allclose([c.std for c in curve.coefficients], peer.bse, rtol=1e-8)
        np.testing.assert_allclose(curve.covariance, peer.cov_params(), rtol=1e-7)
    points = read_points(BENCH / "airspeed.csv")
    peer = sm.OLS(points.reading, sm.add_constant(2.0 * G * points.reference / 1.225)).fit()
    curve = calibrate(points, "pitot", "mmH2O")
    assert [c.std for c in curve.coefficients] == pytest.approx([peer.bse[1], peer.bse[0]], rel=1e-8)


def test_hysteresis_is_the_largest_gap_between_up_and_down() -> None:
    points = read_points(BENCH / "alpha.csv")
    curve = calibrate(points, "linear", "deg")
    slope = curve.coefficients[1].value
    ways = np.array(points.direction)
    gaps = [
        abs(slope * float(points.reading[(points.reference == r) & (ways == "up")][0] - points.reading[
            (points.reference == r) & (ways == "down")][0]))
        for r in np.unique(points.reference)
    ]  # fmt: skip
    assert curve.hysteresis == pytest.approx(max(gaps), rel=1e-9)
