"""What the search for missing effects takes back."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from sim_vehicle.effects import EFFECTS
from sim_vehicle.model import Model
from sysid.candidates import Candidate
from sysid.dryden import Turbulence
from sysid.estimate import Problem
from sysid.evidence import Weight
from sysid.filter_error import FilterErrorResult
from sysid.parameterisation import effect_parameter
from sysid.search import Named, Search, is_borne_out


def searched(value: float, std: float, calm_cost: float) -> Search:
    """A search that has named an error of the density for a great gain."""
    effect = EFFECTS["density_error"]
    candidate = Candidate(effect, ("scale",), ({"scale": 0.01},))
    covariance = np.array([[std**2]])
    result = FilterErrorResult(
        (effect_parameter("density_error", "scale"),), np.array([value]), covariance, covariance, np.zeros(15),
        Turbulence(0.2, 0.2), (), -1000.0, calm_cost, 1, True,
    )  # fmt: skip
    named = Named(candidate, Weight(1.0, 82.0, 1e-19), (), {"scale": (value, std)})
    # Neither flights nor model are looked at.
    return Search(cast("Problem", None), Model("plane", {}), [], [], result, [named], tried=44)


@pytest.mark.parametrize(("sigmas", "borne"), [(2.3, False), (10.0, True)])
def test_a_gain_with_gusts_held_fixed_counts_as_far_as_the_size_is_known_beside_them(
    sigmas: float, borne: bool
) -> None:
    assert is_borne_out(searched(sigmas * 0.01, 0.01, calm_cost=-900.0)) is borne


def test_in_calm_air_the_likelihood_is_enough() -> None:
    assert is_borne_out(searched(0.023, 0.01, calm_cost=np.nan))
