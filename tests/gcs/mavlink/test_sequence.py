"""The 8-bit counter made a number again, against the numbers it was cut from."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs.mavlink.sequence import DUPLICATE, LATE, NEW, number_of, sequence_states

Numbers = NDArray[np.int64]


def numbers(received: Numbers) -> tuple[Numbers, Numbers]:
    """(number, NEW, LATE or DUPLICATE) of each frame by its low byte alone."""
    state = sequence_states(1)[0]
    found = [number_of(state, int(number) & 0xFF) for number in received]
    return np.array([number for number, _ in found]), np.array([kind for _, kind in found])


@pytest.mark.parametrize("lateness", [5, 30, 90, 200])
def test_lost_and_late_frames_keep_their_numbers(lateness: int) -> None:
    generator = np.random.default_rng(lateness)
    sent = np.arange(20_000)
    kept = sent[generator.random(sent.size) > 0.05]
    late = np.where(generator.random(kept.size) < 0.2, generator.uniform(0.0, lateness, kept.size), 0.0)
    received = kept[np.argsort(kept + late, kind="stable")]
    received = np.concatenate((sent[:1], received[received > 0]))
    found, kinds = numbers(received)
    np.testing.assert_array_equal(found, received)
    newest = np.maximum.accumulate(received)
    np.testing.assert_array_equal(kinds == LATE, received < newest)
    assert not (kinds == DUPLICATE).any()


@pytest.mark.parametrize("gap", [1, 40, 130, 190, 222])
def test_a_link_that_was_silent_for_less_than_a_turn_has_lost_what_it_lost(gap: int) -> None:
    received = np.concatenate((np.arange(300), np.arange(300 + gap, 900)))
    found, kinds = numbers(received)
    np.testing.assert_array_equal(found, received)
    assert (kinds == NEW).all()


def test_a_frame_that_comes_twice_is_one() -> None:
    received = np.concatenate((np.arange(100), [99, 80], np.arange(100, 200), [170]))
    found, kinds = numbers(received)
    np.testing.assert_array_equal(found, received)
    assert np.flatnonzero(kinds == DUPLICATE).tolist() == [100, 101, 202]


def test_a_counter_that_begins_anywhere_goes_on_through_its_turn() -> None:
    found, kinds = numbers(np.arange(250, 700))
    np.testing.assert_array_equal(found, np.arange(250, 700))
    assert (kinds == NEW).all()
