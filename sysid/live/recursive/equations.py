"""Both sides of the force and moment equations, sample by sample.

Definitions are those of `sysid.equation_error.coefficients` and pairing that of `sysid.equation_error.equations`; what
differs is that nothing may look into the future. Forces hold at each sample, under the command before it.
Moments hold over each interval between two samples, exactly: the difference of angular momentum is the integral of the
moment, a held command is itself, and the mean of what is smooth follows from the four samples around. Since each
interval's equation holds by itself, any sum of them does, and a finite Fourier transform needs no end terms: summed by
parts, the transform of the differences is (exp(j w T) - 1) / T times that of the momentum, plus the end terms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.model.aerodynamic_terms import MOTION, Term
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.equation_error.coefficients import Body, body_of, coefficients, dynamic_pressure
from sysid.equation_error.equations import CONTROLS, FORCES, MOMENTS
from sysid.live.recursive.regressors import TAIL, Regressors, means
from sysid.live.signals.row_alignment import Rows
from sysid.signals.flight import FlightData

_RATES = ("p", "q", "r")
# Sensor errors that go into the left side of the forces: those of the accelerometer, and the vane's that turns them.
BIASES = {
    "CL": ("accel_bias_x", "accel_bias_z", "alpha_bias", "alpha_scale"),
    "CD": ("accel_bias_x", "accel_bias_z", "alpha_bias", "alpha_scale"),
    "CY": ("accel_bias_y",),
}


@dataclass(frozen=True)
class Sides:
    """Both sides of K equations of every axis.

    time_s: (K,). table: (K, W), at the `places` of each axis its terms, what unit sensor errors add (`BIASES`), the
    weight, and the left side.
    """

    time_s: Array
    table: Array
    places: Mapping[str, slice]


class LiveEquations:
    """Columns of every axis as rows come. Terms are those of the model, by axis.

    moving_mass: kg on the thrust sensor, whose pull the accelerometer's error changes as well.
    weight: dynamic pressure over that of the first rows, which all columns carry, as after the flight.
    """

    def __init__(self, vehicle: Vehicle, terms: Mapping[str, Sequence[Term]], moving_mass: float = 0.0) -> None:
        self._vehicle = vehicle
        self.body: Body = body_of(vehicle)
        Ixx, Iyy, Izz, Ixz = self.body.Ixx, self.body.Iyy, self.body.Izz, self.body.Ixz
        self._inertia = np.array([[Ixx, 0.0, -Ixz], [0.0, Iyy, 0.0], [-Ixz, 0.0, Izz]])
        self._lengths = np.array([[self.body.b], [self.body.c], [self.body.b]])
        self._moving_mass = moving_mass
        self._inputs = (*CONTROLS, *self.body.named_controls)
        self._place(terms)
        self._tail: dict[str, Array] | None = None
        self._tail_time: Array = np.empty(0)
        self._tail_known = np.empty(0, np.bool_)
        self._pressure: float | None = None
        # Angular accelerations' jumps, of p q r, for each unit of a command's, rad/s^2; from the estimates.
        self._jumps: Array | None = None
        # Sensor errors as they are known now, for the lift in the polar.
        self.biases: dict[str, float] = {}

    def follow(self, terms: Mapping[str, Sequence[Term]], moving_mass: float) -> None:
        """Give these axes from the next rows on, which do not continue; what they are weighted by stays."""
        self._place(terms)
        self._moving_mass = moving_mass

    def _place(self, terms: Mapping[str, Sequence[Term]]) -> None:
        self.terms = {axis: tuple(chosen) for axis, chosen in terms.items()}
        self._regressors = Regressors(self.terms)
        self._places: dict[str, slice] = {}
        self._width = 0
        for axis, chosen in self.terms.items():
            size = len(chosen) + len(BIASES.get(axis, ())) + 2
            self._places[axis] = slice(self._width, self._width + size)
            self._width += size
        # Where the terms' columns stand among all.
        starts = [self._places[axis].start for axis, chosen in self.terms.items() for _ in chosen]
        within = [i for chosen in self.terms.values() for i in range(len(chosen))]
        self._of_terms = np.array(starts, np.int64) + np.array(within, np.int64)

    def take(self, rows: Rows) -> Sides | None:
        """The equations that these rows complete, None where there are none.

        Rows that do not continue begin anew, for which three rows are spent.
        """
        if rows.continues and self._tail is not None:
            columns = {name: np.concatenate([self._tail[name], rows.columns[name]]) for name in self._tail}
            time_s = np.concatenate([self._tail_time, rows.time_s])
            commands_known = np.concatenate([self._tail_known, rows.commands_known])
        else:
            columns, time_s, commands_known = rows.columns, rows.time_s, rows.commands_known
        self._tail = {name: values[-TAIL:] for name, values in columns.items()}
        self._tail_time, self._tail_known = time_s[-TAIL:], commands_known[-TAIL:]
        if time_s.size <= TAIL:
            return None
        table = self._sides(FlightData("live", rows.interval_s, time_s, self.corrected(columns)))
        # A command that is not known bends the rates in the intervals beside it. Each equation holds by itself: those
        # that need it count as 0 = 0, which keeps the others in their places.
        known = commands_known[:-3] & commands_known[1:-2] & commands_known[2:-1]
        if not known.all():
            table *= known[:, np.newaxis]
        return Sides(time_s[1:-2], table, self._places)

    def corrected(self, columns: Mapping[str, Array]) -> dict[str, Array]:
        """True airspeed, and the vanes' angles at the centre of gravity."""
        sensors = self._vehicle.sensors
        found = dict(columns)
        density = columns["air_density"]
        speed = columns["airspeed"]
        if sensors.airspeed.kind != "true":
            speed = speed * np.sqrt(SEA_LEVEL_DENSITY / density)
        found["V"] = np.maximum(speed, 1.0)
        p, q, r = (columns[name] / found["V"] for name in ("p", "q", "r"))
        x, y, _ = sensors.alpha_vane.position
        found["alpha"] = columns["alpha"] + x * q - y * p
        if "beta" in columns:
            x, _, z = sensors.beta_vane.position
            beta = columns["beta"]
            if sensors.beta_vane.kind == "flank":
                beta = np.arctan(np.tan(beta) * np.cos(found["alpha"]))
            found["beta"] = beta - x * r + z * p
        return found

    def _sides(self, data: FlightData) -> Array:
        body, dt = self.body, data.interval_s
        pressure = dynamic_pressure(data, body)
        if self._pressure is None:
            self._pressure = float(np.mean(pressure))
        weight = pressure / self._pressure
        rates = np.column_stack([data[name] for name in _RATES])
        accelerations = np.gradient(rates, dt, axis=0)
        made = coefficients(data, body, accelerations)
        biases = {axis: self._bias_columns(axis, data, weight, made) for axis in BIASES}
        factors = {name: data[name] for name in self._regressors.factors if name not in MOTION}
        half = 0.5 / data["V"]
        factors |= {name: data[name] * length * half for name, length in (("p", body.b), ("q", body.c), ("r", body.b))}
        # A bias of lift would stand squared in the polar, where no column can take it off again.
        known = zip(BIASES["CL"], biases["CL"], strict=True)
        bias = sum((self.biases[name] * column for name, column in known if name in self.biases), np.zeros(weight.size))
        factors |= {"alpha": data["alpha"], "CL": made["CL"] - bias / weight}
        if "beta" in data:
            factors["beta"] = data["beta"]
        terms = np.empty((self._of_terms.size, weight.size - TAIL))
        self._regressors.write(factors, weight, self._bends(data, half), terms)
        table = np.empty((weight.size - TAIL, self._width))
        table[:, self._of_terms] = terms.T
        turning, mean_weight = self._turning(rates, accelerations, dt), means(weight)
        for axis, place in self._places.items():
            columns = table[:, place]
            if axis in FORCES:
                for i, column in enumerate(biases[axis], start=len(self.terms[axis])):
                    columns[:, i] = column[1:-2]
                columns[:, -2], columns[:, -1] = weight[1:-2], (weight * made[axis])[1:-2]
            else:
                columns[:, -2] = mean_weight
                columns[:, -1] = means(weight * made[axis]) + turning[MOMENTS.index(axis)]
        return table

    def _turning(self, rates: Array, accelerations: Array, dt: float) -> Array:
        """(3, N - 3) what the exact change of angular momentum over an interval adds to its mean by `accelerations`."""
        change = np.diff(rates, axis=0)[1:-1] / dt - np.column_stack([means(column) for column in accelerations.T])
        return np.asarray(self._inertia @ change.T / (self._lengths * self.force_scale))

    def _bias_columns(self, axis: str, data: FlightData, weight: Array, forces: Mapping[str, Array]) -> list[Array]:
        """What a unit of each error of `BIASES` adds to the left side."""
        if axis not in BIASES:
            return []
        force = self.body.mass / self.force_scale
        ahead = force - self._moving_mass / self.force_scale
        alpha = data["alpha"]
        if axis == "CL":
            columns = [ahead * np.sin(alpha), -force * np.cos(alpha), -weight * forces["CD"]]
            columns.append(columns[-1] * alpha)
        elif axis == "CD":
            columns = [-ahead * np.cos(alpha), -force * np.sin(alpha), weight * forces["CL"]]
            columns.append(columns[-1] * alpha)
        else:
            columns = [np.full(alpha.size, force)]
        return columns

    def _bends(self, data: FlightData, half: Array) -> dict[str, Array]:
        """By how much a rate's mean over an interval differs from its samples', as commands jump at both ends.

        T / 24 times the jumps of its slope (Euler-Maclaurin; see `sysid.equation_error.equations`). half: 1 / (2 V),
        s/m.
        """
        if self._jumps is None:
            return {}
        nothing = np.zeros(half.size)
        commands = np.array([data.columns.get(name, nothing) for name in self._inputs])
        # The command of the interval behind a row stands in the next one.
        jumps = self._jumps @ np.diff(commands, axis=1)
        jumps *= data.interval_s / 24.0 * half[:-1] * self._lengths
        return dict(zip(_RATES, jumps[:, 1:-1] + jumps[:, 2:], strict=True))

    @property
    def force_scale(self) -> float:
        """Force, N, of a coefficient of 1 at the dynamic pressure of the first rows."""
        return (self._pressure or 1.0) * self.body.S

    def learn_jumps(self, values: Mapping[str, float]) -> None:
        """Take the control derivatives of the moments as they are known now: coefficient -> value."""
        if self._pressure is None:
            return
        moments = np.array([[values.get(f"{axis}_{command}", 0.0) for command in self._inputs] for axis in MOMENTS])
        self._jumps = np.linalg.solve(self._inertia, moments * self._lengths * self.force_scale)
