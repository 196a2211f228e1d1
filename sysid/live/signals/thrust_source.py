"""Thrust while flying: measured, else by the propeller's speed or the throttle and [propulsion]."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from sim_vehicle.vehicle.propulsion import Propulsion
from sysid.live.signals.row_alignment import Rows


class LiveThrust:
    """Adds the column `thrust`, N, to rows. propulsion: of the vehicle file, None for none.

    By max_thrust (rpm / max_rpm)^2, or in proportion to the throttle; without either thrust counts as 0, which only
    forces along the body would feel, and these are then not estimated.
    """

    def __init__(self, propulsion: Propulsion | None) -> None:
        self._propulsion = propulsion
        self._signal: str | None = None

    def source(self, there: Collection[str]) -> str | None:
        """The signal that gives thrust among those that are there."""
        known = self._propulsion is not None and self._propulsion.max_thrust is not None
        by_speed = known and self._propulsion is not None and bool(self._propulsion.max_rpm)
        choices = ("thrust", *(("rpm",) if by_speed else ()), *(("throttle",) if known else ()))
        self._signal = next((name for name in choices if name in there), None)
        return self._signal

    @property
    def moving_mass(self) -> float:
        """kg on the thrust sensor, 0 where thrust is not measured."""
        return self._propulsion.moving_mass if self._propulsion is not None and self._signal == "thrust" else 0.0

    def added(self, rows: Rows) -> Rows:
        """The rows with their thrust."""
        if self._signal == "thrust":
            if not self.moving_mass:
                return rows
            # The motor hangs on the cell: add what accelerates it, so that thrust is the propeller's.
            pull = rows.columns["thrust"] + self.moving_mass * rows.columns["ax"]
            return replace(rows, columns={**rows.columns, "thrust": pull})
        values = np.zeros(rows.time_s.size)
        if self._signal is not None and self._propulsion is not None and self._propulsion.max_thrust is not None:
            share = rows.columns[self._signal]
            if self._signal == "rpm":
                share = (share / (self._propulsion.max_rpm or 1.0)) ** 2
            values = self._propulsion.max_thrust * share
        return replace(rows, columns={**rows.columns, "thrust": values})
