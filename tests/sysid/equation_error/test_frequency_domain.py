"""The frequency domain: exact responses in drift and bias, standard errors that hold, a band that is found."""

import numpy as np
import pytest
from held_response import BODY, STEP_S, multisine, rolling

from sim_vehicle.model.aerodynamic_terms import parse_term
from sysid.equation_error.frequency_domain import band_of, frequency_regression
from sysid.equation_error.time_domain import settled_equations
from sysid.errors import EstimationError
from sysid.signals.flight import FlightData

NAMES = ["Cl_0", "Cl_p", "Cl_da"]


def with_columns(data, **columns):
    return FlightData(data.name, data.interval_s, data.time_s, {**data.columns, **columns}, (), data.notes)


def regressed(parts, **choice):
    equations = settled_equations(parts, BODY, NAMES)
    return frequency_regression(equations, "Cl", [parse_term(name) for name in NAMES], **choice)


def test_an_exact_response_is_told():
    found = regressed(rolling(-0.45, 0.15))
    assert found.names == ("Cl_p", "Cl_da")
    assert found.values == pytest.approx([-0.45, 0.15], rel=3e-3)
    assert found.r2 > 0.999
    assert np.median(found.coherence) > 0.999


def test_a_gyro_that_drifts_does_no_harm():
    """0.2 rad/s over the flight: its derivative is a constant moment, and the rate itself goes wrong by a ramp."""
    data = rolling(-0.45, 0.15)
    drifting = with_columns(data, p=data["p"] + np.linspace(0.0, 0.2, data.time_s.size))
    assert regressed(drifting).values == pytest.approx([-0.45, 0.15], rel=0.02)


def test_parts_count_together():
    parts = [rolling(-0.45, 0.15, seed, 500) for seed in (1, 2, 3)]
    found = regressed(parts)
    assert found.frequencies_hz.size > 2.5 * regressed(parts[0]).frequencies_hz.size
    assert found.values == pytest.approx([-0.45, 0.15], rel=5e-3)


def test_the_band_is_that_of_the_commands():
    low, high = band_of(settled_equations(rolling(-0.45, 0.15), BODY, NAMES))
    assert 0.05 < low < 0.4
    assert 2.2 < high < 2.7


def test_intervals_hold_the_truth():
    data = rolling(-0.45, 0.15)
    inside = []
    for seed in range(80):
        noise = 0.01 * np.random.default_rng(seed).standard_normal(data.time_s.size)
        found = regressed(with_columns(data, p=data["p"] + noise))
        inside.append(np.abs(found.values - [-0.45, 0.15]) < 1.96 * found.std)
    assert 0.9 < np.mean(inside) < 0.99


def test_a_delay_shows_as_disagreement_with_the_time_domain_or_lost_coherence():
    """Commands 60 ms late: the model without delay no longer explains the top of the band."""
    data = rolling(-0.45, 0.15)
    late = with_columns(data, da=np.roll(data["da"], -3))
    assert regressed(late).r2 < regressed(data).r2 - 0.01


def test_too_few_lines_are_refused_in_one_line():
    with pytest.raises(EstimationError, match="too few") as caught:
        regressed(rolling(-0.45, 0.15), band_hz=(1.0, 1.05))
    assert "\n" not in str(caught.value)


def test_without_a_command_there_is_no_band():
    data = rolling(-0.45, 0.15)
    with pytest.raises(EstimationError, match="no command moved"):
        band_of(settled_equations(with_columns(data, da=np.zeros(data.time_s.size)), BODY, ["Cl_0", "Cl_p"]))


def test_the_transform_is_the_finite_fourier_integral():
    """Against a sum written out, for a force axis at the lines of the record."""
    data = rolling(-0.45, 0.15)
    side = multisine(np.random.default_rng(9), data.time_s.size, 0.5, 2.0, 0.1)
    data = with_columns(data, ay=side, beta=0.1 * side)
    terms = [parse_term("CY_beta")]
    found = frequency_regression(settled_equations(data, BODY, ["CY_beta"]), "CY", terms, (0.5, 1.5))
    qs = 0.5 * 1.225 * 225.0 * BODY.S
    assert found.values == pytest.approx([10.0 / qs], rel=1e-9)
    assert found.frequencies_hz == pytest.approx(np.arange(10, 30) / (999 * STEP_S))
