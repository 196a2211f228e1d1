"""Integrals of the kinematic relations against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.signal_check.kinematic_relations import integrate


def test_an_integral_is_exact_for_cubics() -> None:
    time = np.linspace(0.0, 1.0, 21)
    rates, found = np.stack([4.0 * time**3 - time, 3.0 * time**2]), np.empty((2, 21))
    integrate(rates, 0.05, found)
    assert found == pytest.approx(np.stack([time**4 - 0.5 * time**2, time**3]), abs=1e-12)
