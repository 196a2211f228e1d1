"""When a gain is enough for a name."""

from __future__ import annotations

import math

import pytest

from sysid.discrepancy.significance import by_evidence, is_significant, is_unlikely


@pytest.mark.parametrize(("gain", "unlikely", "named"), [(12.0, False, False), (24.0, True, False), (26.0, True, True)])
def test_a_single_parameter_is_named_from_five_standard_errors_on(gain: float, unlikely: bool, named: bool) -> None:
    (significance,) = by_evidence([(10.0, gain, 1)])
    assert is_unlikely(significance, 46) is unlikely
    assert is_significant(significance, 46) is named


def test_more_parameters_must_gain_more() -> None:
    one, three = by_evidence([(10.0, 27.0, 1), (10.0, 27.0, 3)])
    assert is_significant(one, 46)
    assert not is_significant(three, 46)


def test_among_very_many_candidates_five_standard_errors_are_not_enough() -> None:
    (significance,) = by_evidence([(10.0, 26.0, 1)])
    assert not is_significant(significance, 10_000)


def test_probabilities_are_shares_of_the_evidence_no_effect_being_one_of_them() -> None:
    sure, less = by_evidence([(200.0, 400.0, 1), (196.5, 402.0, 1)])
    assert sure.probability == pytest.approx(1.0 / (1.0 + math.exp(-3.5)), rel=1e-6)
    assert less.gain == 402.0
    (none,) = by_evidence([(-1.0, 12.0, 1)])
    assert none.probability == pytest.approx(math.exp(-1.0) / (1.0 + math.exp(-1.0)))
