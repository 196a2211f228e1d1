"""Effects of aircraft drawn at random that JSBSim flies, where the search begins far from the truth."""

from __future__ import annotations

from pathlib import Path

import pytest
from jsbsim_effects import hidden
from jsbsim_flight import drawn_aircraft, fly, measure

from sysid.discrepancy import discrepancy

pytestmark = pytest.mark.whole_flight


@pytest.mark.parametrize(
    "name",
    [
        # Without it the fit of what is left takes the whole motion for noise.
        "roll_damping",
        # Without it the commands seem to act a sample early, and in what comes next an accelerometer out of place.
        "polar_offset",
    ],
)
def test_it_is_named_alone_and_within_its_bars(name: str, tmp_path: Path) -> None:
    effect = hidden(name, 1.0, drawn_aircraft(1))
    signals, _ = measure(fly(tmp_path, effect.flown, 1000, 14.0), 1000, name)
    found = discrepancy([signals], effect.vehicle, effect.baseline(1000, 0.05))
    assert found["verdict"] == "missing_effect"
    (named,) = found["effects"]
    assert named["name"] == name
    for key, value in effect.parameters.items():
        estimate = named["parameters"][key]
        assert abs(estimate["value"] - value) < 4.0 * estimate["std"]
