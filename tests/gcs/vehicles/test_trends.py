"""Whether a coefficient has changed over flights, against what chance alone does."""

import numpy as np
import pytest
from scipy import stats

from gcs.vehicles.trends import Estimate, trend

pytestmark = pytest.mark.whole_flight

DAY = 86_400_000_000_000


def flights(values: np.ndarray, std: float) -> list[Estimate]:
    return [Estimate(f"f{n}", "", n * DAY, float(value), std) for n, value in enumerate(values)]


def test_an_elevator_that_lost_a_tenth_is_found_with_its_flight() -> None:
    generator = np.random.default_rng(2)
    true = np.where(np.arange(14) < 7, -1.10, -0.99)
    found = trend("Cm_de", flights(true + 0.02 * generator.standard_normal(14), 0.02)[::-1])
    assert found.change is not None
    assert found.change.flight in ("f6", "f7", "f8")
    assert found.change.p < 1e-4
    assert found.change.before == pytest.approx(-1.10, abs=0.03)
    assert found.change.after == pytest.approx(-0.99, abs=0.03)
    assert found.constant_p is not None
    assert found.constant_p < 1e-4


@pytest.mark.parametrize("scatter", [0.0, 0.05, 0.2])
def test_flights_that_differ_by_chance_alone_have_not_changed(scatter: float) -> None:
    """Of a thousand aircraft at most one in a hundred, whether or not flights differ beyond their errors."""
    generator = np.random.default_rng(3)
    said = 0
    for _ in range(1000):
        values = 4.0 + np.hypot(0.05, scatter) * generator.standard_normal(13)
        said += trend("CL_alpha", flights(values, 0.05)).change is not None
    assert said <= 15


@pytest.mark.parametrize(
    ("count", "stds", "scatter"), [(6, (0.02, 0.5), 1.0), (13, (0.05, 0.2), 0.2), (8, (0.05, 0.2), 0.0)]
)
def test_nor_have_those_whose_flights_are_known_unequally_well(
    count: int, stds: tuple[float, ...], scatter: float
) -> None:
    generator = np.random.default_rng(4)
    said = 0
    for _ in range(500):
        std = generator.choice(stds, count)
        values = 4.0 + np.hypot(std, scatter) * generator.standard_normal(count)
        estimates = [Estimate(f"f{n}", "", n * DAY, float(values[n]), float(std[n])) for n in range(count)]
        said += trend("CL_alpha", estimates).change is not None
    assert said <= 10


def test_mean_and_constancy_are_those_of_the_books() -> None:
    values, std = np.array([1.0, 1.2, 0.9, 1.05]), 0.1
    found = trend("x", flights(values, std))
    assert found.mean == pytest.approx(np.mean(values))
    # DerSimonian and Laird's variance between flights, for equal errors: (Q - 3) / (n / s^2 - 1 / s^2).
    between = max(0.0, (np.sum((values - values.mean()) ** 2) / std**2 - 3.0) * std**2 / 3.0)
    assert found.scatter == pytest.approx(np.sqrt(between))
    assert found.std == pytest.approx(np.sqrt((std**2 + between) / 4.0))
    assert found.constant_p == pytest.approx(stats.chi2.sf(np.sum((values - values.mean()) ** 2) / std**2, 3))


def test_a_single_flight_has_no_trend() -> None:
    found = trend("x", flights(np.array([1.0]), 0.1))
    assert (found.mean, found.std, found.constant_p, found.change) == (1.0, pytest.approx(0.1), None, None)
