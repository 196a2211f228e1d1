"""Moments of inertia from swings, against pendulums whose equations of motion are integrated."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gcs.errors import VehicleError
from gcs.vehicles.inertia import Measured, by_bifilar, by_swing, period, ruler, scale

G = 9.80665
MASS, INERTIA = 1.3, 0.041


def period_of(acceleration, amplitude: float) -> float:
    """Period of an oscillation that starts at rest at `amplitude`, from four quarter swings."""

    def crosses(t: float, state: np.ndarray) -> float:
        return float(state[0])

    crosses.terminal = True  # type: ignore[attr-defined]
    start = [amplitude, 0.0]
    found = solve_ivp(
        lambda t, s: [s[1], acceleration(s[0], s[1])], (0.0, 60.0), start, events=crosses, rtol=1e-10, atol=1e-12
    )
    return 4.0 * float(found.t_events[0][0])


def bifilar_period(length: float, spacing: float, amplitude: float) -> float:
    """Exact motion of a body on two wires: its height follows from the turn; energy gives the equation."""
    r = spacing / 2.0

    def height(angle: float) -> float:
        return length - math.sqrt(length**2 - 2.0 * r * r * (1.0 - math.cos(angle)))

    def slope(angle: float) -> float:
        return r * r * math.sin(angle) / (length - height(angle))

    def bend(angle: float) -> float:
        step = 1e-5
        return (slope(angle + step) - slope(angle - step)) / (2.0 * step)

    def acceleration(angle: float, rate: float) -> float:
        h = slope(angle)
        return -(MASS * G * h + MASS * h * bend(angle) * rate**2) / (INERTIA + MASS * h * h)

    return period_of(acceleration, amplitude)


def test_two_wires_give_the_moment_of_inertia_of_a_body_whose_exact_motion_is_integrated() -> None:
    swing = Measured(bifilar_period(1.2, 0.5, math.radians(2.0)), 1e-6)
    found = by_bifilar(Measured(MASS, 1e-6), Measured(1.2, 1e-6), Measured(0.5, 1e-6), swing)
    assert found.value == pytest.approx(INERTIA, rel=1e-3)


def test_a_swing_about_an_axis_gives_it_too() -> None:
    arm = 0.15
    turned = period_of(
        lambda angle, rate: -MASS * G * arm * math.sin(angle) / (INERTIA + MASS * arm * arm), math.radians(3.0)
    )
    found = by_swing(Measured(MASS, 1e-6), Measured(arm, 1e-6), Measured(turned, 1e-6))
    assert found.value == pytest.approx(INERTIA, rel=2e-3)


@pytest.mark.parametrize("way", ["bifilar", "swing"])
def test_its_error_is_what_repeated_measurements_scatter_by(way: str) -> None:
    generator = np.random.default_rng(3)
    mass, mass_std, length_std, spacing_std = MASS, 0.01, 0.004, 0.003
    length, spacing = (1.2, 0.5) if way == "bifilar" else (0.15, 0.0)
    whole = INERTIA if way == "bifilar" else INERTIA + MASS * length**2
    square = MASS * G * spacing**2 / (16 * math.pi**2 * length) if way == "bifilar" else MASS * G * length / 39.4784
    true = math.sqrt(whole / square)
    values, stds = [], []
    for _ in range(2000):
        times = [float(t) for t in 10 * true + 0.1 * generator.standard_normal(4)]
        m = Measured(mass + mass_std * generator.standard_normal(), mass_std)
        long = Measured(length + length_std * generator.standard_normal(), length_std)
        swing = period(times, 10)
        if way == "bifilar":
            apart = Measured(spacing + spacing_std * generator.standard_normal(), spacing_std)
            found = by_bifilar(m, long, apart, swing)
        else:
            found = by_swing(m, long, swing)
        values.append(found.value)
        stds.append(found.std)
    # The stated error is at least the true one, and not far above it: four times timed scatter by chance.
    assert 0.95 < np.mean(stds) / np.std(values) < 1.4


def test_times_that_cannot_be_of_one_pendulum_are_refused() -> None:
    with pytest.raises(VehicleError, match=r"differ too much: swings miscounted"):
        period([14.2, 14.3, 28.4], 10)
    with pytest.raises(VehicleError, match="must be positive"):
        period([], 10)


def test_an_arm_that_is_too_long_says_so_instead_of_a_number() -> None:
    long_arm = 2.0
    swing = Measured(2 * math.pi * math.sqrt((INERTIA + MASS * long_arm**2) / (MASS * G * long_arm)), 0.01)
    with pytest.raises(VehicleError, match="closer to its centre of gravity"):
        by_swing(scale(MASS), ruler(long_arm), swing)
