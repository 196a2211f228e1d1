"""Sensors that fail while all others go on: motion worked out backwards, so that every reading is exact."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from sysid.arrays import Array
from sysid.live.signals.sensor_failures import SensorFailure, SensorMonitor

G = 9.80665
DT = 0.02
FAILS_S = 20.0
TIME_S: Array = np.arange(0.0, 30.0, DT)
Columns = dict[str, Array]


def motion(gusts: float = 0.0, swing: float = 1.0) -> Columns:
    """What perfect sensors read of a flight that rolls, pitches and turns, by differences of its angles and speeds.

    swing: of the airspeed, m/s.
    """
    t = TIME_S
    generator = np.random.default_rng(3)
    phi, theta = 0.3 * np.sin(1.1 * t) + 0.1 * np.sin(3.0 * t), 0.08 + 0.06 * np.sin(1.7 * t)
    psi = 0.3 * t + 0.05 * np.sin(0.9 * t)
    V, alpha, beta = 15.0 + swing * np.sin(0.7 * t), 0.06 + 0.03 * np.sin(2.3 * t), 0.02 * np.sin(1.9 * t)
    u, v, w = V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha) * np.cos(beta)
    rate = {name: np.gradient(one, DT) for name, one in (("phi", phi), ("theta", theta), ("psi", psi),
                                                         ("u", u), ("v", v), ("w", w))}  # fmt: skip
    p = rate["phi"] - rate["psi"] * np.sin(theta)
    q = rate["theta"] * np.cos(phi) + rate["psi"] * np.cos(theta) * np.sin(phi)
    r = rate["psi"] * np.cos(theta) * np.cos(phi) - rate["theta"] * np.sin(phi)
    ax = rate["u"] + q * w - r * v + G * np.sin(theta)
    ay = rate["v"] + r * u - p * w - G * np.cos(theta) * np.sin(phi)
    az = rate["w"] + p * v - q * u - G * np.cos(theta) * np.cos(phi)
    cp, sp, ct, st, cs, ss = (f(one) for one in (phi, theta, psi) for f in (np.cos, np.sin))
    ground = {
        "vn": ct * cs * u + (sp * st * cs - cp * ss) * v + (cp * st * cs + sp * ss) * w + 2.0,
        "ve": ct * ss * u + (sp * st * ss + cp * cs) * v + (cp * st * ss - sp * cs) * w - 1.0,
        "vd": -st * u + sp * ct * v + cp * ct * w,
    }  # fmt: skip
    blown = gusts * np.array([_gust(generator) for _ in range(3)])
    seldom = np.arange(t.size) % 10 == 0
    return {
        "phi": phi, "theta": theta, "psi": psi, "p": p, "q": q, "r": r, "ax": ax, "ay": ay, "az": az,
        "V": V + blown[0] + 0.05 * generator.standard_normal(t.size),
        **{name: one + gust / V + 5e-3 * generator.standard_normal(t.size)
           for name, one, gust in (("alpha", alpha, blown[1]), ("beta", beta, blown[2]))},
        **{n: np.where(seldom, one + 0.1 * generator.standard_normal(t.size), np.nan) for n, one in ground.items()},
    }  # fmt: skip


def _gust(generator: np.random.Generator) -> Array:
    """Gusts of 1 m/s that fade in 1.5 s."""
    values = np.zeros(TIME_S.size)
    keep = np.exp(-DT / 1.5)
    noise = generator.standard_normal(TIME_S.size) * np.sqrt(1.0 - keep**2)
    for k in range(1, values.size):
        values[k] = keep * values[k - 1] + noise[k]
    return values


def told(columns: Columns) -> tuple[SensorFailure, float] | None:
    """The first failure told, and when."""
    monitor = SensorMonitor(G)
    for begin in range(0, TIME_S.size, 20):
        here = slice(begin, begin + 20)
        monitor.take(TIME_S[here], {name: one[here] for name, one in columns.items()}, DT)
        if (failure := monitor.check()) is not None:
            return failure, float(TIME_S[here][-1])
    return None


LATER = TIME_S >= FAILS_S
AGE_S = np.where(LATER, TIME_S - FAILS_S, 0.0)


def held(values: Array) -> Array:
    return np.where(LATER, values[np.argmax(LATER)], values)


CASES: dict[str, tuple[str, Callable[[Array], Array], str, float]] = {
    "a gyro": ("q", lambda one: one + np.radians(2.0) * LATER, "q_step", 2.0),
    "another gyro": ("p", lambda one: one - np.radians(3.0) * LATER, "p_step", -3.0),
    "an accelerometer along": ("ax", lambda one: one + 0.8 * LATER, "ax_step", 0.8),
    "an accelerometer across": ("az", lambda one: one + 0.8 * LATER, "az_step", 0.8),
    "a bent vane": ("alpha", lambda one: one + np.radians(6.0) * LATER, "alpha_step", 6.0),
    "a vane that is stuck": ("alpha", lambda one: held(one) + 5e-4 * np.sin(50.0 * TIME_S), "alpha_still", 1.0),
    "a tube that leaks": ("V", lambda one: one * np.where(LATER, 0.7, 1.0), "airspeed_step", -4.5),
    "a tube that is blocked": ("V", held, "airspeed_still", 1.0),
    "an airspeed that drifts": ("V", lambda one: one + 1.0 * AGE_S, "airspeed_drift", 1.0),
    "a compass": ("psi", lambda one: one + np.radians(20.0) * LATER, "psi_step", 20.0),
}


@pytest.mark.parametrize("case", CASES)
def test_a_sensor_that_fails_is_told_by_its_name_and_size(case: str) -> None:
    name, change, expected, size = CASES[case]
    columns = motion(swing=3.0 if expected == "airspeed_still" else 1.0)
    columns[name] = change(columns[name])
    found = told(columns)
    assert found is not None
    failure, at = found
    assert failure.name == expected
    assert failure.size == pytest.approx(size, rel=0.25)
    assert abs(failure.time_s - FAILS_S) < 1.5
    assert at - FAILS_S < 6.0


@pytest.mark.parametrize("gusts", [0.0, 0.3, 0.8])
def test_gusts_and_manoeuvres_are_no_failure(gusts: float) -> None:
    assert told(motion(gusts)) is None


def test_what_has_failed_once_is_told_once() -> None:
    columns = motion()
    columns["q"] = columns["q"] + np.radians(3.0) * LATER
    monitor, found = SensorMonitor(G), []
    for begin in range(0, TIME_S.size, 20):
        here = slice(begin, begin + 20)
        monitor.take(TIME_S[here], {name: one[here] for name, one in columns.items()}, DT)
        found += [one.name for one in (monitor.check(),) if one is not None]
    assert found == ["q_step"]
