"""Both sides of the force and moment equations, sample by sample.

Definitions are those of `sysid.coefficients` and pairing that of `sysid.equations`; what differs is that nothing may
look into the future. Forces hold at each sample, under the command of the sample before. Moments hold over each
interval between two samples, exactly: the difference of angular momentum is the integral of the moment, a held command
is itself, and the mean of what is smooth follows from the four samples around. Since each interval's equation holds by
itself, any sum of them does, and a finite Fourier transform needs no end terms: summed by parts, the transform of the
differences is (exp(j w T) - 1) / T times that of the momentum, plus the end terms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sim_vehicle.terms import Term
from sim_vehicle.vehicle import SEA_LEVEL_DENSITY, Vehicle
from sysid.coefficients import Body, coefficients, dynamic_pressure
from sysid.equations import CONTROLS, FORCES, MOMENTS
from sysid.flight import Array, FlightData
from sysid.live.timebase import Rows
from sysid.residuals import body_of

# Mean over an interval by the cubic through the samples before, at both ends, and behind.
_MEAN = (-1.0 / 24.0, 13.0 / 24.0, 13.0 / 24.0, -1.0 / 24.0)
_TAIL = 3
# Sensor errors that go into the left side of the forces: those of the accelerometer, and the vane's that turns them.
BIASES = {
    "CL": ("accel_bias_x", "accel_bias_z", "alpha_bias", "alpha_scale"),
    "CD": ("accel_bias_x", "accel_bias_z", "alpha_bias", "alpha_scale"),
    "CY": ("accel_bias_y",),
}


class LiveEquations:
    """Columns of every axis as rows come. Terms are those of the model, by axis.

    moving_mass: kg on the thrust sensor, whose pull the accelerometer's error changes as well.
    weight: dynamic pressure over that of the first rows, which all columns carry, as after the flight.
    """

    def __init__(self, vehicle: Vehicle, terms: Mapping[str, Sequence[Term]], moving_mass: float = 0.0) -> None:
        self._vehicle = vehicle
        self.body: Body = body_of(vehicle)
        self._moving_mass = moving_mass
        self.terms = {axis: tuple(chosen) for axis, chosen in terms.items()}
        self._tail: dict[str, Array] | None = None
        self._tail_time: Array = np.empty(0)
        self._tail_told = np.empty(0, np.bool_)
        self._pressure: float | None = None
        # Angular accelerations' jumps for each unit of a command's, by rate and command, rad/s^2; from the estimates.
        self.jumps: dict[str, dict[str, float]] = {}
        # Sensor errors as they are known now, for the lift in the polar.
        self.biases: dict[str, float] = {}

    def follow(self, terms: Mapping[str, Sequence[Term]], moving_mass: float) -> None:
        """Give these axes from the next rows on, which do not continue; what they are weighted by stays."""
        self.terms = {axis: tuple(chosen) for axis, chosen in terms.items()}
        self._moving_mass = moving_mass

    def take(self, rows: Rows) -> tuple[Array, dict[str, Array]]:
        """Times (K,) of the equations that these rows complete, and for each axis (K, P + B + 2): terms, what unit
        sensor errors add (`BIASES`), weight, left side.

        Rows that do not continue begin anew, for which three rows are spent.
        """
        if rows.continues and self._tail is not None:
            columns = {name: np.concatenate([self._tail[name], rows.columns[name]]) for name in self._tail}
            time_s = np.concatenate([self._tail_time, rows.time_s])
            told = np.concatenate([self._tail_told, rows.told])
        else:
            columns, time_s, told = rows.columns, rows.time_s, rows.told
        self._tail = {name: values[-_TAIL:] for name, values in columns.items()}
        self._tail_time, self._tail_told = time_s[-_TAIL:], told[-_TAIL:]
        if time_s.size <= _TAIL:
            return np.empty(0), {}
        data = FlightData("live", rows.interval_s, time_s, self.corrected(columns))
        # A command that is not known bends the rates in the intervals beside it. Each equation holds by itself: those
        # that need it count as 0 = 0, which keeps the others in their places.
        known = told[:-3] & told[1:-2] & told[2:-1]
        return time_s[1:-2], {axis: columns * known[:, np.newaxis] for axis, columns in self._sides(data).items()}

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

    def _sides(self, data: FlightData) -> dict[str, Array]:
        body, dt = self.body, data.interval_s
        pressure = dynamic_pressure(data, body)
        if self._pressure is None:
            self._pressure = float(np.mean(pressure))
        weight = pressure / self._pressure
        rates = np.column_stack([data[name] for name in ("p", "q", "r")])
        forces = coefficients(data, body, np.gradient(rates, dt, axis=0))
        still = coefficients(data, body, np.zeros_like(rates))
        p, q, r = rates.T
        momentum = {"Cl": body.Ixx * p - body.Ixz * r, "Cm": body.Iyy * q, "Cn": body.Izz * r - body.Ixz * p}
        arms = {"Cl": body.b, "Cm": body.c, "Cn": body.b}
        lengths = {"p": body.b, "q": body.c, "r": body.b}
        factors = {name: data[name] * length / (2.0 * data["V"]) for name, length in lengths.items()}
        # A bias of lift would stand squared in the polar, where no column can take it off again.
        known = zip(BIASES["CL"], self._bias_columns("CL", data, weight, forces), strict=True)
        bias = sum((self.biases.get(name, 0.0) * column for name, column in known), np.zeros(weight.size))
        factors |= {"alpha": data["alpha"], "CL": forces["CL"] - bias / weight}
        if "beta" in data:
            factors["beta"] = data["beta"]
        bends = self._bends(data, factors)
        sides: dict[str, Array] = {}
        for axis, terms in self.terms.items():
            if axis in FORCES:
                left = (weight * forces[axis])[1:-2]
                columns = [self._at_sample(term, data, factors, weight) for term in terms]
                ones = weight[1:-2]
            else:
                change = np.diff(momentum[axis])[1:-1] / (self._pressure * body.S * arms[axis] * dt)
                left = change + _means(weight * still[axis])
                columns = [self._over_interval(term, data, factors, weight, bends) for term in terms]
                ones = _means(weight)
            biased = [column[1:-2] for column in self._bias_columns(axis, data, weight, forces)]
            sides[axis] = np.column_stack([*columns, *biased, ones, left])
        return sides

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

    def _at_sample(self, term: Term, data: FlightData, factors: dict[str, Array], weight: Array) -> Array:
        product = weight[1:-2]
        for factor in term.factors:
            product = product * (data[factor][:-3] if factor in CONTROLS else factors[factor][1:-2])
        return product

    def _over_interval(
        self, term: Term, data: FlightData, factors: dict[str, Array], weight: Array, bends: dict[str, Array]
    ) -> Array:
        smooth, held = weight, np.ones(weight.size - _TAIL)
        for factor in term.factors:
            if factor in CONTROLS:
                held = held * data[factor][1:-2]
            else:
                smooth = smooth * factors[factor]
        mean = _means(smooth)
        if len(term.factors) == 1 and term.factors[0] in bends:
            mean = mean + bends[term.factors[0]] * weight[1:-2]
        return mean * held

    def _bends(self, data: FlightData, factors: dict[str, Array]) -> dict[str, Array]:
        """By how much a rate's mean over an interval differs from its samples', as commands jump at both ends.

        T / 24 times the jumps of its slope (Euler-Maclaurin; see `sysid.equations`).
        """
        found: dict[str, Array] = {}
        for rate, by_command in self.jumps.items():
            jumps = np.zeros(data.time_s.size)
            for command, gain in by_command.items():
                if command in data:
                    jumps = jumps + gain * np.diff(data[command], prepend=data[command][0])
            length = self.body.c if rate == "q" else self.body.b
            scale = data.interval_s / 24.0 * length / (2.0 * data["V"])
            found[rate] = (scale * jumps)[1:-2] + (scale * jumps)[2:-1]
        return found

    @property
    def force_scale(self) -> float:
        """Force, N, of a coefficient of 1 at the dynamic pressure of the first rows."""
        return (self._pressure or 1.0) * self.body.S

    def learn_jumps(self, values: Mapping[str, float]) -> None:
        """Take the control derivatives of the moments as they are known now: coefficient -> value."""
        if self._pressure is None:
            return
        body = self.body
        inertia = np.array([[body.Ixx, 0.0, -body.Ixz], [0.0, body.Iyy, 0.0], [-body.Ixz, 0.0, body.Izz]])
        lengths = np.array([body.b, body.c, body.b]) * self._pressure * body.S
        for command in CONTROLS:
            moment = np.array([values.get(f"{axis}_{command}", 0.0) for axis in MOMENTS]) * lengths
            for rate, gain in zip(("p", "q", "r"), np.linalg.solve(inertia, moment), strict=True):
                self.jumps.setdefault(rate, {})[command] = float(gain)


def _means(values: Array) -> Array:
    """(N - 3,) means over the intervals that have a sample on each side."""
    size = values.size - _TAIL
    return np.asarray(sum(w * values[i : i + size] for i, w in enumerate(_MEAN)), dtype=np.float64)
