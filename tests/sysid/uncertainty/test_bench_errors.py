"""The bench's own errors in the estimates' standard errors: curves, linkages, and whether the intervals then hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from own_bars import own_bar
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.calibration import BenchPoints, calibrate
from sysid.identify import identify
from sysid.signals.flight import FlightSignals, Signal

pytestmark = pytest.mark.whole_flight

Array = NDArray[np.float64]
JUDGED = ("CL_0", "CL_alpha", "CL_de", "CD_0", "CD_k", "Cm_0", "Cm_alpha", "Cm_de")
FORMS: dict[str, Callable[[Array], Array]] = {
    "linear": lambda x: 0.3 + 2.0 * x,
    "polynomial:3": lambda x: 0.1 + 2.0 * x + 0.3 * x**2 - 0.02 * x**3,
    "spline": lambda x: 2.0 * x + 0.1 * np.sin(3.0 * x),
}


def points(form: str, generator: np.random.Generator, noise: float) -> BenchPoints:
    readings = np.linspace(0.0, 4.0, 9)
    function = FORMS[form]
    # The spline takes the mean reading of each reference, the others regress references on readings.
    if form == "spline":
        reference = np.repeat(function(readings), 6)
        slope = 2.0 + 0.3 * np.cos(3.0 * np.repeat(readings, 6))
        reading = np.repeat(readings, 6) + noise * generator.standard_normal(54) / slope
    else:
        reading = np.repeat(readings, 6)
        reference = function(reading) + noise * generator.standard_normal(54)
    return BenchPoints(reference, reading, ("",) * 54, "test")


@pytest.mark.parametrize("form", FORMS)
def test_the_modes_are_the_scatter_of_curves_from_repeated_benches(form: str) -> None:
    generator = np.random.default_rng(3)
    at = np.array([0.4, 1.7, 2.2, 3.6])
    noise = 0.02
    curves = [calibrate(points(form, generator, noise), form, "N") for _ in range(300)]
    scatter = np.std([curve.apply(at)[0] for curve in curves], axis=0)
    told = np.sqrt(np.mean([np.sum(curve.error_modes(curve.apply(at)[0]) ** 2, axis=0) for curve in curves], axis=0))
    # 300 benches tell a standard deviation to 4 %.
    np.testing.assert_allclose(told, scatter, rtol=0.15)


def test_the_modes_of_a_pitot_follow_from_its_square_law() -> None:
    """V = sqrt((r - z) / k): dV = -V dk / 2k - dz / 2kV."""
    generator = np.random.default_rng(4)
    speeds = np.linspace(0.0, 25.0, 20)
    reading = 0.6 + 0.005 * speeds**2 + 0.004 * generator.standard_normal(20)
    curve = calibrate(BenchPoints(speeds, reading, ("",) * 20, "test"), "pitot", "m/s")
    k = curve.coefficients[0].value
    at = np.array([9.0, 14.0, 21.0])
    slopes = np.column_stack([-at / (2.0 * k), -1.0 / (2.0 * k * at)])
    expected = slopes @ curve.covariance @ slopes.T
    modes = curve.error_modes(at)
    np.testing.assert_allclose(modes.T @ modes, expected, rtol=1e-3)


def with_bench(flown: FlightSignals, seed: int) -> FlightSignals:
    """The flight as read through curves whose benches were 1 % scales and a bias off, as their scatter tells."""
    generator = np.random.default_rng(seed)
    signals = dict(flown.signals)
    for name, reference, noise in (
        ("airspeed", np.linspace(5.0, 25.0, 12), 0.6),
        ("thrust", np.linspace(-1.0, 9.0, 12), 0.3),
        ("alpha", np.linspace(-0.4, 0.4, 12), 0.02),
    ):
        unit = {"airspeed": "m/s", "thrust": "N", "alpha": "rad"}[name]
        volts = reference + 0.0  # a sensor that reads its quantity in volts
        noted = reference + noise * generator.standard_normal(12)
        curve = calibrate(BenchPoints(noted, volts, ("",) * 12, name), "linear", unit)
        one = signals[name]
        signals[name] = Signal(one.time_s, curve.apply(one.values)[0], one.unit, "adc calibrated", curve)
    return FlightSignals(flown.name, signals)


def test_intervals_hold_where_the_bench_is_the_largest_error() -> None:
    """Hidden: the errors of three curves (airspeed 1 %, thrust 2 %), far above what the flight's own noise makes."""
    vehicle, true = load_vehicle("iitb-mav"), read_model("iitb-mav").values()
    flown, _ = fly_mav("elevator-3211", 21, duration=10.0)
    scores, without_bench = [], []
    for seed in range(4):
        model = identify([with_bench(flown, seed)], vehicle, method="oe", systematic=False).model
        for name in JUDGED:
            entry = model.coefficients[name]
            if entry.value is None or entry.std is None:
                continue
            error = entry.value - true[name]
            share = sum(part**2 for part in entry.extra["bench"].values())
            scores.append(error / own_bar(entry))
            without_bench.append(error / np.sqrt(own_bar(entry) ** 2 - share))
    assert len(scores) > 24
    # Errors of one bench move all coefficients of a flight together: 4 independent draws of a few numbers each.
    held, alone = (np.sqrt(np.mean(np.square(z))) for z in (scores, without_bench))
    assert held < 1.6
    assert alone > 2.0
    assert max(np.abs(without_bench)) > 6.0
    assert max(np.abs(scores)) < 4.0


