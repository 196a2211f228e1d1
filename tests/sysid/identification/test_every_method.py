"""What holds of every method: recovery, bars, priors, bounds, and a second estimate that is the first."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from own_bars import own_bar
from simulated import fly_mav
from table_two import with_table_two

from sim_vehicle.effects import EFFECTS
from sim_vehicle.model.model_file import Coefficient, Correlation, Model, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identify import identify
from sysid.signals.flight import FlightSignals

pytestmark = pytest.mark.whole_flight

METHODS = ("map", "oe", "fe")
VEHICLE = with_table_two(load_vehicle("iitb-mav"))
TRUTH = read_model("iitb-mav").values()
MAIN = ("CL_alpha", "Cm_alpha", "Cm_q", "Cm_de", "CY_beta", "Cl_beta", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr")
SEEDS = (21, 22, 23)
# Bars by which an estimate may miss Bayes' rule: those of "map" hold more than its likelihood does (what no structure
# holds, colour that whitening left), by which the flight weighs more against a prior.
OF_BAYES = {"map": 0.25, "oe": 0.1, "fe": 0.1}


@pytest.fixture(scope="module")
def flights() -> tuple[FlightSignals, ...]:
    return tuple(fly_mav("multisine", seed, duration=12.0)[0] for seed in SEEDS)


@pytest.fixture(scope="module", params=METHODS)
def found(request: pytest.FixtureRequest, flights: tuple[FlightSignals, ...]) -> tuple[str, tuple[Model, ...]]:
    """A method, and the model of each flight by it."""
    return request.param, tuple(estimate(request.param, one) for one in flights)


def estimate(method: str, flight: FlightSignals, prior: Model | None = None, structure: Model | None = None) -> Model:
    return identify([flight], VEHICLE, method=method, systematic=False, prior=prior, structure=structure).model


def pair(model: Model, name: str) -> tuple[float, float]:
    entry = model.coefficients[name]
    assert entry.value is not None, name
    assert entry.std is not None, name
    return entry.value, own_bar(entry)


def misses(one: Model, other: Model) -> dict[str, float]:
    """By how many of the first one's bars two estimates differ."""
    return {name: abs(pair(one, name)[0] - pair(other, name)[0]) / pair(one, name)[1] for name in MAIN}


def test_the_truth_is_recovered_and_bars_are_as_wide_as_the_misses(found: tuple[str, tuple[Model, ...]]) -> None:
    """Of 33 misses over their bars the mean square is 1 to within what 33 draws, correlated in part, scatter by."""
    off = np.array([[(pair(one, n)[0] - TRUTH.get(n, 0.0)) / pair(one, n)[1] for n in MAIN] for one in found[1]])
    assert np.abs(off).max() < 4.0
    assert 0.3 < np.mean(off**2) < 2.2


def test_a_second_estimate_from_the_first_is_the_first(
    found: tuple[str, tuple[Model, ...]], flights: tuple[FlightSignals, ...]
) -> None:
    method, (first, *_) = found
    # Without correlations a prior gives start values alone.
    again = estimate(method, flights[0], prior=replace(first, correlation=None))
    assert max(misses(first, again).values()) < 0.1


def test_a_prior_counts_as_bayes_says(found: tuple[str, tuple[Model, ...]], flights: tuple[FlightSignals, ...]) -> None:
    """Two Gaussians of one number make a third (Theil & Goldberger 1961); one that knows nothing changes nothing."""
    method, (first, *_) = found
    value, std = pair(first, "Cm_alpha")
    for mean, width in ((value + std, 0.5 * std), (5.0 * value, 1e3)):
        known = Model(
            "known", {"Cm_alpha": Coefficient(mean, width)}, correlation=Correlation(("Cm_alpha",), ((1.0,),))
        )
        again = estimate(method, flights[0], prior=known)
        weight = std**2 / (std**2 + width**2)
        moved = (pair(again, "Cm_alpha")[0] - value) / std
        assert moved == pytest.approx(weight * (mean - value) / std, abs=OF_BAYES[method])
        assert pair(again, "Cm_alpha")[1] == pytest.approx(std * math.sqrt(1.0 - weight), rel=0.15)


def test_an_effect_stays_within_its_range(
    found: tuple[str, tuple[Model, ...]], flights: tuple[FlightSignals, ...]
) -> None:
    """A lag of the lift that is not there is estimated at the least one that the effect may have."""
    method, (first, *_) = found
    lag = EFFECTS["unsteady_lift"]
    structure = first.with_effect(lag, {"tau": 0.03}, {"tau": 0.03})
    tau = estimate(method, flights[0], structure=structure).effects[0].parameters["tau"]
    assert tau.value is not None
    assert lag.parameter("tau").low <= tau.value < lag.parameter("tau").low + 0.003
