"""Noise of measured thrust in filter error: what is left of it, against the truth, counts once."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.filter_error.thrust_noise import with_thrust_errors
from sysid.problem.estimation_problem import Motion, Problem
from sysid.signals.record import OUTPUTS, Record
from sysid.signals.thrust.denoising import Denoised, denoised_thrust

Array = NDArray[np.float64]

N, DT, SIGMA, RUNS = 1200, 0.02, 0.3, 40
STEPS = 0.5 + 0.2 * np.sign(np.sin(0.9 * DT * np.arange(N)))
SWINGS = np.cos(np.pi * np.outer(np.arange(1, 61), np.arange(N) + 0.5) / N)
SIGNS = np.random.default_rng(1).choice([-1.0, 1.0], 60)


def record_of(denoised: Denoised) -> Record:
    """A record that is told this thrust and nothing else."""
    n = denoised.values.size
    return Record(
        "f", DT, DT * np.arange(n), 0, np.zeros((n, 4)), denoised.values, np.full(n, 1.2),
        np.full((n, len(OUTPUTS)), np.nan), np.zeros((0, 9)), 0.0, denoised.doubt, thrust_noise=denoised.noise,
    )  # fmt: skip


def counted(denoised: Denoised) -> Record:
    """The same as filter error takes it."""
    problem = Problem(load_vehicle("iitb-mav"), (record_of(denoised),), (), Motion(True, True), {})
    found = with_thrust_errors(problem, [])
    assert found.thrust_errors == found.records[0].thrust_doubt.shape[0]
    return found.records[0]


@pytest.mark.parametrize(
    ("throttle", "swings", "state"),
    [(np.full(N, 0.5), 0.0, False), (STEPS, 0.0, False), (np.full(N, 0.5), 0.75, True)],
    ids=["steady", "throttle steps", "swings"],
)
def test_unknowns_and_state_together_are_what_is_left(throttle: Array, swings: float, state: bool) -> None:
    true = 8.0 * throttle + swings * SIGNS @ SWINGS
    generator = np.random.default_rng(3)
    left, told = [], []
    for _ in range(RUNS):
        denoised = denoised_thrust(true + SIGMA * generator.standard_normal(N), throttle, DT)
        record = counted(denoised)
        left.append(np.mean((denoised.values - true) ** 2))
        told.append(np.mean(np.sum(record.thrust_doubt**2, axis=0)) + record.thrust_noise.sigma**2)
        assert (record.thrust_noise.sigma > 0.0) == state
    # Three standard errors of a mean of RUNS chi-squared values, of as many degrees of freedom as there are unknowns.
    unknowns = float(np.mean(told)) * N / SIGMA**2
    assert np.mean(left) == pytest.approx(np.mean(told), rel=3.0 * np.sqrt(2.0 / (RUNS * unknowns)))


def test_the_level_is_as_sure_as_its_mean() -> None:
    """A mean of N readings: of the state it is the sum of its covariances, 2 sigma^2 memory / time."""
    true = 3.0 + 0.75 * SIGNS @ SWINGS
    noise = SIGMA * np.random.default_rng(4).standard_normal(N)
    record = counted(denoised_thrust(true + noise, np.full(N, 0.5), DT))
    decay = np.exp(-DT / record.thrust_noise.memory_s)
    steps = np.abs(np.subtract.outer(np.arange(N), np.arange(N)))
    of_the_state = record.thrust_noise.sigma**2 * float(np.mean(decay**steps))
    of_unknowns = float(np.sum(record.thrust_doubt.mean(axis=1) ** 2))
    assert of_the_state + of_unknowns == pytest.approx(SIGMA**2 / N, rel=0.1)
