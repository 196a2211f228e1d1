"""The whole error of an estimate and its parts: closed forms, and a flight with a guessed inertia."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import fly_mav

from sim_vehicle.model.model_file import Coefficient, Correlation, Model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identification.linear_model import LinearModel
from sysid.identify import identify
from sysid.uncertainty.total import error_parts, with_total_errors

VEHICLE = load_vehicle("iitb-mav")


def _model() -> Model:
    entries = {
        "CL_alpha": Coefficient(2.0, 0.03, extra={"systematic": {"mass_1pct": 0.04, "Iyy_std": 0.0}}),
        "Cm_alpha": Coefficient(-0.5, 0.05, extra={"systematic": {"mass_1pct": 0.0, "Iyy_std": 0.04}}),
        "Cm_q": Coefficient(None, refused="x", mean=-1.0, mean_std=2.0, extra={"systematic": {"mass_1pct": 0.3}}),
    }
    matrix = ((1.0, 0.2, -0.5), (0.2, 1.0, 0.0), (-0.5, 0.0, 1.0))
    return Model("m", entries, correlation=Correlation(tuple(entries), matrix))


def test_the_total_is_the_root_of_the_squares_of_its_parts() -> None:
    # The bars hold the stated inertia already, and a usual mass not yet.
    total = with_total_errors(_model(), lambda source: source == "Iyy_std")
    lift, pitch, refused = (total.coefficients[name] for name in ("CL_alpha", "Cm_alpha", "Cm_q"))
    assert lift.std == pytest.approx(0.05)
    assert lift.extra["statistical_std"] == pytest.approx(0.03)
    assert lift.extra["interval"] == pytest.approx([2.0 - 1.96 * 0.05, 2.0 + 1.96 * 0.05])
    assert pitch.std == pytest.approx(0.05)
    assert pitch.extra["statistical_std"] == pytest.approx(0.03)
    assert (refused.value, refused.mean, refused.std) == (None, -1.0, None)
    assert refused.mean_std == pytest.approx(np.hypot(2.0, 0.3))
    assert total.correlation is not None
    matrix = np.array(total.correlation.matrix)
    assert matrix[0, 1] == pytest.approx(0.2 * 0.03 * 0.05 / (0.05 * 0.05))
    assert matrix[0, 2] == pytest.approx((-0.5 * 0.03 * 2.0 + 0.04 * 0.3) / (0.05 * np.hypot(2.0, 0.3)))


def test_the_parts_are_found_again_in_the_model() -> None:
    parts = error_parts(with_total_errors(_model(), lambda source: source == "Iyy_std"))
    assert parts is not None
    assert parts.known.names == ("CL_alpha", "Cm_alpha", "Cm_q")
    std = np.sqrt(np.diag(parts.known.covariance))
    assert std == pytest.approx([0.03, 0.03, 2.0], rel=1e-6)
    assert parts.known.covariance[0, 2] == pytest.approx(-0.5 * 0.03 * 2.0, rel=1e-6)
    assert parts.shifts["mass_1pct"] == pytest.approx([0.04, 0.0, 0.3])
    assert error_parts(replace(_model(), correlation=None)) is None


def test_of_a_file_from_before_all_error_is_the_flights() -> None:
    old = _model()  # `systematic` stands beside bars that do not hold it
    late = replace(old.coefficients["CL_alpha"], extra={"systematic": {"mass_1pct": 0.04, "timing_10ms": None}})
    parts = error_parts(replace(old, coefficients={**old.coefficients, "CL_alpha": late}))
    assert parts is not None
    assert parts.shifts == {}
    assert np.sqrt(np.diag(parts.known.covariance)) == pytest.approx([0.03, 0.05, 2.0], rel=1e-4)


def test_what_was_not_estimated_keeps_its_bars() -> None:
    once = with_total_errors(_model(), lambda source: source == "Iyy_std")
    kept = replace(once.coefficients["CL_alpha"], value=3.0)
    beside = replace(_model(), coefficients={**_model().coefficients, "CL_q": kept})
    assert with_total_errors(beside, lambda source: False).coefficients["CL_q"] == kept


def test_parts_add_up_where_a_prior_holds_the_estimate() -> None:
    """Known well before, a derivative does not follow a travel that is known to 30 %."""
    flown, _ = fly_mav("elevator-3211", 22, duration=10.0)
    elevator = replace(VEHICLE.controls["elevator"], gain_std=0.3)
    unsure = replace(VEHICLE, controls={**VEHICLE.controls, "elevator": elevator})
    before = Model("p", {"Cm_de": Coefficient(1.6, 0.001)}, correlation=Correlation(("Cm_de",), ((1.0,),)))
    alone, held = (identify([flown], unsure, method="ee", prior=prior).model for prior in (None, before))
    for found in (alone, held):
        entry = found.coefficients["Cm_de"]
        parts = (entry.extra["statistical_std"], *entry.extra["systematic"].values())
        assert entry.std == pytest.approx(np.sqrt(np.sum(np.square(parts))), rel=1e-6)
    assert (alone.coefficients["Cm_de"].std or 0.0) > 0.3
    assert (held.coefficients["Cm_de"].std or 0.0) < 0.05


@pytest.mark.parametrize("method", ["oe", "map"])
def test_a_guessed_inertia_widens_moments_and_neither_modes_nor_dimensional_derivatives(method: str) -> None:
    """The flight shows Cm over Iyy: the two go wrong together."""
    flown, _ = fly_mav("elevator-3211,aileron-doublet,rudder-doublet,elevator-doublet", 3)
    mass = VEHICLE.mass
    doubts = {f"{key}_std": 0.7 * getattr(mass, key) for key in ("Ixx", "Iyy", "Izz")}
    wrong = {key: 1.4 * getattr(mass, key) for key in ("Ixx", "Iyy", "Izz", "Ixz")}
    exact, guess = (
        identify([flown], replace(VEHICLE, mass=replace(mass, **given)), method=method)
        for given in ({}, {**doubts, **wrong})
    )
    pitch = guess.model.coefficients["Cm_alpha"]
    assert pitch.std == pytest.approx(0.5 * abs(pitch.value or 0.0), rel=0.05)  # 0.7 of 1.4 times what it is
    assert pitch.extra["statistical_std"] < 0.05 * pitch.std
    for name in ("M_alpha", "L_p", "N_beta", "Z_alpha"):
        sure, unsure = exact.mean.derivatives[name], guess.mean.derivatives[name]
        assert unsure["value"] == pytest.approx(sure["value"], rel=0.01)
        assert 0.0 < float(unsure["std"]) < 0.05 * abs(float(unsure["value"]))
    assert isinstance(exact.mean.linear, LinearModel)
    assert isinstance(guess.mean.linear, LinearModel)
    sure, unsure = ({mode.name: mode for mode in one.mean.linear.modes()} for one in (exact, guess))
    for name in ("short period", "Dutch roll"):
        frequency, std = unsure[name].frequency_hz
        assert frequency == pytest.approx(sure[name].frequency_hz[0], rel=0.01)
        assert std < 0.02 * frequency
