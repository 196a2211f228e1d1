"""The likelihood where what it stands on is no number."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.posterior.likelihood import Point, Prior, WhittleLikelihood


class _AsItIs(WhittleLikelihood):
    """One part whose residuals are white already."""

    def __init__(self, slopes: Array) -> None:
        self.model = cast(Any, SimpleNamespace(slopes=lambda index, theta: slopes))
        self.prior = Prior(np.zeros(2), np.eye(2))

    def whitened(self, index: int, series: Array) -> Array:
        return series[0]


def test_slopes_that_diverge_beside_a_point_are_said_so_and_lead_nowhere() -> None:
    """Steps from such slopes ended at places that are no numbers, and whoever read inputs there at a ValueError."""
    at = Point(np.zeros(2), [np.ones((1, 3))], [np.zeros((1, 3))])
    H, g = _AsItIs(np.ones((1, 3, 2))).normal(at)
    np.testing.assert_allclose(H, 3.0 + np.eye(2))
    np.testing.assert_allclose(g, [3.0, 3.0])
    lost = np.ones((1, 3, 2))
    lost[0, 2, 1] = np.inf
    with pytest.raises(EstimationError, match="diverges beside"):
        _AsItIs(lost).normal(at)
