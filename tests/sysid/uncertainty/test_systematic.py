"""What late commands would do to the estimates, told from a part of a long flight, is what the whole of it tells."""

from __future__ import annotations

import pytest
from simulated import fly_mav

import sysid.uncertainty.systematic
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identification.identify import identify


@pytest.mark.whole_flight
def test_late_commands_move_the_estimates_of_some_runs_as_those_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    flights = [fly_mav("multisine", seed, duration=12.0)[0] for seed in (31, 32)]
    told = []
    for seconds in (60.0, 12.0):
        monkeypatch.setattr(sysid.uncertainty.systematic, "_REPEATED_S", seconds)
        coefficients = identify(flights, load_vehicle("iitb-mav")).model.coefficients
        told.append({name: entry.extra["late"]["timing_10ms"] for name, entry in coefficients.items()})
    of_all, of_one = told
    assert of_all != of_one
    for name in ("CL_alpha", "CD_0", "Cm_de", "Cl_beta", "Cl_p", "Cl_da"):
        assert of_one[name] == pytest.approx(of_all[name], rel=0.2), name
