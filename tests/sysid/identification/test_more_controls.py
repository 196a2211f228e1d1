"""What a flap, a spoiler on one wing and a difference of thrust do, from flights of another engine."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from jsbsim_flight import Aircraft, fly, measure
from named_controls import EFFECTS, moves, named_aircraft

from sysid.identification.identify import identify
from sysid.signals.flight import FlightSignals, moved_controls

pytestmark = pytest.mark.whole_flight


@cache
def flight(number: int) -> tuple[Aircraft, FlightSignals]:
    aircraft = named_aircraft(number)
    with TemporaryDirectory() as folder:
        flown = fly(Path(folder), aircraft, number + 1, 40.0, named=moves)
    return aircraft, measure(flown, number + 1, f"named-{number}")[0]


@pytest.mark.parametrize("method", ["oe", "fe", "map"])
@pytest.mark.parametrize("number", [41, 42])
def test_every_likelihood_gives_what_they_do_within_its_bars(method: str, number: int) -> None:
    aircraft, signals = flight(number)
    found, truth = identify([signals], aircraft.vehicle, method=method).model.coefficients, aircraft.model.values()
    off = {
        n: (one.value - truth.get(n, 0.0)) / one.std for n, one in found.items() if one.value is not None and one.std
    }
    own = {name for name in off if name.partition("_")[2] in EFFECTS}
    assert own == {f"{axis}_{control}" for axis in ("CL", "CD", "CY", "Cl", "Cm", "Cn") for control in EFFECTS}
    assert max(abs(value) for value in off.values()) < 4.0, off
    assert np.mean([abs(value) < 1.96 for value in off.values()]) > 0.9, off


def test_equation_error_gives_moments_to_two_percent() -> None:
    aircraft, signals = flight(41)
    found, truth = identify([signals], aircraft.vehicle, method="ee").model.values(), aircraft.model.values()
    for name in ("Cl_left_spoiler", "Cn_thrust_difference"):
        assert found[name] == pytest.approx(truth[name], rel=0.02), name


def test_a_control_that_did_not_move_has_no_terms() -> None:
    still, moved = np.full(50, 0.3), np.linspace(0.0, 0.2, 50)
    named = ("flap", "spoiler", "tab")
    assert moved_controls(named, [{"flap": still, "spoiler": moved}]) == ["spoiler"]
    # Set elsewhere in another flight it has moved.
    assert moved_controls(named, [{"flap": still}, {"flap": 0.0 * still}]) == ["flap"]
