"""What a fleet's flights say together, against closed forms and a fleet made here."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.fleet.page import fleet_page
from gcs.fleet.rows import Row
from gcs.fleet.together import together

DAY_NS = 86_400 * 10**9


def fleet(seed: int, step: float = 0.0, odd: float = 0.0) -> list[Row]:
    """Forty flights of three aircraft with their own values, scatter and bars; bravo's Cm_de steps in the middle."""
    rng, rows = np.random.default_rng(seed), []
    for aircraft, count, own in (("alpha", 13, 1.50), ("bravo", 14, 1.60), ("charlie", 13, 1.55)):
        for k in range(count):
            row: Row = {
                "flight": f"{aircraft}{k}", "source": f"/{aircraft}/{k}", "aircraft": aircraft,
                "start_ns": (100 + 3 * k) * DAY_NS, "cost_s": 1.0, "error": "", "verdict": "good", "method": "map",
            }  # fmt: skip
            for name, size in (("Cm_de", own), ("CL_alpha", 3.0 * own), ("Cl_p", -0.4), ("Cn_beta", 0.06)):
                std = abs(size) * rng.uniform(0.005, 0.02)
                changed = 1.0 + (step if aircraft == "bravo" and k >= 7 and name == "Cm_de" else 0.0)
                wrong = odd * std if (aircraft, k, name) == ("charlie", 4, "Cl_p") else 0.0
                value = size * changed + wrong + rng.normal(0.0, std) + rng.normal(0.0, 0.005 * abs(size))
                row |= {name: value, f"{name}_std": std}
            rows.append(row)
    return rows


def test_the_aircraft_whose_elevator_lost_a_tenth_is_found_with_its_date_and_no_other() -> None:
    for seed in range(20):
        rows = fleet(seed, step=-0.1)
        found = together(rows)
        ((aircraft, name, change),) = found.changes
        assert (aircraft, name, change.flight) == ("bravo", "Cm_de", "/bravo/7")
        assert 0.0 < change.p < 0.01
        assert change.after / change.before == pytest.approx(0.9, abs=0.015)
        page = fleet_page(found, rows)
        # 100 days and 7 flights of 3 days after 1970.
        assert "bravo: Cm_de changed by -" in page
        assert "1970-05-02T00:00Z" in page


def test_fleets_of_which_none_has_changed_say_so() -> None:
    """Of 40 fleets of 12 coefficients, each of which may err once in a hundred."""
    seen = [together(fleet(1000 + seed)).changes for seed in range(40)]
    assert sum(bool(one) for one in seen) <= 2
    assert "No coefficient of any aircraft has changed" in fleet_page(together(fleet(1000)), fleet(1000))


def test_an_odd_flight_is_named_and_others_are_not() -> None:
    (odd,) = together(fleet(3, odd=12.0)).outliers
    assert (odd.aircraft, odd.name, odd.flight) == ("charlie", "Cl_p", "charlie4")
    assert sum(len(together(fleet(2000 + seed)).outliers) for seed in range(20)) <= 1


def test_the_mean_over_aircraft_counts_what_they_differ_by() -> None:
    """With bars far below the differences every aircraft counts alike: their mean, and their own scatter."""
    rows = [row for row in fleet(5) if row["flight"] != "bravo13"]
    for row in rows:
        row["Cm_de_std"] = 1e-6
        row["Cm_de"] = {"alpha": 1.0, "bravo": 2.0, "charlie": 4.0}[row["aircraft"]]
    mean = together(rows).means["Cm_de"]
    assert mean.mean == pytest.approx(7.0 / 3.0, rel=1e-6)
    assert mean.scatter == pytest.approx(np.std([1.0, 2.0, 4.0], ddof=1), rel=1e-6)
    assert mean.std == pytest.approx(mean.scatter / np.sqrt(3.0), rel=1e-6)
    assert mean.change is None


def test_flights_without_a_result_stand_with_their_reason() -> None:
    rows = fleet(6)
    rows.append({"flight": "lost", "source": "/x", "aircraft": "alpha", "start_ns": 0, "cost_s": 0.1,
                 "error": "nothing <airborne> in it", "verdict": "", "method": ""})  # fmt: skip
    found = together(rows)
    assert found.failed == (("lost", "nothing <airborne> in it"),)
    assert "nothing &lt;airborne&gt; in it" in fleet_page(found, rows)
