"""What the side-by-side table counts as closed, right and false; and what the cost table reads from times."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from discrepancy_cost import catalogue_of, exponent, spread_over, stage_of, straight, table
from peer_table import closed, excess, naming, report

from sim_vehicle.effects import EFFECTS

TRUE = {"q": 0.01, "az": 0.1}


def line(effect="pitch_curvature", gust=0.0, named=("pitch_curvature",), sparse=()):
    """A flight on which everybody but PySINDy leaves what the truth leaves."""
    stages = {name: {"q": 0.03, "az": 0.3} for name in ("before", "sindy")}
    stages |= dict.fromkeys(("sindy_sparse", "gp", "ours", "true"), TRUE)
    return {
        "effect": effect, "gust": gust, "baseline": ["Cm_alpha", "CL_alpha"], "verdict": "none",
        "named": [[name, 0.99] for name in named], "gap": stages,
        "terms": {"sindy": [], "sindy_sparse": list(sparse)},
        "seconds": {"refit": 1.0, "sindy": 2.0, "sindy_sparse": 2.0, "gp": 3.0, "ours": 4.0},
    }  # fmt: skip


def test_a_gap_as_the_truth_leaves_it_is_closed():
    assert excess({"q": 0.03, "az": 0.3}, TRUE) == pytest.approx(3.0)
    assert excess({"q": float("inf"), "az": 0.3}, TRUE) == float("inf")
    assert closed(3.0, 1.0) == 1.0
    assert closed(3.0, 3.0) == 0.0
    assert closed(3.0, 5.0) == pytest.approx(-1.0)
    assert closed(3.0, 2.0) == pytest.approx(0.5)


def test_terms_are_right_on_the_effects_axis_alone_and_the_baselines_own_are_not_false():
    found = [
        ["Cm", ["alpha", "alpha"], 5.0], ["Cm", ["alpha", "q"], 3.0], ["CL", ["alpha"], 2.0], ["CL", ["de"], 1.0]
    ]  # fmt: skip
    assert naming(line(sparse=found), "sindy_sparse") == (True, 4, 2)
    assert naming(line(sparse=found[1:]), "sindy_sparse") == (False, 3, 2)
    assert naming(line(), "sindy_sparse") == (False, 0, 0)


def test_the_report_tells_calm_from_turbulent_air_and_who_is_right():
    lines = [line(), line(named=("cg_shift",)), line(gust=0.2, named=())]
    text = report(lines)
    _, calm, turbulent = text.split("\n\n")
    assert calm.startswith("| 2 calm flights")
    assert turbulent.startswith("| 1 turbulent flights")
    assert "| this project | 1.00 | 100 % | 100 % | 1 of 2 | 0.5 | 4 |" in calm
    assert "| this project | 1.00 | 100 % | 100 % | 0 of 1 | 0.0 | 4 |" in turbulent
    assert "| PySINDy | 3.00 | 0 % | 0 % | 0 of 2 | 0.0 | 3 |" in calm
    assert "| none |" in text.splitlines()[4]


def test_exponents_are_those_of_the_power_laws():
    stages = ("total", "preparation", "re-fit", "first look", "trials")
    rows = [dict.fromkeys(stages, 2.0 * n**0.5) | {"gap": 3.0 * n} for n in (10.0, 20.0, 40.0)]
    assert exponent((10.0, 20.0, 40.0), [row["gap"] for row in rows]) == pytest.approx(1.0)
    *_, powers, lines = table("flight, s", (10.0, 20.0, 40.0), rows).splitlines()
    assert powers == "| exponent | 0.50 | 0.50 | 0.50 | 0.50 | 0.50 | 1.00 |"
    assert lines.endswith("| 0.0 + 3.000 n |") or lines.endswith("| -0.0 + 3.000 n |")
    assert straight((10.0, 20.0, 40.0), (2.0, 3.0, 5.0)) == pytest.approx((1.0, 0.1))


def test_progress_tells_the_stage():
    assert stage_of("a first look at 43 effects", "re-fit") == "first look"
    assert stage_of("standard errors in turbulence", "trials") == "trials"


@pytest.mark.parametrize("count", [10, 40])
def test_a_cut_catalogue_keeps_what_is_hidden_and_is_whole_afterwards(count):
    before = dict(EFFECTS)
    with catalogue_of(count) as size:
        assert size == len(EFFECTS) == count
        assert {"pitch_curvature", "actuator_lag"} <= set(EFFECTS)
    assert before == EFFECTS
    assert list(before) == list(EFFECTS)
    assert spread_over(5, 9) == [0, 1, 2, 3, 4]
