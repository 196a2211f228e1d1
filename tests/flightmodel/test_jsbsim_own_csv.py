"""The ten lines of the documentation on a table that JSBSim wrote itself, against the coefficients it flew."""

from __future__ import annotations

from pathlib import Path

import pandas
import pytest
from jsbsim_csv import TRUTH, fly_csv

pytestmark = pytest.mark.whole_flight
MAIN = ("CL_alpha", "CD_0", "Cm_alpha", "Cm_q", "Cm_de", "CY_beta", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr")


def test_ten_lines_from_jsbsim_s_csv_to_its_coefficients(tmp_path: Path) -> None:
    table, _ = fly_csv(tmp_path)

    from flightmodel import Aircraft, Flight, identify

    flight = Flight.from_frame(
        pandas.read_csv(table),
        columns={
            "thrust": "/fdm/jsbsim/external_reactions/thrust/magnitude",
            "da": "/fdm/jsbsim/fcs/left-aileron-pos-rad",
        },
        units={"thrust": "lbf"},
    )
    aircraft = Aircraft.estimate(
        span=1.27, mass=1.959, area=0.3097, chord=0.25, Ixx=0.07151, Iyy=0.08636, Izz=0.15364, Ixz=0.014,
        surfaces="command", airspeed="true", max_thrust=7.86, thrust_line=(0.297, 0.0, -0.046),
    )  # fmt: skip
    result = identify(flight, aircraft, progress=False)

    assert result.verdict in ("good", "care")
    for name in MAIN:
        value, std = result.values[name], result.stds[name]
        assert abs(value - TRUTH[name]) < 4.0 * std, (name, value, std, TRUTH[name])
        assert std < 0.05 * abs(TRUTH[name]), (name, std)
    assert "CL_alpha" in result.table()
    assert result.to_frame().loc["CL_alpha", "low"] < TRUTH["CL_alpha"] < result.to_frame().loc["CL_alpha", "high"]
