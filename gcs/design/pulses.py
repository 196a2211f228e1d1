"""A plan as pulse widths of the vehicle's servos: a CSV schedule for any board that can play one."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.flight.plant import Plant
from sim_vehicle.manoeuvres.plan import Plan
from sim_vehicle.manoeuvres.plan_ticks import Schedule
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.servo_mixing import ServoOutputs
from sim_vehicle.vehicle.vehicle_file import Vehicle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PulseSchedule:
    """What the servos get if nothing but the plan moves them.

    time_s: (N,) s from the plan's begin. pulses: servo -> (N,) whole us. trim: servo -> us, in steady flight of the
    prior model. freed: (N, 2) whether (elevator and throttle, aileron and rudder) are the plan's and not the
    autopilot's. schedule: the plan on the same ticks.
    """

    time_s: Array
    pulses: dict[int, NDArray[np.int64]]
    trim: dict[int, int]
    freed: NDArray[np.bool_]
    schedule: Schedule

    def write_csv(self, path: Path) -> None:
        """Columns time_s and servoN_us, one row for each tick."""
        with path.open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["time_s", *(f"servo{servo}_us" for servo in self.pulses)])
            columns = np.stack(list(self.pulses.values()), axis=1)
            rows.writerows([f"{t:.4f}", *row] for t, row in zip(self.time_s, columns.tolist(), strict=True))


def pulse_schedule(vehicle: Vehicle, model: Model, plan: Plan, rate_hz: float) -> PulseSchedule:
    """The plan added to the trim of the prior model, through linkage curves and mixes, held within their ends.

    Raises SimVehicleError where the model has no trim at the vehicle file's airspeed.
    """
    schedule = Schedule(plan, 1.0 / rate_hz, vehicle.named_controls)
    outputs = ServoOutputs(vehicle)
    limits = outputs.limits
    command = Plant(vehicle, model).trim().command
    command = np.append(command, np.zeros(len(vehicle.named_controls)))
    rows = [outputs.pulses(np.clip(command + added, limits[:, 0], limits[:, 1])) for added in schedule.increments]
    servos = sorted(rows[0])
    return PulseSchedule(
        np.arange(schedule.ticks) / rate_hz,
        {servo: np.array([row[servo] for row in rows], dtype=np.int64) for servo in servos},
        outputs.pulses(command),
        schedule.freed,
        schedule,
    )
