"""When a gain is enough for a name."""

from __future__ import annotations

import pytest

from sysid.discrepancy.candidate_weights import is_significant, is_unlikely, weigh


@pytest.mark.parametrize(("gain", "unlikely", "named"), [(12.0, False, False), (24.0, True, False), (26.0, True, True)])
def test_a_single_parameter_is_named_from_five_standard_errors_on(gain: float, unlikely: bool, named: bool) -> None:
    (weight,) = weigh([gain], [1], 1e4)
    assert is_unlikely(weight, 46) is unlikely
    assert is_significant(weight, 46) is named


def test_more_parameters_must_gain_more() -> None:
    one, three = weigh([27.0, 27.0], [1, 3], 1e4)
    assert is_significant(one, 46)
    assert not is_significant(three, 46)


def test_among_very_many_candidates_five_standard_errors_are_not_enough() -> None:
    (weight,) = weigh([26.0], [1], 1e4)
    assert not is_significant(weight, 10_000)
