"""Signals moved by parts of a sample, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.numerics.fractional_delay import held_back, read_later


def test_readings_are_moved_by_parts_of_a_sample() -> None:
    time = 0.02 * np.arange(200)
    late = np.sin(2.0 * np.pi * 1.5 * (time - 0.027))
    moved = read_later(late, 0.027, 0.02)
    assert moved[5:-5] == pytest.approx(np.sin(2.0 * np.pi * 1.5 * time)[5:-5], abs=1e-4)


def test_held_commands_are_moved_as_their_means() -> None:
    step = np.concatenate([np.zeros(5), np.ones(5)])
    assert held_back(step, 0.025, 0.02).tolist() == pytest.approx([0, 0, 0, 0, 0, 0, 0.75, 1, 1, 1])
    assert held_back(step, -0.02, 0.02).tolist() == [0, 0, 0, 0, 1, 1, 1, 1, 1, 1]
