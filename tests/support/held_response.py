"""Exact motion under commands that are held between samples, in closed form."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sysid.equation_error.coefficients import Body
from sysid.signals.flight import FlightData

Array = NDArray[np.float64]

BODY = Body(1.0, 0.02, 0.03, 0.045, 0.0, 0.2, 1.0, 0.2)
STEP_S, SPEED, DENSITY = 0.02, 15.0, 1.225


def multisine(rng: np.random.Generator, count: int, lowest: float, highest: float, amplitude: float) -> Array:
    time = STEP_S * np.arange(count)
    lines = np.arange(lowest, highest, 0.1)
    return amplitude * np.sum(
        [
            np.sin(2.0 * np.pi * f * time + phase)
            for f, phase in zip(lines, rng.uniform(0, 6.28, lines.size), strict=True)
        ],
        axis=0,
    )


def rolling(damping: float, control: float, seed: int = 0, count: int = 1000) -> FlightData:
    """Roll about the body axis alone under a held aileron: p[k + 1] = e p[k] + (1 - e) (control / -damping) da 2V/b."""
    command = multisine(np.random.default_rng(seed), count, 0.2, 2.5, 0.01)
    moment = 0.5 * DENSITY * SPEED**2 * BODY.S * BODY.b
    rate = -moment * damping * BODY.b / (2.0 * SPEED) / BODY.Ixx
    decay = np.exp(-rate * STEP_S)
    p = np.zeros(count)
    for k in range(count - 1):
        p[k + 1] = decay * p[k] + (1.0 - decay) / rate * moment * control / BODY.Ixx * command[k]
    zero = np.zeros(count)
    columns = {"ax": zero, "ay": zero, "az": np.full(count, -9.8), "p": p, "q": zero, "r": zero, "alpha": zero}
    columns |= {"V": np.full(count, SPEED), "thrust": zero, "da": command}
    return FlightData("roll", STEP_S, STEP_S * np.arange(count), columns, (), {"reference": "centre of gravity"})
