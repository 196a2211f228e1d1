"""When a gain is enough for a name."""

from __future__ import annotations

import math

import pytest

from sysid.discrepancy.significance import by_information_criterion, is_significant, is_unlikely


@pytest.mark.parametrize(("gain", "unlikely", "named"), [(12.0, False, False), (24.0, True, False), (26.0, True, True)])
def test_a_single_parameter_is_named_from_five_standard_errors_on(gain: float, unlikely: bool, named: bool) -> None:
    (significance,) = by_information_criterion([gain], [1], 1e4)
    assert is_unlikely(significance, 46) is unlikely
    assert is_significant(significance, 46) is named


def test_more_parameters_must_gain_more() -> None:
    one, three = by_information_criterion([27.0, 27.0], [1, 3], 1e4)
    assert is_significant(one, 46)
    assert not is_significant(three, 46)


def test_among_very_many_candidates_five_standard_errors_are_not_enough() -> None:
    (significance,) = by_information_criterion([26.0], [1], 1e4)
    assert not is_significant(significance, 10_000)


def test_what_would_have_been_a_surprise_before_the_flight_is_less_likely() -> None:
    usual, odd = by_information_criterion([400.0, 402.0], [1, 1], 1e4, [2.0, 11.0])
    assert usual.probability == pytest.approx(1.0 / (1.0 + math.exp(-3.5)), rel=1e-6)
    assert odd.gain == 402.0
