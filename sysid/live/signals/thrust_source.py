"""Thrust and the propeller's torque while flying: measured, else by the propeller's speed or the throttle."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.physics.layout import Par
from sim_vehicle.physics.propeller import along
from sim_vehicle.vehicle.packed_model import flatten_vehicle
from sim_vehicle.vehicle.propulsion import rotor_scale
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.live.signals.row_alignment import Rows


class LiveThrust:
    """Adds the columns `thrust`, N, and `torque`, N m, to rows.

    By the laws of the vehicle file's [propulsion] (sim_vehicle.vehicle.propulsion); without one thrust counts as 0,
    which only forces along the body would feel, and these are then not estimated. Torque rolls the aircraft with every
    change of the throttle: without it a step of that looks like a broken wing.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._propulsion = vehicle.propulsion
        self._constants = flatten_vehicle(vehicle)
        self._true_airspeed = vehicle.sensors.airspeed.kind == "true"
        self._signal: str | None = None
        # What shows how fast the propeller turns, and the share of its full speed at the last row.
        self._turning: str | None = None
        self._share = math.nan

    def source(self, there: Collection[str]) -> str | None:
        """The signal that gives thrust among those that are there."""
        propulsion = self._propulsion
        by_speed = ("rpm",) if propulsion is not None and propulsion.by_rpm else ()
        by_throttle = ("throttle",) if propulsion is not None and propulsion.by_throttle else ()
        choices = ("thrust", *by_speed, *by_throttle)
        self._signal = next((name for name in choices if name in there), None)
        twists = propulsion is not None and bool(propulsion.CQ)
        turns = ("rpm", *(("throttle",) if propulsion is not None and propulsion.max_rpm else ()))
        self._turning = next((name for name in turns if name in there), None) if twists else None
        return self._signal

    @property
    def signals(self) -> list[str]:
        """All that rows must hold for it."""
        return [name for name in dict.fromkeys((self._signal, self._turning)) if name is not None]

    @property
    def moving_mass(self) -> float:
        """kg on the thrust sensor, 0 where thrust is not measured."""
        return self._propulsion.moving_mass if self._propulsion is not None and self._signal == "thrust" else 0.0

    def added(self, rows: Rows) -> Rows:
        """The rows with their thrust and torque."""
        columns, still = rows.columns, np.zeros(rows.time_s.size)
        thrust, torque = still, still
        shows = self._turning or (self._signal if self._signal != "thrust" else None)
        if shows is not None:
            thrust, torque = self._of_propeller(self._turned(rows, shows), columns)
        if self._signal == "thrust":
            # The motor hangs on the cell: add what accelerates it, so that thrust is the propeller's.
            thrust = columns["thrust"] + self.moving_mass * columns["ax"]
        elif self._signal == "rpm" and self._propulsion is not None and not self._propulsion.CT:
            full = self._propulsion.max_rpm or 1.0
            thrust = (self._propulsion.max_thrust or 0.0) * (columns["rpm"] / full) ** 2
        return replace(rows, columns={**columns, "thrust": thrust, "torque": torque})

    def _of_propeller(self, share: Array, columns: dict[str, Array]) -> tuple[Array, Array]:
        """Thrust and torque at shares of the propeller's full speed."""
        density, speed = columns["air_density"], columns["airspeed"]
        if not self._true_airspeed:
            speed = speed * np.sqrt(SEA_LEVEL_DENSITY / density)
        speed, density = (np.ascontiguousarray(one, dtype=np.float64) for one in (speed, density))
        return along(np.ascontiguousarray(share), speed, density, self._constants)

    def _turned(self, rows: Rows, signal: str) -> Array:
        """Share of its full speed at which the propeller turns, behind the motor's lag where the throttle shows it."""
        assert self._propulsion is not None
        values = rows.columns[signal]
        if signal == "rpm":
            return np.asarray(values * (math.pi / 30.0) / max(rotor_scale(self._propulsion), 1e-9))
        tau = float(self._constants[Par.motor_tau])
        if tau <= 0.0:
            return values
        before = self._share if rows.continues and math.isfinite(self._share) else float(values[0])
        moved = np.empty(values.size)
        step = -math.expm1(-rows.interval_s / tau)
        for place, value in enumerate(values):
            before += step * (float(value) - before)
            moved[place] = before
        self._share = before
        return moved
