"""The autopilot holds the flight whatever the signs of the surfaces, and lets go while a manoeuvre runs."""

import numpy as np
import pytest

from sim_vehicle.effects import parse_effect
from sim_vehicle.flight.autopilot import control_effectiveness
from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.flight.flight_loop import fly, wind_of
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.manoeuvres.plan import Plan, plan_of
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle

VEHICLE = load_vehicle("iitb-mav")
MODEL = read_model("iitb-mav")


def flown(model: Model, plan: Plan, wind: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> FlownFlight:
    plant = Plant(VEHICLE, model)
    suite = SensorSuite(VEHICLE, noise="table2", generator=np.random.default_rng(2))
    return fly(plant, plan, suite=suite, generator=np.random.default_rng(3), wind=wind_of(plant, wind))


def flipped(model: Model) -> Model:
    for name in ("Cm_de", "CL_de", "Cl_da", "Cn_da", "Cn_dr", "CY_dr"):
        model = model.with_coefficient(name, -MODEL.values()[name])
    return model


def test_effectiveness_is_that_of_the_control_derivatives() -> None:
    plant = Plant(VEHICLE, MODEL)
    trim = plant.trim(altitude=0.0)
    pitch, roll, yaw, thrust = control_effectiveness(plant, trim)
    # qbar S c Cm_de / Iyy and so on, at the sea-level density.
    force = 0.5 * 1.225 * 15.0**2 * 0.2
    assert pitch == pytest.approx(force * 0.2 * 1.5894 / 0.03, rel=1e-6)
    assert roll == pytest.approx(force * 1.0 * 0.15 / 0.02, rel=1e-6)
    assert yaw == pytest.approx(force * 1.0 * -0.08 / 0.045, rel=1e-6)
    assert thrust == pytest.approx(8.0, rel=1e-6)


@pytest.mark.parametrize("model", [MODEL, flipped(MODEL)], ids=["as given", "signs turned"])
def test_holds_height_speed_and_level_wings_in_gusts(model: Model) -> None:
    gusty = model.with_effect(*parse_effect("turbulence:sigma=0.5,length=30"))
    flight = flown(gusty, plan_of(["cruise"]).fitted(60.0), wind=(3.0, 2.0, 0.0))
    assert np.abs(flight.truth["down"] + 100.0).max() < 5.0
    assert abs(flight.truth["V"].mean() - 15.0) < 0.3
    assert np.abs(flight.truth["phi"]).max() < 0.5
    assert np.abs(flight.truth["psi"]).max() < 0.5


def test_comes_back_to_trim_after_a_manoeuvre() -> None:
    flight = flown(MODEL, plan_of(["elevator-pulse", "aileron-pulse", "rudder-pulse", "cruise"]))
    assert abs(flight.truth["down"][-1] + 100.0) < 3.0
    assert abs(flight.truth["V"][-1] - 15.0) < 0.5
    assert abs(flight.truth["phi"][-1]) < 0.05
    assert abs(flight.truth["psi"][-1]) < 0.1


def test_the_elevator_is_left_alone_while_it_is_excited() -> None:
    flight = flown(MODEL, plan_of(["elevator-pulse"]))
    free = flight.truth["de"][101 + 2 :]
    assert np.ptp(free) == 0.0
    assert np.ptp(flight.truth["throttle"][101:]) < 1e-6


def test_a_control_without_effect_stays_at_rest() -> None:
    longitudinal = Model("longitudinal", {n: c for n, c in MODEL.coefficients.items() if n[:2] in ("CL", "CD", "Cm")})
    flight = flown(longitudinal, plan_of(["elevator-pulse"]))
    assert not flight.truth["da"].any()
    assert not flight.truth["dr"].any()


def test_lags_and_delays_of_the_actuators_do_not_upset_it() -> None:
    slow = MODEL.with_effect(*parse_effect("actuator_lag:tau=0.08")).with_effect(
        *parse_effect("actuator_delay:delay=0.06")
    )
    slow = slow.with_effect(*parse_effect("turbulence:sigma=0.3"))
    flight = flown(slow, plan_of(["cruise"]).fitted(30.0))
    assert np.abs(flight.truth["theta"] - flight.truth["theta"][0]).max() < 0.2
    assert np.abs(flight.truth["down"] + 100.0).max() < 5.0
