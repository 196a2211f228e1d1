"""The servo outputs: whole microseconds, so that what the estimator reads is what the actuators got."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.manoeuvres.shapes import CONTROLS
from sim_vehicle.vehicle.controls import mixing_matrix
from sim_vehicle.vehicle.vehicle_file import Vehicle

Array = NDArray[np.float64]
_OPEN = {"throttle": (0.0, 1.0)}


class ServoOutputs:
    """Turns commands of the four controls, and of those of other names behind them, into pulse widths of the vehicle's
    servos, and back.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        # One without servos, whose deflection the log holds itself, is flown as it is asked for.
        self._controls = {name: control for name, control in vehicle.controls.items() if control.servos}
        self._all = vehicle.controls
        self._servos, self._mixing = mixing_matrix(self._controls)
        curves = {
            servo: (np.array(xs), np.array(ys))
            for control in self._controls.values()
            for servo, xs, ys in zip(control.servos, control.pwm, control.deflection, strict=True)
        }
        rising = {servo: np.argsort(ys) for servo, (_, ys) in curves.items()}
        self._curves = {servo: (xs[rising[servo]], ys[rising[servo]]) for servo, (xs, ys) in curves.items()}
        self._deflections: dict[tuple[int, tuple[int, ...]], float] = {}
        self._named = vehicle.named_controls
        order = (*CONTROLS, *self._named)
        self._columns = [order.index(name) for name in self._controls]
        self._measured = frozenset(
            servo for control in vehicle.controls.values() if control.signal == "position" for servo in control.servos
        )

    @property
    def by_control(self) -> dict[str, tuple[int, ...]]:
        """Numbers of the servos of each control."""
        return {name: tuple(control.servos) for name, control in self._controls.items()}

    @property
    def limits(self) -> Array:
        """Smallest and largest command of each control, (4 + named, 2); one that the vehicle lacks stays at 0."""
        names = (*CONTROLS, *self._named)
        return np.array([self._all[one].limits if one in self._all else _OPEN.get(one, (0.0, 0.0)) for one in names])

    def pulses(self, command: Array) -> dict[int, int]:
        """Pulse width of every servo, whole us, for a command (4 + named,)."""
        travel = self._mixing @ command[self._columns]
        return {
            servo: round(float(np.interp(value, self._curves[servo][1], self._curves[servo][0])))
            for servo, value in zip(self._servos, travel.tolist(), strict=True)
        }

    def command(self, pulses: dict[int, int], asked: Array) -> Array:
        """Command (4 + named,) that these pulses stand for; a control without servos keeps what was `asked`."""
        out = asked.copy()
        for column, control in zip(self._columns, self._controls.values(), strict=True):
            asked_of = tuple(pulses[servo] for servo in control.servos)
            known = self._deflections.get((column, asked_of))
            if known is None:
                # Whole microseconds come again and again.
                known = self._deflections[column, asked_of] = float(control.deflection_from_pwm(*asked_of))
            out[column] = known
        return out

    def reported(self, pulses: dict[int, int], surfaces: Array) -> dict[int, int]:
        """What SERVO_OUTPUT_RAW carries: the pulses sent, or the measured position where the vehicle file says so."""
        if not self._measured:
            return pulses
        position = self.pulses(surfaces)
        return {servo: position[servo] if servo in self._measured else us for servo, us in pulses.items()}
