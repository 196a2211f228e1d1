"""What a search comes to: which fit every part of the outcome is of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from sim_vehicle.effects import EFFECTS
from sysid.discrepancy import verdict
from sysid.discrepancy.candidates import Candidate
from sysid.discrepancy.forward_selection import SelectionState
from sysid.discrepancy.identified_effect import Named
from sysid.discrepancy.naming_rule import LeftOver
from sysid.discrepancy.significance import Significance


@dataclass
class Flights:
    """Stands for a comparison: each part of it is the fit that it is asked for."""

    base: str = "before"
    astray: str = ""
    away: float = 0.0
    method: str = "map"
    quality: Any = None
    warnings: tuple[str, ...] = ("given",)
    outputs: None = None

    def lost(self, fit: str) -> str:
        return self.astray

    def used(self, fit: str) -> Any:
        return fit

    judged = used

    def whole_model(self, fit: str) -> Any:
        return fit, ["lacking"]

    def turbulence(self, fit: str) -> float:
        return float(len(fit))

    def remarks(self, fit: str) -> list[str]:
        return [f"remark of {fit}"]

    def moved(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([self.away]), np.eye(1)


def searched(left: float = 0.0, *, named: bool = True) -> SelectionState[Any]:
    candidate = Candidate(EFFECTS["mass_error"], ("scale",), ({"scale": 0.05},))
    one = Named(candidate, Significance(0.99, 900.0, 1e-99), (), {"scale": (0.05, 0.001)}, 40, 900.0)
    base: Any = "before"
    found: SelectionState[Any] = SelectionState(base, "with it" if named else base)
    if named:
        found.named, found.gains, found.whole = [one], {"mass_error": 900.0}, 900.0
    found.left = {"CL": LeftOver("smooth terms", left)} if left else {}
    return found


def outcome(flights: Flights, found: SelectionState[Any], monkeypatch: pytest.MonkeyPatch, wider: float = 0.5) -> Any:
    monkeypatch.setattr(verdict, "widening", lambda used, outputs: wider)
    return verdict.outcome(flights, found)


def test_a_right_name_is_given_with_all_that_is_of_its_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    found = outcome(Flights(), searched(50.0), monkeypatch)
    assert (found.verdict.name, found.verdict.explained.complete) == ("missing_effect", False)
    assert (found.used, found.judged, found.model, found.turbulence) == ("with it", "with it", "with it", 7.0)
    assert found.warnings == ("given", "lacking")
    assert [one.effect for one in found.named] == ["mass_error"]
    assert "remark of with it" in found.verdict.reasons


@pytest.mark.parametrize(
    ("astray", "left", "wider", "why"),
    [
        ("the filter does not follow the flight", 0.0, 0.5, "the filter does not follow the flight"),
        ("", 400.0, 0.5, "mass_error takes 69% of what can be explained, too little for a name (85%)"),
        ("", 0.0, 1.5, "with what was named the gap on these flights is 1.50 times as wide"),
    ],
)
def test_of_a_name_that_is_taken_back_nothing_is_left_but_the_reason(
    monkeypatch: pytest.MonkeyPatch, astray: str, left: float, wider: float, why: str
) -> None:
    found = outcome(Flights(astray=astray), searched(left), monkeypatch, wider)
    assert found.verdict.name == "unexplained"
    assert found.named == ()
    assert (found.used, found.judged, found.model, found.turbulence) == ("before", "before", "before", 6.0)
    assert why in found.verdict.reasons


@pytest.mark.parametrize(
    ("away", "left", "name"), [(1.0, 0.0, "none"), (8.0, 0.0, "parameter_error"), (8.0, 90.0, "unexplained")]
)
def test_without_a_name_what_is_left_and_how_far_coefficients_moved_decide(
    monkeypatch: pytest.MonkeyPatch, away: float, left: float, name: str
) -> None:
    # A filter that follows nothing has then named nothing either: it is no reason for saying that nothing is missing.
    found = outcome(Flights(astray="lost", away=away), searched(left, named=False), monkeypatch)
    assert found.verdict.name == name
    assert "lost" not in found.verdict.reasons
