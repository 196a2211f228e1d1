"""Curves and residual statistics of a result, against series whose statistics are known."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from simulated import fly_mav

from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identification.result_file import result_json
from sysid.identify import identify
from sysid.signals.record import OUTPUTS
from sysid.validation.residual_series import extremes, output_residuals, rounded

pytestmark = pytest.mark.whole_flight

VEHICLE = load_vehicle("iitb-mav")
ACCELEROMETER_NOISE = 0.0785  # m/s^2, of the simulated sensors


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    first, second = (replace(fly_mav("multisine", seed)[0], name=f"flight {seed}") for seed in (1, 2))
    return result_json(identify([first], VEHICLE, validate_on=[second], method="ee", systematic=False))


def run_with(values: np.ndarray, output: str) -> np.ndarray:
    """Residuals (N, 15) of one output, the others missing."""
    residuals = np.full((values.size, len(OUTPUTS)), np.nan)
    residuals[:, OUTPUTS.index(output)] = values
    return residuals


def first_order(samples: int, pole: float, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal(samples)
    values = np.zeros(samples)
    for i in range(1, samples):
        values[i] = pole * values[i - 1] + noise[i]
    return values


def test_thinning_keeps_the_peaks_of_both_signals() -> None:
    generator = np.random.default_rng(0)
    measured, predicted = generator.standard_normal((2, 50_000))
    measured[31_234], predicted[777] = 9.0, -9.0
    kept = extremes(measured, predicted, 300)
    assert kept.size <= 300
    assert np.all(np.diff(kept) > 0)
    assert {31_234, 777} <= set(kept.tolist())


def test_a_short_signal_is_kept_whole() -> None:
    assert extremes(np.zeros(7), np.ones(7), 300).tolist() == list(range(7))


def test_numbers_have_five_digits() -> None:
    assert rounded(np.array([1.2345678e-7, -123456.0, 0.0])) == [1.2346e-7, -123460.0, 0.0]


def test_the_autocorrelation_is_that_of_statsmodels() -> None:
    from statsmodels.tsa.stattools import acf

    values = first_order(3000, 0.8, 1) + 5.0
    found = output_residuals([run_with(values, "q")], 0.02)
    assert list(found) == ["q"]
    entry = found["q"]
    assert entry["autocorrelation"] == pytest.approx(acf(values, nlags=50, adjusted=True), abs=2e-5)
    assert (entry["lag_step_s"], entry["samples"]) == (0.02, 3000)
    assert entry["limit"] == pytest.approx(1.96 / np.sqrt(3000))


def test_missing_samples_and_several_runs_leave_the_correlation_as_it_is() -> None:
    """Runs of a first-order process of pole 0.8, a tenth of the samples lost: 0.8^lag (standard error 0.02)."""
    runs = []
    for seed in range(4):
        values = first_order(10_000, 0.8, seed)
        values[np.random.default_rng(seed).random(values.size) < 0.1] = np.nan
        runs.append(run_with(values, "alpha"))
    entry = output_residuals(runs, 0.02)["alpha"]
    assert entry["autocorrelation"][:8] == pytest.approx(0.8 ** np.arange(8), abs=0.05)


def test_lags_reach_one_second_at_any_rate() -> None:
    entry = output_residuals([run_with(first_order(4000, 0.5, 0), "p")], 0.0025)["p"]
    assert entry["lag_step_s"] == pytest.approx(0.02)
    assert (len(entry["autocorrelation"]) - 1) * entry["lag_step_s"] == pytest.approx(1.0)


def test_a_sparse_output_has_no_lags() -> None:
    values = np.full(1000, np.nan)
    values[::10] = 1.0
    assert output_residuals([run_with(values, "vn")], 0.02) == {}


def test_a_result_holds_the_curves_of_the_flight_it_is_judged_by(result: dict[str, Any]) -> None:
    series = result["series"]
    assert series["use"] == "validation"
    (flight,) = series["flights"]
    assert flight["flight"] == "flight 2"
    assert sorted(flight["axes"]) == ["CD", "CL", "CY", "Cl", "Cm", "Cn"]
    for entry in flight["axes"].values():
        sizes = {len(column) for column in entry.values()}
        assert len(sizes) == 1
        assert max(sizes) <= 300
        assert np.all(np.diff(entry["time_s"]) > 0.0)
        assert np.corrcoef(entry["measured"], entry["predicted"])[0, 1] > 0.8
    # Time histories are whole, twenty seconds of eleven outputs; the rest is small.
    (history,) = series["simulated"]
    assert len(history["time_s"]) == pytest.approx(1000, abs=30)
    rest = {**result, "series": {name: entry for name, entry in series.items() if name != "simulated"}}
    assert len(json.dumps(rest, indent=2)) < 300_000


def test_no_residual_is_smaller_than_the_noise_that_nothing_predicts(result: dict[str, Any]) -> None:
    """CY = m ay / (qbar S): the accelerometer's noise of 0.008 g stays, whatever the model."""
    airspeed = result["model"]["validity"]["airspeed"]
    dynamic_pressure = 0.5 * 1.225 * max(airspeed) ** 2
    noise = VEHICLE.mass.mass * ACCELEROMETER_NOISE / (dynamic_pressure * VEHICLE.geometry.S)
    found = result["series"]["residuals"]["CY"]
    assert found["std"] > noise
    assert found["std"] == pytest.approx(result["validation"]["outputs"]["CY"]["residual_std"], rel=1e-6)
    assert sum(found["histogram"]["counts"]) == found["samples"]


def test_the_largest_residual_is_that_of_the_curves_and_of_the_same_noise(result: dict[str, Any]) -> None:
    found = result["validation"]
    (curves,) = result["series"]["flights"]
    for axis, output in found["outputs"].items():
        at, curve = output["largest_at"], curves["axes"][axis]
        drawn = np.abs(np.array(curve["measured"]) - np.array(curve["predicted"]))
        assert at["flight"] == "flight 2"
        assert abs(at["residual"]) >= drawn.max() * (1.0 - 1e-3)
        assert curve["time_s"][0] <= at["time_s"] <= curve["time_s"][-1]
        rms = np.hypot(output["residual_mean"], output["residual_std"])
        assert abs(at["residual"]) / rms == pytest.approx(
            output["largest_over_noise"] / output["rms_over_noise"], rel=1e-3
        )
    told = [axis for axis, output in found["outputs"].items() if output["largest_over_noise"] > 10.0]
    assert bool(told) == bool(found["outliers"])
    assert all(f"{axis} " in found["outliers"] for axis in told)
