"""The moving parts of a vehicle in flight, and a steady flight."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.physics.layout import CHANNELS, SENSOR_SIZE, Aux

Array = NDArray[np.float64]


@dataclass
class PlantState:
    """Everything that moves: rigid body, actuators, sensor lags, the commands still under way.

    x: (14,) rigid-body state (sim_vehicle.physics.layout). actuators: (10,). sensor: (12,). commands: (64, 4) or,
    with controls of other names, (64, 9 + named) last commands, the newest last. surfaces: (4 + named,) de, da, dr
    [rad], throttle and these as they are now. work: by-products at x.
    reading: (19,). past: (64, 19) last readings of delayed sensors, the part of a tick before each tick, the
    newest last; (0, 19) where none does. past_sensor: (12,) their memory. motors: (M,) throttle of each of several
    behind its lag, (0,) before the first step; thrust: N, of all of them, NaN of one that follows the throttle.
    """

    x: Array
    actuators: Array
    sensor: Array
    commands: Array
    surfaces: Array
    work: Array
    reading: Array
    past: Array = field(default_factory=lambda: np.zeros((0, len(CHANNELS))))
    past_sensor: Array = field(default_factory=lambda: np.zeros(SENSOR_SIZE))
    motors: Array = field(default_factory=lambda: np.zeros(0))
    thrust: float = math.nan

    @property
    def time_s(self) -> float:
        """Time, s from the flight's first stamp."""
        return float(self.work[Aux.time])

    @time_s.setter
    def time_s(self, time_s: float) -> None:
        self.work[Aux.time] = time_s

    def copy(self) -> PlantState:
        """An independent copy."""
        return copy.deepcopy(self)


@dataclass(frozen=True)
class Trim:
    """A steady flight: its state and the command (de, da, dr [rad], throttle) that holds it.

    residual: largest rate of velocity and body rate left, m/s2 and rad/s2.
    """

    state: PlantState
    command: Array
    residual: float
