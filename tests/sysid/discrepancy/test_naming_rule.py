"""Names by the share of the explainable: gains that were seen on flights of another engine, with the truth beside."""

import pytest

from sim_vehicle.effects import EFFECTS
from sysid.discrepancy.candidates import Candidate
from sysid.discrepancy.identified_effect import Named, impossible
from sysid.discrepancy.naming_rule import Explained, LeftOver, is_too_little_beside, left_of_the_first
from sysid.discrepancy.significance import Significance


def explained(gains: dict[str, float], *left: float, whole: float = 0.0) -> Explained:
    axes = ("CL", "CD", "Cm", "Cl", "Cn", "CY")
    found = {axis: LeftOver("smooth terms", gain) for axis, gain in zip(axes, left, strict=False)}
    return Explained(gains, whole or sum(gains.values()), found)


@pytest.mark.parametrize(
    ("gains", "left", "whole"),
    [
        ({"actuator_lag": 34375.0}, (139.0, 455.0, 306.0, 426.0), 34375.0),
        ({"asymmetry": 180797.0}, (44.0, 38.0), 180797.0),
        ({"propwash_elevator": 11550.0}, (43.0, 111.0, 39.0, 103.0), 11550.0),
        # Without it a fit ended far beyond the one without anything, which holds all that it could find.
        ({"stall": 111896.0}, (500.0, 1619.0, 290.0, 238.0, 288.0), 18398.0),
    ],
)
def test_a_right_name_is_kept_whatever_is_left_beside_it(
    gains: dict[str, float], left: tuple[float, ...], whole: float
) -> None:
    found = explained(gains, *left, whole=whole)
    assert found.is_right
    assert not found.complete
    assert 0.85 < found.share <= 1.0
    assert found.nearest_json() == {"name": found.first, "share": found.share}
    entries = found.left_json()
    assert sum(float(str(one["share"])) for one in entries) == pytest.approx(sum(left) / found.total)


@pytest.mark.parametrize(
    ("gains", "left", "whole"),
    [
        # A ripple in lift and an oscillating moment, which no effect of the catalogue is.
        ({"lift_alpha_elevator": 1552.0}, (650.0,), 1552.0),
        ({"downwash_lag": 9884.0}, (3000.0, 1100.0), 9884.0),
        ({"vane_upwash": 300.0}, (250.0, 400.0), 300.0),
        # An elevator's lift that varies with alpha, out of the catalogue: no more than the whole is lost without it.
        ({"cg_shift": 155509.0}, (233.0, 82.0, 88.0), 582.0),
    ],
)
def test_the_nearest_name_of_what_has_none_is_told_and_not_given(
    gains: dict[str, float], left: tuple[float, ...], whole: float
) -> None:
    found = explained(gains, *left, whole=whole)
    assert not found.is_right
    assert "too little for a name (85%)" in found.reasons()[-1]
    assert found.nearest_json() is not None


def test_where_nothing_is_left_several_names_stand() -> None:
    both = explained({"stall": 900.0, "vane_lag": 500.0})
    assert both.complete
    assert both.is_right
    assert both.reasons() == []
    # In noise alone it shows too, without a gain.
    noisy = Explained({"stall": 900.0, "vane_lag": 500.0}, 1400.0, {"p": LeftOver("noise 1.5 times the sensor's")})
    assert not noisy.is_right
    assert not Explained({}).is_right
    assert Explained({}).nearest_json() is None


def test_beside_what_is_left_a_name_stands_alone() -> None:
    """Lift by the pitch rate, out of the catalogue, was a lag of the downwash and a wrong damping, with 87 % of it."""
    both = explained({"downwash_lag": 65704.0, "pitch_damping": 8136.0}, 1017.0, 446.0, 42.0, whole=10070.0)
    assert both.share > 0.85
    assert not both.is_right
    assert both.reasons()[-1].endswith("beside pitch_damping: none of them alone")
    assert both.nearest_json() == {"name": "downwash_lag", "share": both.share}


def test_what_the_first_name_may_leave_of_itself_is_no_companion() -> None:
    assert is_too_little_beside(9034967.0, 54.0)
    # What a fit without the first costs is no measure where that is more than all names explain.
    assert left_of_the_first({"stall": 111896.0, "polar_offset": 4627.0}, 18398.0) == ["polar_offset"]
    assert not is_too_little_beside(18398.0, 4627.0)
    assert left_of_the_first({"cg_shift": 155509.0, "pitch_curvature": 227.0}, 582.0) == []
    assert left_of_the_first({}, 0.0) == []


@pytest.mark.parametrize(
    ("value", "std", "right"),
    [
        # Pitch damping, where the catalogue has none, was taken for lift by the pitch rate, with 95 % of all gains.
        (-87.5, 0.25, False),
        (-39.0, 0.25, True),
        (-45.0, 3.0, True),
    ],
)
def test_a_size_that_no_aircraft_has_is_no_name(value: float, std: float, right: bool) -> None:
    candidate = Candidate(EFFECTS["lift_pitch_rate"], ("CL_q",), ({"CL_q": 0.0},))
    named = Named(candidate, Significance(0.99, 157748.0, 1e-300), (), {"CL_q": (value, std)}, 44, 9168.0)
    lines = impossible([named])
    assert (not lines) == right
    assert all("CL_q = -87.5 is beyond what an aircraft has (-40 to 40)" in line for line in lines)
