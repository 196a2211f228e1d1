"""An aircraft of the simulator under ArduPilot's roll loop, flown step by step: whether a kick dies out or grows."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.trim import solve_trim
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle

STEP_S, FRAME = 0.0025, 8
STILL = np.zeros(3)


class RollLoop:
    """The loop at 50 Hz by its discrete equations. board: ArduPilot's parameters. delay, lag: of the servo, s."""

    def __init__(
        self, vehicle: Vehicle, model: Model, board: Mapping[str, float], speed: float, delay: float, lag: float
    ) -> None:
        air = replace(vehicle.environment, air_density=SEA_LEVEL_DENSITY)
        self.plant = Plant(replace(vehicle, environment=air), model)
        self.trim = solve_trim(self.plant, speed, 0.0)
        self.board, self.scaler, self.delay, self.lag = board, board["SCALING_SPEED"] / speed, delay, lag
        ends = vehicle.controls["aileron"].deflection[0]
        self.travel = math.copysign((ends[-1] - ends[0]) / 2.0, model.values()["Cl_da"])

    def grows(self, factor: float, seconds: float = 6.0) -> bool:
        """Whether a small kick grows with so many times the proportional gain."""
        board, scaler = self.board, self.scaler
        x, aileron, demand = self.trim.state.x.copy(), 0.0, 0.0
        x[10] = 0.002
        commands = deque([0.0] * max(round(self.delay / STEP_S), 1))
        integral = derivative = filtered = before = gyro = gyro_rate = 0.0
        w, dt = 2.0 * math.pi * board["INS_GYRO_FILTER"], FRAME * STEP_S
        shares = [1.0 - math.exp(-2.0 * math.pi * hz * dt) for hz in (3.0, 12.0)]
        rates = []
        for k in range(round(seconds / STEP_S)):
            if k % FRAME == 0:
                q0, q1, q2, q3 = x[6:10]
                phi = math.atan2(2.0 * (q0 * q1 + q2 * q3), 1.0 - 2.0 * (q1 * q1 + q2 * q2))
                filtered += shares[0] * (-phi / board["RLL2SRV_TCONST"] - filtered)
                error = (filtered - gyro) * scaler**2
                integral += board["RLL_RATE_I"] * error * dt
                derivative, before = derivative + shares[1] * ((error - before) / dt - derivative), error
                out = board["RLL_RATE_P"] * factor * error + integral + board["RLL_RATE_D"] * derivative
                out += board["RLL_RATE_FF"] * filtered * scaler
                demand = math.degrees(out) / 45.0 * self.travel
            commands.append(demand)
            aileron += STEP_S / self.lag * (commands.popleft() - aileron)
            change = np.array([0.0, aileron, 0.0, 0.0])
            command, surfaces = self.trim.command + change, self.trim.state.surfaces + change
            slope = self.plant.rates(self.plant.state_at(x, command, surfaces), STILL, STILL)
            middle = self.plant.state_at(x + 0.5 * STEP_S * slope, command, surfaces)
            x = x + STEP_S * self.plant.rates(middle, STILL, STILL)
            gyro_rate += STEP_S * (w**2 * (x[10] - gyro) - math.sqrt(2.0) * w * gyro_rate)
            gyro += STEP_S * gyro_rate
            rates.append(x[10])
            if abs(x[10]) > 1.0:
                return True
        late, early = np.array(rates[-800:]), np.array(rates[400:1200])
        return bool(np.std(late - np.mean(late)) > np.std(early - np.mean(early)))

    def limit(self, low: float = 1.0, high: float = 30.0) -> float:
        """The factor from which on it grows, by halving to 1 %; infinite where it does at none."""
        if not self.grows(high):
            return math.inf
        while high / low > 1.01:
            middle = math.sqrt(low * high)
            low, high = (low, middle) if self.grows(middle) else (middle, high)
        return math.sqrt(low * high)
