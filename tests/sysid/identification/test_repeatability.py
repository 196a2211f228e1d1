"""Several flights, each by itself: do they scatter as their bars say?"""

from __future__ import annotations

import numpy as np
import pytest
from simulated import fly_mav

from gcs.analysis.results import identification_text
from gcs.report.page import report
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identification.repeatability import FlightScatter, scattered
from sysid.identification.result_file import result_json
from sysid.identify import identify

VEHICLE = load_vehicle("iitb-mav")
PLANS = ("multisine", "elevator-3211,aileron-doublet,rudder-doublet", "elevator-doublet,rudder-doublet,aileron-doublet")


def test_the_ratio_is_the_scatter_over_the_bars() -> None:
    generator = np.random.default_rng(3)
    std = generator.uniform(0.5, 2.0, 4000)
    drawn = 7.0 + 1.3 * std * generator.standard_normal(4000)
    values = {str(i): (float(v), float(s)) for i, (v, s) in enumerate(zip(drawn, std, strict=True))}
    assert FlightScatter(values).ratio == pytest.approx(1.3, rel=0.03)
    assert FlightScatter({"a": (1.0, 0.1), "b": (1.2, 0.1), "c": (1.4, 0.1)}).ratio == pytest.approx(2.0)


def test_two_flights_are_no_scatter() -> None:
    each = {str(i): {"Cm_q": (float(i), 1.0), **({"CL_q": (0.0, 1.0)} if i else {})} for i in range(3)}
    assert list(scattered(each)) == ["Cm_q"]


@pytest.mark.parametrize("method", ["map", "ee", "oe"])
def test_flights_of_one_aircraft_scatter_about_as_their_bars_say(method: str) -> None:
    # Bars of equation error do not hold what sharp steps are between samples.
    plans = ("multisine",) * 4 if method == "ee" else (*PLANS, "multisine")
    flights = [fly_mav(plan, 110 + i, duration=24.0)[0] for i, plan in enumerate(plans)]
    found = identify(flights, VEHICLE, method=method, systematic=False).repeatability
    assert {"CL_alpha", "Cm_alpha", "Cm_de", "CY_beta", "Cl_p", "Cn_beta"} <= found.keys()
    ratios = np.array([one.ratio for one in found.values()])
    assert 0.3 < np.median(ratios) < 2.0


def test_an_aircraft_that_changed_between_flights_is_seen() -> None:
    effects = ("", "", "cg_shift:x=0.02", "cg_shift:x=0.02")
    flights = [
        fly_mav("multisine", 120 + i, duration=14.0, effects=(effect,) if effect else ())[0]
        for i, effect in enumerate(effects)
    ]
    found = identify(flights, VEHICLE, method="map", systematic=False)
    assert found.repeatability["Cm_alpha"].ratio > 2.5
    result = result_json(found)
    entry = result["repeatability"]["Cm_alpha"]
    assert set(entry["flights"]) == {flight.name for flight in flights}
    assert "repeatability: 4 flights, each by itself" in identification_text(result)
    page = report(result)
    assert "Repeatability" in page
    assert "Each dot is a flight by itself" in page
