"""The likelihood: its slopes, its band, and where what it stands on is no number."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy import signal

from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.posterior.likelihood import Point, Prior, WhittleLikelihood, of_one_noise
from sysid.posterior.observations import common_grid


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


@dataclass
class _FirstOrder:
    """A rate behind a command, of unknown bandwidth and gain, and a second output that is noise alone."""

    measured_rows: Array
    command: Array
    highest: dict[str, float]
    outputs: tuple[str, ...] = ("p", "ay")

    def __post_init__(self) -> None:
        self.parts = (SimpleNamespace(flight="one", common=GRID, highest_hz=lambda name, whole: self.highest[name]),)

    def simulated(self, index: int, theta: Array) -> Array:
        bandwidth, gain = theta
        left = np.exp(-bandwidth * GRID.interval_s)
        p = signal.lfilter([0.0, gain * (1.0 - left)], [1.0, -left], self.command)
        return np.stack((p, np.zeros_like(p)))

    def measured(self, index: int) -> Array:
        return self.measured_rows

    def slopes(self, index: int, theta: Array) -> Array:
        found = []
        for k in range(2):
            step = np.zeros(2)
            step[k] = 1e-5
            found.append((self.simulated(0, theta + step) - self.simulated(0, theta - step)) / 2e-5)
        return np.stack(found, axis=2)

    def steps_at_stamps(self, index: int) -> bool:
        return True


GRID = common_grid(0.0, 60.0, 0.02, [], 0.5)


def _whittle(rows: Array, command: Array, highest: dict[str, float]) -> WhittleLikelihood:
    model = cast(Any, _FirstOrder(rows, command, highest))
    far = np.full(2, np.inf)
    return WhittleLikelihood(model, Prior(np.zeros(2), np.zeros((2, 2))), -far, far, {"p": 0.1, "ay": 0.1})


def _flown(seed: int) -> tuple[Array, Array]:
    generator = np.random.default_rng(seed)
    command = np.repeat(generator.uniform(-0.1, 0.1, 200), 20)[: GRID.points.size]
    rows = _FirstOrder(np.zeros((2, 1)), command, {"p": 1.0, "ay": 1.0}).simulated(0, np.array([12.0, 5.0]))
    gusts = signal.lfilter([0.05], [1.0, -0.9], generator.standard_normal(rows.shape), axis=1)
    return rows + gusts, command


def test_the_likelihoods_own_slopes_are_those_of_its_values_where_weights_move_with_the_estimate() -> None:
    rows, command = _flown(0)
    likelihood = _whittle(rows, command, {"p": 25.0, "ay": 25.0})
    for theta in (np.array([12.0, 5.0]), np.array([18.0, 4.5])):
        at = likelihood.point(theta)
        likelihood.weigh(at)
        H, held = likelihood.normal(at)
        std = 1.0 / np.sqrt(np.diag(H))
        found = likelihood.profile_gradient(at, 0.05 * std)
        # The weights are left as they were.
        np.testing.assert_allclose(likelihood.normal(at)[1], held)
        for k in range(2):
            step = np.zeros(2)
            step[k] = 0.02 * std[k]
            costs = [likelihood.profile_cost(theta + off) for off in (step, -step)]
            assert found[k] * std[k] == pytest.approx((costs[1] - costs[0]) / 0.04, rel=0.03, abs=0.03)
        # They are not those of held weights.
        assert np.max(np.abs((found - held) * std)) > 0.05


def test_an_output_says_nothing_beyond_its_own_limit_and_the_others_go_on() -> None:
    rows, command = _flown(1)
    spoiled = rows.copy()
    spoiled[1] += 0.5 * np.sin(2.0 * np.pi * 10.0 * GRID.points)
    at, costs, slopes = np.array([12.0, 5.0]), [], []
    for one in (rows, spoiled):
        likelihood = _whittle(one, command, {"p": 25.0, "ay": 4.0})
        costs.append(likelihood.profile_cost(at))
        slopes.append(likelihood.normal(likelihood.point(at))[0])
    assert costs[1] == pytest.approx(costs[0], abs=0.5)
    np.testing.assert_allclose(slopes[1], slopes[0], rtol=1e-3)
    narrow = _whittle(rows, command, {"p": 4.0, "ay": 4.0})
    narrow.profile_cost(at)
    # What the roll says beyond the limit of the other output counts.
    assert np.all(np.diag(slopes[0]) > 1.02 * np.diag(narrow.normal(narrow.point(at))[0]))


def test_noise_of_windows_is_one_where_their_grids_are_and_that_of_a_flight_its_own() -> None:
    def part(flight: str, seconds: float, interval_s: float) -> Any:
        return SimpleNamespace(flight=flight, common=common_grid(0.0, seconds, interval_s, [], 0.1))

    parts = [
        part("whole", 30.0, 0.02), part("a", 2.0, 0.0400), part("b", 1.5, 0.0404), part("slow", 3.0, 0.1),
        part("whole", 10.0, 0.02), part("of two", 5.0, 0.02), part("of two", 5.0, 0.02), part("c", 2.0, 0.0397),
    ]  # fmt: skip
    assert sorted(map(sorted, of_one_noise(parts))) == [[0, 4], [1, 2, 7], [3], [5, 6]]
