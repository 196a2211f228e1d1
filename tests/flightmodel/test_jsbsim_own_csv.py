"""The ten lines of the documentation on a table that JSBSim wrote itself, against the coefficients it flew."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
from jsbsim_csv import TRUTH, fly_csv
from own_bars import own_bar

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
LINE = {"max_thrust": 7.86, "thrust_line": (0.297, 0.0, -0.046), "moving_mass": 0.0}


def bars(result: Identification) -> dict[str, float]:
    """Standard errors where the rest of what is known of the aircraft is exact."""
    return {name: own_bar(result.model.coefficients[name]) for name in result.values}


def off(result: Identification) -> dict[str, float]:
    """Errors of the coefficients in standard errors."""
    return {name: (value - TRUTH.get(name, 0.0)) / bars(result)[name] for name, value in result.values.items()}


def test_ten_lines_from_jsbsim_s_csv_to_its_coefficients(tmp_path: Path) -> None:
    table, _ = fly_csv(tmp_path)
    flight = Flight.from_frame(pandas.read_csv(table), columns=COLUMNS, units={"thrust": "lbf"})
    aircraft = Aircraft.estimate(**WING, **SWUNG, **LINE, airspeed="true")
    result = identify(flight, aircraft, progress=False)

    assert result.verdict in ("good", "care")
    errors = off(result)
    for name in MAIN:
        assert abs(errors[name]) < 4.0, (name, result.values[name], result.stds[name])
        assert bars(result)[name] < 0.05 * abs(TRUTH[name]), name
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
        assert bars(result)[name] < widest * abs(TRUTH[name]), (name, result.values[name], result.stds[name])
    # What was estimated of the thrust line goes along with the model.
    ways = [simulate(model, aircraft, flight, restart_s=5.0).tic["q"] for model in (result, result.model)]
    assert ways[0] < 0.05
    assert ways[1] < 0.15


def test_a_burst_of_lost_rows_late_commands_and_a_slow_airspeed_leave_the_coefficients_alone() -> None:
    """What the lost commands did swings on behind the burst, and is neither a closed loop nor the aircraft's."""
    table = pandas.read_csv(ROOT / "docs" / "notebooks" / "flight1.csv")
    time_s = table["Time"].to_numpy()
    for header in table.columns:
        if any(word in header for word in ("elevator", "Aileron", "rudder")):
            table[header] = np.interp(time_s - 0.005, time_s, table[header])
    (airspeed,) = (header for header in table.columns if "Total" in header)
    table[airspeed] = table[airspeed].to_numpy()[np.arange(time_s.size) // 5 * 5]
    flight = Flight.from_frame(table[(time_s < 8.0) | (time_s > 8.6)])
    result = identify(flight, Aircraft.estimate(**WING, **SWUNG, airspeed="true"), progress=False)
    assert result.refused == {}
    assert not any("loop" in warning for warning in result.warnings)
    assert max(map(abs, off(result).values())) < 3.5, off(result)
    for name in MAIN:
        assert bars(result)[name] < 0.15 * abs(TRUTH[name]), (name, result.values[name], result.stds[name])


def test_a_result_serves_as_the_structure_of_the_next_and_as_what_is_known_before() -> None:
    """Its thrust line is an effect of the model then, and estimated again."""
    flights = [Flight.read(ROOT / "docs" / "notebooks" / f"flight{number}.csv") for number in (1, 2)]
    aircraft = Aircraft.estimate(**WING, **SWUNG, airspeed="true")
    first = identify(flights[0], aircraft, progress=False)
    again = identify(flights[1], aircraft, structure=first, progress=False)
    both = identify(flights[1], aircraft, structure=first, prior=first, progress=False)
    for result in (again, both):
        assert result.refused == {}
        assert max(map(abs, off(result).values())) < 3.5, off(result)
        effect = result.model.effect("thrust_line_offset")
        assert effect is not None
        assert abs(effect["z_T"] + 0.046) < 0.05
    # One after the other they say what both say together.
    together = identify(flights, aircraft, progress=False)
    for name in MAIN:
        assert bars(both)[name] < bars(again)[name]
        assert abs(both.values[name] - together.values[name]) < 0.7 * bars(together)[name], name
        assert 0.8 < bars(both)[name] / bars(together)[name] < 1.3, name
    assert not any("adds nothing" in warning for warning in both.warnings)
    sure = {name: replace(entry, std=0.01 * (entry.std or 0.0)) for name, entry in first.model.coefficients.items()}
    kept = identify(flights[1], aircraft, prior=replace(first.model, coefficients=sure), progress=False)
    (said,) = [warning for warning in kept.warnings if "as the prior model has them" in warning]
    assert set(MAIN) <= set(said.split(":")[0].split(", "))
    for name in MAIN:
        assert abs(kept.values[name] - first.values[name]) < 0.1 * bars(first)[name]


def test_bars_of_the_books_hold_a_guessed_inertia() -> None:
    flight = Flight.read(ROOT / "docs" / "notebooks" / "flight1.csv")
    result = identify(flight, Aircraft.estimate(**WING, airspeed="true"), method="ee", progress=False)
    assert result.verdict == "care"
    assert any("since the moments of inertia are" in reason for reason in result.reasons)
    pitch = result.model.coefficients["Cm_alpha"]
    assert abs(result.values["Cm_alpha"] - TRUTH["Cm_alpha"]) > 4.0 * pitch.extra["statistical_std"]
    whole = {name: abs(value - TRUTH.get(name, 0.0)) / result.stds[name] for name, value in result.values.items()}
    assert max(whole.values()) < 3.0, whole
