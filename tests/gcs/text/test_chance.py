"""Probabilities as text: none is zero, none is one."""

from __future__ import annotations

import pytest

from gcs.text.probability_text import p_text, percent_text, probability_text


@pytest.mark.parametrize(
    ("p_value", "text"),
    [(None, "-"), (0.0, "< 1e-300"), (5e-324, "< 1e-300"), (2.34e-300, "2.3e-300"), (4e-31, "4e-31"), (1.0, "1")],
)
def test_a_p_value_that_is_too_small_for_numbers_is_below_what_they_tell(p_value: float | None, text: str) -> None:
    assert p_text(p_value) == text


@pytest.mark.parametrize(
    ("probability", "text"), [(None, "-"), (0.972, "0.972"), (0.999, "0.999"), (0.9999999, "> 0.999"), (1.0, "> 0.999")]
)
def test_a_probability_is_never_a_certainty(probability: float | None, text: str) -> None:
    assert probability_text(probability) == text


@pytest.mark.parametrize(("probability", "text"), [(0.972, "97.2 %"), (0.9999, "> 99.9 %"), (1.0, "> 99.9 %")])
def test_a_picture_tells_no_certainty_either(probability: float, text: str) -> None:
    assert percent_text(probability) == text