def test_what_a_bench_leaves_is_no_mistake_of_another_sensor() -> None:
    """Thrust and airspeed that are per cents off move the whole motion, and feign scales of well-read sensors."""
    flown, _ = fly_mav("multisine", 61)
    assert identify([with_bench(flown, 0)], load_vehicle("iitb-mav"), systematic=False).mistakes == ()


@pytest.mark.parametrize(("method", "gain_std"), [("oe", 0.01), ("oe", 0.3), ("ee", 0.3)])
def test_a_linkage_that_is_known_to_so_much_widens_what_it_moves_and_nothing_else(method: str, gain_std: float) -> None:
    plain = load_vehicle("iitb-mav")
    elevator = replace(plain.controls["elevator"], gain_std=gain_std)
    unsure = replace(plain, controls={**plain.controls, "elevator": elevator})
    flown, _ = fly_mav("elevator-3211", 22, duration=10.0)
    found = [identify([flown], craft, method=method, systematic=False) for craft in (plain, unsure)]
    sure_model, model = (one.model for one in found)
    # A guessed travel refuses nothing: the derivative is known as well as it is.
    assert [one.name for one in found[0].refused] == [one.name for one in found[1].refused]
    for name in ("Cm_de", "CL_de", "CL_alpha", "Cm_alpha"):
        before, after = sure_model.coefficients[name], model.coefficients[name]
        assert after.std is not None
        assert before.std is not None
        assert after.value is not None
        assert after.value == pytest.approx(before.value, rel=1e-9)
        # Deflections 1 % larger than thought make the derivative 1 % smaller.
        expected = gain_std * abs(after.value) if name.endswith("_de") else 0.0
        share = after.extra["systematic"]["elevator_gain_std"]
        assert abs(share) == pytest.approx(expected, rel=0.1, abs=0.0015)
        assert after.std**2 == pytest.approx(before.std**2 + share**2, rel=1e-6)


def test_a_filter_carries_a_guessed_travel_in_proportion() -> None:
    plain = load_vehicle("iitb-mav")
    flown, _ = fly_mav("elevator-3211", 22, duration=6.0)
    shares = []
    for gain_std in (0.003, 0.3):
        elevator = replace(plain.controls["elevator"], gain_std=gain_std)
        craft = replace(plain, controls={**plain.controls, "elevator": elevator})
        model = identify([flown], craft, method="fe", systematic=False).model
        shares.append(
            {name: model.coefficients[name].extra["systematic"]["elevator_gain_std"] for name in ("CL_alpha", "Cm_de")}
        )
        assert abs(shares[-1]["Cm_de"]) == pytest.approx(
            gain_std * abs(model.coefficients["Cm_de"].value or 0.0), rel=0.1
        )
    assert shares[1]["CL_alpha"] == pytest.approx(100.0 * shares[0]["CL_alpha"], rel=0.05, abs=1e-3)
