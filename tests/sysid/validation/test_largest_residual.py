"""The largest residual is reported with its time, and the surface that steps there."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sysid.validation.largest_residual import BEYOND, ResidualHistory, largest_residual, outlier_text

TIME = 4.0 + 0.02 * np.arange(500)
NOISE = 1e-3


def stretch(at: float, size: float, step_at: float | None) -> ResidualHistory:
    residual = NOISE * np.random.default_rng(0).standard_normal(TIME.size)
    residual[np.argmin(np.abs(TIME - at))] = size
    commands = np.zeros((TIME.size, 3))
    commands[:, 0] = 0.1 * np.sin(2.0 * TIME)  # a slow elevator is no step
    if step_at is not None:
        commands[step_at <= TIME, 1] = 0.2
    return ResidualHistory("second", TIME, commands, {"Cl": residual})


def test_a_residual_at_a_step_is_told_with_time_and_surface():
    found = largest_residual("Cl", NOISE, [stretch(9.0, -40.0 * NOISE, 8.9)])
    assert found is not None
    assert found.over_noise == pytest.approx(40.0)
    assert (found.flight, found.step, found.residual < 0.0) == ("second", "aileron", True)
    assert found.share == pytest.approx(1.0 / TIME.size)
    words = outlier_text({"Cl": found})
    assert words == (
        "The largest residuals of second in times of the noise:"
        " Cl 40 at 9.0 s, where the aileron steps (0.2 % of the samples beyond 10)"
    )
    both = outlier_text({"Cl": found, "Cn": replace(found, flight="third", over_noise=50.0, step=None, share=0.0)})
    assert both.startswith("The largest residuals in times of the noise: Cn 50 at 9.0 s of third (less than 0.1 % of")
    assert "; Cl 40 at 9.0 s of second, where" in both


@pytest.mark.parametrize("step_at", [None, 7.0])
def test_a_step_elsewhere_is_not_blamed(step_at):
    found = largest_residual("Cl", NOISE, [stretch(9.0, 40.0 * NOISE, step_at)])
    assert found is not None
    assert found.step is None
    assert "steps" not in outlier_text({"Cl": found})


def test_nothing_is_told_of_noise_and_of_unknown_noise():
    found = largest_residual("Cl", NOISE, [stretch(9.0, 0.0, 9.0)])
    assert found is not None
    assert found.over_noise < BEYOND
    assert outlier_text({"Cl": found}) == ""
    assert largest_residual("Cl", 0.0, [stretch(9.0, 1.0, None)]) is None
    assert largest_residual("Cl", NOISE, []) is None


@given(st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=40), st.integers(1, 3))
def test_the_largest_is_that_of_all_stretches(values, parts):
    pieces = [part for part in np.array_split(np.array(values), parts) if part.size]
    made = [ResidualHistory(str(i), np.arange(part.size) * 0.02, np.zeros((part.size, 3)), {"CL": part})
            for i, part in enumerate(pieces)]  # fmt: skip
    found = largest_residual("CL", NOISE, made)
    assert found is not None
    assert abs(found.residual) == np.max(np.abs(values))
    assert 0.0 <= found.share <= 1.0
