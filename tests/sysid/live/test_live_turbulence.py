"""Live identification in moving air: of its gusts the estimator is told neither how strong nor how long they are."""

from __future__ import annotations

import numpy as np
import pytest
from live_flights import pieces
from simulated import fly_mav

from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.live.identifier import LiveIdentifier, LiveReport

pytestmark = pytest.mark.whole_flight

# What the simulator's sensors have, and what its model flies.
SENSORS = {
    **dict.fromkeys(("accel_bias_x", "accel_bias_y", "accel_bias_z"), 0.1962),
    **dict.fromkeys(("wind_north", "wind_east", "wind_down", "airspeed_scale", "alpha_bias", "beta_bias"), 0.0),
    **{"alpha_scale": 0.005, "beta_scale": 0.005},
}
COEFFICIENTS = {"CL_alpha": 2.453, "Cm_alpha": -0.5998, "Cn_beta": 0.08, "Cl_beta": -0.08, "CY_beta": -0.4}
GUSTS = {"short": (0.3, 20.0), "long": (0.6, 100.0), "strong": (0.8, 50.0)}


def flown(sigma: float, length: float, seed: int) -> LiveReport:
    effects = (f"turbulence:sigma={sigma},length={length}",) if sigma else ()
    signals, _ = fly_mav("multisine", seed, duration=46.0, effects=effects)
    live = LiveIdentifier(load_vehicle("iitb-mav"))
    for samples in pieces(signals, 0.1):
        live.take(samples)
    return live.report()


@pytest.mark.parametrize("gusts", GUSTS)
def test_gusts_are_not_taken_for_errors_of_the_sensors(gusts: str) -> None:
    misses, named = [], []
    for seed in range(71, 75):
        report = flown(*GUSTS[gusts], seed)
        assert report.warnings == ()
        assert report.changes == ()
        told = [(report.sensors[name], true) for name, true in SENSORS.items() if name in report.sensors]
        misses += [(error.value - true) / error.std for error, true in told]
        named += [
            (report.coefficients[name].value - true) / report.coefficients[name].std
            for name, true in COEFFICIENTS.items()
        ]
    # Of 1 each if the bars were exact; 6 and more where gusts are taken for errors of sensors.
    assert np.sqrt(np.mean(np.square(misses))) < 1.4
    assert np.sqrt(np.mean(np.square(named))) < 1.5


def test_calm_air_makes_no_bar_wide() -> None:
    calm, moving = flown(0.0, 20.0, 75), flown(0.5, 20.0, 75)
    for name in ("airspeed_scale", "alpha_scale", "beta_scale"):
        quiet = calm.sensors[name]
        assert abs(quiet.value - SENSORS[name]) < 4.0 * quiet.std
        assert name not in moving.sensors or moving.sensors[name].std > 3.0 * quiet.std
    # The noise of the vane's samples is in its scale and in the slope, and not in their product.
    assert calm.coefficients["CL_alpha"].std < 0.002 * COEFFICIENTS["CL_alpha"]
