"""Both sides of the force and moment equations at every sample, the way every regression takes them.

All columns are multiplied by dynamic pressure over its mean. The sensors' noise is in the forces and in the rates, so
a coefficient measured at low speed is the noisier one: weighted like this every sample counts with the same noise, and
no noisy airspeed divides the regressand. Both sides then pass the same zero-phase filter, so that it cancels.

A held command acts between its sample and the next, while a derivative at a sample sees what comes before and after.
The samples q[k] of a rate driven by a command d held from each sample to the next obey, in the band, exactly
q' <-> j w T / (exp(j w T) - 1) d, that is half a sample of delay and the gain x / sin x, x = w T / 2. Four commands
follow that to order w^4 (`PAIRING`); the mean of two loses 1.6 % at 2.5 Hz and 50 Hz.
The jumps of the angular acceleration also bend the rates between samples, which a series through the samples does not
follow: the mean of a rate over an interval differs from the series' by T/24 times the jumps at its two ends
(Euler-Maclaurin). `Equations.take_jumps` adds that; a roll mode of 0.05 s at 50 Hz is biased by 1.5 % without.
Positions of the surfaces that were measured go with the motion at their own sample, as any other measurement does.
Sources: Klein & Morelli, "Aircraft System Identification", chapter 5; Jolly, Unhelkar & Arya, section III.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sim_vehicle.model.aerodynamic_terms import REGRESSORS, Term
from sysid.arrays import Array
from sysid.equation_error.coefficients import AXES, Body, coefficients, dynamic_pressure, off_centre
from sysid.errors import EstimationError, SignalError
from sysid.numerics.smoothing import Smoothed, fourier_smooth, smooth_columns
from sysid.signals.flight import FlightData

CUTOFF_HZ = 5.0  # of the low-pass in front of equation error, above a small aircraft's rigid-body modes
FORCES = ("CL", "CD", "CY")
MOMENTS = ("Cl", "Cm", "Cn")
CONTROLS = ("de", "da", "dr", "throttle")
# Weights of the commands at k + 1, k, k - 1, k - 2: what x / sin x is to fourth order.
PAIRING = (-1.0 / 12.0, 7.0 / 12.0, 7.0 / 12.0, -1.0 / 12.0)
_EDGE_S = 0.1  # the sine series is weakest where its end-point line is pinned
_LEAST_SAMPLES = 16


class Equations:
    """Regressands and regressors of one or more parts, unfiltered part by part or filtered and joined.

    parts: corrected parts (sysid.compatibility.reconstruction.correct) without NaN: ax ay az p q r alpha V thrust, beta
        and the commands de da dr throttle and of other controls, held from each sample to the next, where a term has
        them.
    body: mass, inertia, geometry. terms: those that columns will be asked for. cutoff_hz: of the filter.
    command_first: whether a sensor at a sample already sees the command of that sample, or that of the one before.
    Raises SignalError for a missing signal, EstimationError without parts.
    """

    def __init__(
        self,
        parts: FlightData | Sequence[FlightData],
        body: Body,
        terms: Sequence[Term],
        cutoff_hz: float = CUTOFF_HZ,
        command_first: bool = False,
    ) -> None:
        sequence = [parts] if isinstance(parts, FlightData) else list(parts)
        if not sequence:
            raise EstimationError("equation error needs at least one part of a flight")
        self.interval_s = sequence[0].interval_s
        self.cutoff_hz = cutoff_hz
        self.bandwidth = min(2.0 * cutoff_hz * self.interval_s, 1.0)
        needed = {factor for term in terms for factor in term.factors}
        pressures = [dynamic_pressure(part, body) for part in sequence if "V" in part]
        mean = float(np.mean(np.concatenate(pressures))) if pressures else 1.0
        self.parts = [PartEquations(part, body, needed, cutoff_hz, command_first, mean) for part in sequence]
        self.lengths = [part.kept.stop - part.kept.start for part in self.parts]

    def regressand(self, axis: str) -> Array:
        """(N,) filtered and weighted coefficient of one axis, parts joined."""
        return np.concatenate([part.filtered_regressand(axis) for part in self.parts])

    def matrix(self, terms: Sequence[Term]) -> Array:
        """(N, P) filtered and weighted columns of terms of one axis, parts joined."""
        return np.concatenate([part.filtered_matrix(terms) for part in self.parts])

    def values(self, factor: str) -> Array:
        """(N,) one regressor as it flew, neither filtered nor weighted, parts joined."""
        return np.concatenate([part.factor(factor)[part.kept] for part in self.parts])

    def take_lift(self, terms: Sequence[Term], values: Array) -> None:
        """Let CL in the regressors be the lift of a model instead of the noisy measured one."""
        for part in self.parts:
            part.take_lift(terms, values)

    def take_timing(self, command_first: bool) -> None:
        """Let sensors at a sample see the command of that sample already, or the one before, whatever it was so far."""
        for part in self.parts:
            part.take_timing(command_first)

    def take_jumps(self, values: Mapping[str, float], terms: Sequence[Term]) -> None:
        """Let the rates in the moment equations count how held commands bend them between samples.

        values: coefficient -> estimate. terms: those of the moment axes.
        """
        for part in self.parts:
            part.take_jumps(values, terms)


class PartEquations:
    """The equations of one part. kept: samples that regressions take."""

    def __init__(
        self,
        data: FlightData,
        body: Body,
        needed: set[str],
        cutoff_hz: float,
        command_first: bool,
        mean_pressure: float,
    ) -> None:
        self._data, self._body, self._command_first = data, body, command_first
        self.cutoff_hz = cutoff_hz
        # Where a surface was at a sample is what the motion at that sample goes with.
        named = {factor for factor in needed if factor not in REGRESSORS}
        self._commands = {*CONTROLS, *named}
        self._held = {"throttle", *named} if body.surfaces_measured else self._commands
        self._pressure = mean_pressure
        edge = round(_EDGE_S / data.interval_s)
        size = data.time_s.size
        self.kept = slice(edge, size - edge)
        if size - 2 * edge < _LEAST_SAMPLES:
            raise SignalError(f"{data.name}: a part of {size} samples is too short for equation error")
        for name in ("alpha", "V", "p", "q", "r", *sorted(needed & {"beta", *self._commands})):
            self._column(name)
        rates = np.column_stack([data[name] for name in ("p", "q", "r")])
        self.weight = dynamic_pressure(data, body) / mean_pressure
        # Without angular accelerations the moment equations keep their gyroscopic and propulsive part.
        forces = still = coefficients(data, body, np.zeros_like(rates))
        if off_centre(data, body):
            slopes = np.column_stack([self._smooth(rate).derivative for rate in rates.T])
            forces = coefficients(data, body, slopes)
        self.force = {axis: self.weight * forces[axis] for axis in FORCES}
        self.rest = {axis: self.weight * still[axis] for axis in MOMENTS}
        p, q, r = rates.T
        momentum = {"Cl": body.Ixx * p - body.Ixz * r, "Cm": body.Iyy * q, "Cn": body.Izz * r - body.Ixz * p}
        arm = {"Cl": body.b, "Cm": body.c, "Cn": body.b}
        # Angular momentum; its derivative is the rest of the moment.
        self.momentum = {axis: momentum[axis] / (mean_pressure * body.S * arm[axis]) for axis in MOMENTS}
        self._left: dict[str, Array] = {}
        # Filtered columns by their factors and whether they are a moment's: many axes and rounds share them.
        self._columns: dict[tuple[tuple[str, ...], bool], Array] = {}
        per_length = 1.0 / (2.0 * data["V"])
        lengths = {"p": body.b, "q": body.c, "r": body.b}
        self._per_rate = {name: length * per_length for name, length in lengths.items()}
        self._factors = {name: data[name] * scale for name, scale in self._per_rate.items()}
        self._bent = {name: np.zeros(size) for name in lengths}
        self._factors |= {"alpha": data["alpha"], "V": data["V"], "CL": forces["CL"]}
        if "beta" in needed:
            self._factors["beta"] = data["beta"]
        if "alphadot" in needed:
            # The motion is smooth already; a cut-off well above the filter's leaves the filter's own band alone.
            wide = min(3.0 * cutoff_hz, 0.4 / data.interval_s)
            slope = fourier_smooth(data["alpha"], data.interval_s, wide).derivative
            self._factors["alphadot"] = slope * body.c * per_length

    def has(self, name: str) -> bool:
        """Whether the flight has a signal."""
        return name in self._data

    def factor(self, name: str) -> Array:
        """(n,) a regressor at every sample, unfiltered; a command as it was sent."""
        return self._column(name) if name in self._commands else self._factors[name]

    def take_lift(self, terms: Sequence[Term], values: Array) -> None:
        """See Equations.take_lift."""
        lift = np.column_stack([self._product(term) for term in terms]) @ values
        self._factors = {**self._factors, "CL": lift}
        self._columns = {key: column for key, column in self._columns.items() if "CL" not in key[0]}

    def take_timing(self, command_first: bool) -> None:
        """See Equations.take_timing."""
        self._command_first = command_first
        self._columns = {
            key: column for key, column in self._columns.items() if key[1] or not set(key[0]) & self._commands
        }

    def take_jumps(self, values: Mapping[str, float], terms: Sequence[Term]) -> None:
        """See Equations.take_jumps."""
        body, size = self._body, self._data.time_s.size
        moment = {axis: np.zeros(size) for axis in MOMENTS}
        for term in terms:
            commands = [factor for factor in term.factors if factor in self._held]
            if not commands:
                continue
            held = np.prod([self._column(factor) for factor in commands], axis=0)
            jump = values[term.name] * np.diff(held, prepend=held[0])
            for factor in term.factors:
                if factor not in commands:
                    jump = jump * self.factor(factor)
            moment[term.axis] = moment[term.axis] + jump
        lengths = np.array([body.b, body.c, body.b])
        turning = (
            np.stack([moment[axis] for axis in MOMENTS]) * lengths[:, None] * self.weight * self._pressure * body.S
        )
        inertia = np.array([[body.Ixx, 0.0, -body.Ixz], [0.0, body.Iyy, 0.0], [-body.Ixz, 0.0, body.Izz]])
        for name, jumps in zip(("p", "q", "r"), np.linalg.solve(inertia, turning), strict=True):
            around = np.pad(jumps, 1)
            # Half a sample later again, as everything that is a mean over an interval.
            bent = self._data.interval_s / 48.0 * (around[2:] + 2.0 * jumps + around[:-2])
            self._bent[name] = bent * self._per_rate[name]
        self._columns = {
            key: column for key, column in self._columns.items() if not (key[1] and self._bent.keys() & set(key[0]))
        }

    def column(self, term: Term) -> Array:
        """(n,) weighted, unfiltered column of a term, a command as the axis' kind of measurement sees it."""
        return np.asarray(self.weight * self._product(term), dtype=np.float64)

    def filtered_matrix(self, terms: Sequence[Term]) -> Array:
        """(kept, P) columns as the time-domain regression takes them."""
        keys = [(term.factors, term.axis in MOMENTS) for term in terms]
        new = {key: term for key, term in zip(keys, terms, strict=True) if key not in self._columns}
        if new:
            columns = np.column_stack([self.column(term) for term in new.values()])
            smooth = smooth_columns(columns, self._data.interval_s, self.cutoff_hz)[self.kept]
            self._columns.update(zip(new, smooth.T, strict=True))
        return np.column_stack([self._columns[key] for key in keys])

    def filtered_regressand(self, axis: str) -> Array:
        """(kept,) the same of the left-hand side."""
        if axis not in self._left:
            if axis in FORCES:
                left = self._smooth(self.force[axis]).values
            else:
                left = self._smooth(self.momentum[axis]).derivative + self._smooth(self.rest[axis]).values
            self._left[axis] = left[self.kept]
        return self._left[axis]

    def _product(self, term: Term) -> Array:
        commands = [factor for factor in term.factors if factor in self._held]
        product = np.ones(self._data.time_s.size)
        for factor in commands:
            product = product * self._column(factor)
        if commands:
            product = self._paired(product, term.axis)
        for factor in term.factors:
            if factor not in commands:
                bent = self._bent[factor] if term.axis in MOMENTS and factor in self._bent else 0.0
                product = product * (self.factor(factor) + bent)
        return product

    def _paired(self, held: Array, axis: str) -> Array:
        if axis in MOMENTS:
            around = np.concatenate([held[:1], held[:1], held, held[-1:]])
            size = held.size
            return np.asarray(sum(w * around[3 - i : 3 - i + size] for i, w in enumerate(PAIRING)))
        return held if self._command_first else np.concatenate([held[:1], held[:-1]])

    def _smooth(self, values: Array) -> Smoothed:
        return fourier_smooth(values, self._data.interval_s, self.cutoff_hz)

    def _column(self, name: str) -> Array:
        if name not in self._data:
            raise SignalError(f"{self._data.name}: the model has a term in {name}, which the flight lacks")
        values = self._data[name]
        if not np.isfinite(values).all():
            raise SignalError(f"{self._data.name}: {name} has gaps in this part; give a part without (find_segments)")
        return values


def axes_of(terms: Sequence[Term]) -> list[tuple[str, list[Term]]]:
    """Terms by axis, CL before CD, whose polar takes the model's lift."""
    grouped = [(axis, [term for term in terms if term.axis == axis]) for axis in AXES]
    return [(axis, chosen) for axis, chosen in grouped if chosen]
