"""The ten lines of the documentation on a table that JSBSim wrote itself, against the coefficients it flew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas
import pytest
from jsbsim_csv import TRUTH, fly_csv

from flightmodel import Aircraft, Flight, Identification, identify, simulate

pytestmark = pytest.mark.whole_flight
ROOT = Path(__file__).resolve().parents[2]
MAIN = ("CL_alpha", "CD_0", "Cm_alpha", "Cm_q", "Cm_de", "CY_beta", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr")
COLUMNS = {
    "thrust": "/fdm/jsbsim/external_reactions/thrust/magnitude",
    "da": "/fdm/jsbsim/fcs/left-aileron-pos-rad",
}
WING = {"span": 1.27, "mass": 1.959, "area": 0.3097, "chord": 0.25}
SWUNG = {"Ixx": 0.07151, "Iyy": 0.08636, "Izz": 0.15364, "Ixz": 0.014}
LINE = {"max_thrust": 7.86, "thrust_line": (0.297, 0.0, -0.046)}


def off(result: Identification) -> dict[str, float]:
    """Errors of the coefficients in standard errors."""
    return {name: (value - TRUTH.get(name, 0.0)) / result.stds[name] for name, value in result.values.items()}


def test_ten_lines_from_jsbsim_s_csv_to_its_coefficients(tmp_path: Path) -> None:
    table, _ = fly_csv(tmp_path)
    flight = Flight.from_frame(pandas.read_csv(table), columns=COLUMNS, units={"thrust": "lbf"})
    aircraft = Aircraft.estimate(**WING, **SWUNG, **LINE, airspeed="true")
    result = identify(flight, aircraft, progress=False)

    assert result.verdict in ("good", "care")
    errors = off(result)
    for name in MAIN:
        assert abs(errors[name]) < 4.0, (name, result.values[name], result.stds[name])
        assert result.stds[name] < 0.05 * abs(TRUTH[name]), name
    assert "CL_alpha" in result.table()
    assert result.to_frame().loc["CL_alpha", "low"] < TRUTH["CL_alpha"] < result.to_frame().loc["CL_alpha", "high"]


@pytest.mark.parametrize(
    ("known", "widest"),
    [
        ({**SWUNG, **LINE}, 0.05),
        (SWUNG, 0.15),
        ({**SWUNG, "max_thrust": 7.86}, 0.15),
        (LINE, 1.0),
        ({}, 1.0),
    ],
    ids=["all", "no thrust line", "thrust without its line", "not swung", "span and mass"],
)
def test_bars_hold_what_nobody_measured_of_the_aircraft(known: dict[str, Any], widest: float) -> None:
    """Moments of inertia, the product of them, the thrust line: where they are not given the bars say so, and hold."""
    table = pandas.read_csv(ROOT / "docs" / "notebooks" / "flight1.csv")
    flight = Flight.from_frame(table)
    aircraft = Aircraft.estimate(**WING, **known, airspeed="true")
    other = Flight.read(ROOT / "docs" / "notebooks" / "flight2.csv")
    result = identify(flight, aircraft, validate_on=other, progress=False)
    assert result.refused == {}
    assert result.result["validation"]["acceptable"]
    assert result.result["validation"]["outputs"]["Cm"]["tic"] < 0.1
    assert max(map(abs, off(result).values())) < 3.0, off(result)
    for name in MAIN:
        assert result.stds[name] < widest * abs(TRUTH[name]), (name, result.values[name], result.stds[name])
    # What was estimated of the thrust line goes along with the model.
    ways = [simulate(model, aircraft, flight, restart_s=5.0).tic["q"] for model in (result, result.model)]
    assert ways[0] < 0.05
    assert ways[1] < 0.15


def test_bars_of_the_books_say_that_they_do_not_hold_a_guessed_inertia() -> None:
    flight = Flight.read(ROOT / "docs" / "notebooks" / "flight1.csv")
    result = identify(flight, Aircraft.estimate(**WING, airspeed="true"), method="ee", progress=False)
    assert result.verdict == "care"
    assert any("which the bars of this method do not hold" in reason for reason in result.reasons)
