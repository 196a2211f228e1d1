"""What moves the surfaces in a test flight: multisines, doublets and 3-2-1-1 by hand, set-point changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from field_plant import STEP, SURFACES, Inputs
from jsbsim_flight import multisine
from jsbsim_twin import Array
from scipy import signal

DOUBLET, THREE_TWO_ONE_ONE = (1, -1), (3, -2, 1, -1)
SIZE = {"de": 0.06, "da": 0.06, "dr": 0.06}  # rad
STICK = 0.03  # s: a hand is no switch


def inputs_of(
    kind: str,
    seconds: float,
    generator: np.random.Generator,
    surfaces: Sequence[str] = SURFACES,
    size: float = 1.0,
    throttle: float = 0.2,
) -> Inputs:
    """Inputs of a kind: multisine, doublet, 3211, hold. throttle: largest share of trim that it slowly moves by."""
    times = np.arange(round(seconds / STEP) + 1) * STEP
    zero = np.zeros(times.size)
    moves: dict[str, Array] = dict.fromkeys(SURFACES, zero)
    bank = pitch = zero
    if kind == "multisine":
        for place, name in enumerate(surfaces):
            moves[name] = multisine(times, size * SIZE[name] * generator.uniform(0.9, 1.3), place, generator)
    elif kind in ("doublet", "3211"):
        moves |= by_hand(times, DOUBLET if kind == "doublet" else THREE_TWO_ONE_ONE, generator, surfaces, size)
    elif kind == "hold":
        bank, pitch = (set_points(times, largest * size, generator) for largest in (0.25, 0.07))
    else:
        raise ValueError(kind)
    slow = np.sin(2.0 * np.pi * times / 13.0 + generator.uniform(0.0, 2.0 * np.pi)) * np.clip(times, 0.0, 1.0)
    return Inputs(moves, throttle * slow, bank, pitch)


def by_hand(
    times: Array, pattern: Sequence[int], generator: np.random.Generator, surfaces: Sequence[str], size: float
) -> dict[str, Array]:
    """One surface after another, with pauses and sizes as a hand makes them."""
    found = {name: np.zeros(times.size) for name in surfaces}
    at, place = 1.0, 0
    # A short flight is flown in haste.
    pause = (0.6, 1.2) if times[-1] < 15.0 else (1.5, 3.0)
    while at < times[-1] - 1.0:
        name = surfaces[place % len(surfaces)]
        sign, unit = generator.choice([-1.0, 1.0]), generator.uniform(0.25, 0.45)
        for length in pattern:
            height = np.sign(length) * sign * size * SIZE[name] * generator.uniform(0.8, 1.2)
            duration = abs(length) * unit * generator.uniform(0.9, 1.1)
            found[name][(times >= at) & (times < at + duration)] = height
            at += duration
        at += generator.uniform(*pause)
        place += 1
    left = float(np.exp(-STEP / STICK))
    return {name: np.asarray(signal.lfilter([1.0 - left], [1.0, -left], x)) for name, x in found.items()}


def set_points(times: Array, largest: float, generator: np.random.Generator) -> Array:
    """Attitudes, rad, that are asked for, changed every few seconds and softened over half a second."""
    asked, at = np.zeros(times.size), 2.0
    while at < times[-1]:
        asked[times >= at] = generator.uniform(-largest, largest)
        at += generator.uniform(4.0, 9.0)
    left = float(np.exp(-STEP / 0.25))
    return np.asarray(signal.lfilter([1.0 - left], [1.0, -left], asked))
