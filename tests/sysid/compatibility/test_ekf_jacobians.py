"""Gradients in closed form against difference quotients of what they are gradients of."""

import numpy as np
import pytest

from sysid.compatibility.ekf import predict_readings
from sysid.compatibility.ekf_jacobians import linearise_part
from sysid.compatibility.kinematics import midpoints, step

RNG = np.random.default_rng(3)
N, DT, GRAVITY = 40, 0.02, 9.81
LEVEL = np.array([15.0, 0.5, 1.0, 0.1, 0.05, 2.0])
THETA = RNG.normal(0.0, 0.05, 18)


def layout(flank: bool) -> np.ndarray:
    """Sensors away from the centre of gravity, a pitot that reads calibrated airspeed."""
    return np.array([1.1, 0.2, 0.1, 0.15, 0.05, float(flank), GRAVITY])


def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States, gusts and readings of the IMU, none of them small."""
    states = LEVEL + RNG.normal(0.0, 1.0, (N, 6)) * [2.0, 2.0, 2.0, 0.5, 0.4, 2.0]
    imu = RNG.normal(0.0, 1.0, (N, 6)) * [5.0, 5.0, 5.0, 2.0, 2.0, 2.0]
    return states, RNG.normal(0.0, 2.0, (N, 3)), imu


@pytest.mark.parametrize("flank", [False, True])
def test_readings(flank: bool) -> None:
    states, gusts, imu = motion()
    predicted, slopes, _, _ = linearise_part(states, gusts, THETA, imu, DT, layout(flank))

    def read(states: np.ndarray, gusts: np.ndarray) -> np.ndarray:
        return predict_readings(states, gusts, imu, THETA, layout(flank))

    assert np.array_equal(predicted, read(states, gusts))
    for a in range(9):
        push = np.zeros(9)
        push[a] = h = 1e-5
        ahead, back = (read(states + sign * push[:6], gusts + sign * push[6:]) for sign in (1.0, -1.0))
        assert slopes[:, :, a] == pytest.approx((ahead - back) / (2.0 * h), abs=1e-7)


def test_step() -> None:
    states, gusts, imu = motion()
    _, _, ahead, steps = linearise_part(states, gusts, THETA, imu, DT, layout(False))
    middle, work = midpoints(imu), np.empty((6, 6))

    def flown(k: int, push: np.ndarray) -> np.ndarray:
        after = np.empty(6)
        step(states[k] + push[:6], imu[k], middle[k], imu[k + 1], THETA[:6] + push[6:], DT, GRAVITY, work, after)
        return after

    for k in range(N - 1):
        assert ahead[k] == pytest.approx(flown(k, np.zeros(12)), rel=1e-14)
        for a in range(12):
            push = np.zeros(12)
            push[a] = h = 1e-5
            assert steps[k, :, a] == pytest.approx((flown(k, push) - flown(k, -push)) / (2.0 * h), abs=1e-8)
    assert not ahead[-1].any()
    assert not steps[-1].any()
