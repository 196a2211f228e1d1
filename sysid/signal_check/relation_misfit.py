"""How badly the kinematic relations between the sensors hold, in either half of a flight.

A relation is measured against what the other sensors say of the same motion: the integrals of
sysid.signal_check.kinematic_relations, and the velocity over ground against the airspeed turned by the attitude, which
differ by a wind that hardly changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Array
from sysid.signal_check.fault_hypotheses import Hypothesis
from sysid.signal_check.kinematic_relations import AIR, Columns, Window, integrate
from sysid.signals.sensor_groups import ACCEL, GROUND

# The velocity over ground against that through the air.
OVER_GROUND = tuple(f"{name} over air" for name in GROUND)
# A relation fails from this share of its motion on: a wrong sign leaves 2 of it, a wrong unit from 0.18 (knots) on.
_FAILS = 0.15
# What a correction may leave of a relation's misfit; by how much it may worsen one that holds, and one that does not.
_LEFT, _WORSE, _MUCH_WORSE = 0.25, 0.05, 1.2
# A half of the flight has a say in a relation where it holds this share of the motion.
_SAY = 0.2
# Factor between the two sides of a relation, whichever of them has the noise: wrong from the first on, right to the
# second; the smallest of a unit is 1.94 (knots), and two of one kind lie a factor of 1.1 apart.
_GAIN_FAILS, _GAIN_HOLDS = float(np.log(1.3)), float(np.log(1.1))
# A gain of one side of a relation against the other counts from this error on, where the halves of the flight differ in
# it by less than the larger of this and that share of its error, and 1 less the squared correlation is below that too.
# Flights as the field gives them show gains 1 to 2 % off.
_LEAST_GAIN, _GAIN_ALIKE, _OF_GAIN = 0.05, 0.02, 0.25
# A measured side that moves so many times as much as the integrated one was not made by it.
_SILENT = 5.0
# Mean specific force that attitude and motion leave unexplained, m/s^2: impossible as recorded, ordinary as corrected.
_FORCE = (4.0, 1.5)
# Angles, rad, that 19 of 20 samples stay below: impossible as recorded, ordinary as corrected.
_ANGLES = {"phi": (3.3, 3.15), "theta": (1.7, 1.6), "alpha": (1.7, 0.8), "beta": (1.7, 0.8)}
# Correlation by which the lift falls as the angle of attack grows: impossible as recorded, ordinary as corrected.
_LIFT = (0.6, 0.0)
_SLOWEST = 3.0  # airspeed, m/s, below which nothing flies
# Share of what a reading of the accelerometers would change in the velocities that the flight asks for, 0 where they
# are right as recorded and 1 where they are as read; what it may leave of the misfit.
_ASKED, _LEFT_OF_FORCE = (0.7, 1.4), 0.5


@dataclass(frozen=True)
class Misfit:
    """How badly the relations hold, in either half of the flight.

    shares: relation -> energy of measured less integrated over that of both, slow motions left out; 0 to 2. gains:
    relation -> measured over integrated, by least squares. alike: relation -> squared correlation of both. factors: of
    OVER_GROUND, logarithm of the least factor between its sides. levels: name of a level -> its size.
    """

    energies: dict[str, tuple[float, float]]
    shares: dict[str, tuple[float, float]]
    gains: dict[str, tuple[float, float]]
    alike: dict[str, tuple[float, float]]
    factors: dict[str, tuple[float, float]]
    levels: dict[str, tuple[float, float]]

    @classmethod
    def of(cls, windows: Sequence[Window], columns: Sequence[Columns]) -> Misfit:
        sums: dict[str, Array] = {}
        forces, angles, lift = np.zeros((2, 3)), {name: ([0.0], [0.0]) for name in _ANGLES}, np.zeros((2, 3))
        for i, (window, one) in enumerate(zip(windows, columns, strict=True)):
            states, half = window.states(one), i % 2
            measured, gaps = window.fast(window.measured(states, one)), window.gaps(states, one)
            for name, gap in gaps.items():
                taken = measured[name]
                sums.setdefault(name, np.zeros((2, 4)))[half] += _products(taken, taken - gap)
            for name, through in window.through_air(states, window.measured(states, one)).items():
                rows = window.rows[name]
                taken, made = one[name][rows], through[rows]
                products = _products(taken - taken.mean(), made - made.mean())
                sums.setdefault(f"{name} over air", np.zeros((2, 4)))[half] += products
            forces[half] += window.level(states) * window.size
            if window.has_alpha:
                lift[half] += _variances(one["alpha"], -one["az"] / np.maximum(one["airspeed"], _SLOWEST) ** 2)
            for name, sizes in angles.items():
                if name in one:
                    sizes[half].append(_large(one[name]))
        lengths = np.maximum([sum(w.size for w in windows[half::2]) for half in (0, 1)], 1)
        energies = {name: _pair(s[:, 1] + s[:, 2]) for name, s in sums.items()}
        shares = {name: _pair(s[:, 0] / np.maximum(s[:, 1] + s[:, 2], 1e-300)) for name, s in sums.items()}
        gains = {name: _pair(s[:, 3] / np.maximum(s[:, 2], 1e-300)) for name, s in sums.items()}
        alike = {name: _pair(s[:, 3] ** 2 / np.maximum(s[:, 1] * s[:, 2], 1e-300)) for name, s in sums.items()}
        factors = {name: (_factor(s[0]), _factor(s[1])) for name, s in sums.items() if name in OVER_GROUND}
        levels = {name: (max(first), max(second)) for name, (first, second) in angles.items()}
        levels["lift"] = _pair(-lift[:, 1] / np.maximum(np.sqrt(lift[:, 0] * lift[:, 2]), 1e-300))
        levels["force"] = _pair(np.linalg.norm(forces, axis=1) / lengths)
        return cls(energies, shares, gains, alike, factors, levels)

    def impossible(self) -> set[str]:
        """Levels that no flight has, in either half."""
        return {name for name, sizes in self.levels.items() if min(sizes) > _limits(name)[0]}

    def mended_by(self, after: Misfit, asked: bool = False) -> bool:
        """Whether what fails here holds there, and nothing else fails there instead.

        asked: whether the forces ask for what was changed.
        """
        for name, sizes in after.levels.items():
            if max(sizes) > max(_limits(name)[1], *self.levels[name]) + 1e-6:
                return False
        if self.harmed_by(after):
            return False
        wrong = self.impossible()
        if asked or any(max(after.levels[name]) < _limits(name)[1] for name in wrong):
            return True
        return any(
            all(
                a > _FAILS and b < _LEFT * a
                for a, b in ((self.shares[name][half], after.shares[name][half]) for half in self._moving(name))
            )
            or (self._wrong_factor(name) and max(after.factors[name]) < _GAIN_HOLDS)
            for name in self.failing()
        )

    def harmed_by(self, after: Misfit) -> bool:
        """Whether a relation that holds here does not there, or one that does not is far worse."""
        return any(
            b > max(a + _WORSE, _MUCH_WORSE if a > _FAILS else 0.0)
            for name, halves in after.shares.items()
            for a, b in zip(self.shares[name], halves, strict=True)
        ) or any(after._wrong_factor(name) and not self._wrong_factor(name) for name in after.factors)

    def failing(self) -> set[str]:
        """Relations that do not hold, in either half that moves."""
        return {
            name
            for name, halves in self.shares.items()
            if all(halves[half] > _FAILS for half in self._moving(name)) or self._wrong_factor(name)
        }

    def total(self) -> float:
        """Sum of the shares."""
        return float(sum(sum(halves) for halves in self.shares.values()))

    def of_speed(self, signals: Sequence[str]) -> float:
        """Sum of the shares of the relations that show how large these velocities are; integrals lose some of it."""
        names = (*OVER_GROUND, *(AIR if "airspeed" in signals else ()))
        return float(sum(sum(halves) for name, halves in self.shares.items() if name in names))

    def gain(self, name: str) -> float:
        """Measured over integrated, the halves by how much they move."""
        return float(np.average(self.gains[name], weights=np.maximum(self.energies[name], 1e-300)))

    def silences(self, name: str) -> bool:
        """Whether what is integrated hardly moves beside what is measured, in a half that moves."""
        return any(abs(self.gains[name][half]) > _SILENT * self.alike[name][half] ** 0.5 for half in self._moving(name))

    def is_gain(self, name: str) -> bool:
        """Whether the measured side is clearly a multiple of the integrated one, the same in each half."""
        off = [gain - 1.0 for gain in self.gains[name]]
        least = min(map(abs, off))
        within = max(_GAIN_ALIKE, _OF_GAIN * least)
        same = off[0] * off[1] > 0.0 and abs(off[0] - off[1]) < within
        return same and least > _LEAST_GAIN and 1.0 - min(self.alike[name]) < within

    def _wrong_factor(self, name: str) -> bool:
        return name in self.factors and min(self.factors[name]) > _GAIN_FAILS

    def _moving(self, name: str) -> list[int]:
        energies = self.energies[name]
        return [half for half in (0, 1) if energies[half] >= _SAY * sum(energies)]


class ForceBalance:
    """What the accelerometers' readings leave of the velocities through the air, and what other readings would."""

    def __init__(self, windows: Sequence[Window], columns: Sequence[Columns]) -> None:
        # Relation -> products over a half: of the gap, of it and the forces' integrals, of those.
        self._products: list[dict[str, tuple[float, Array, Array]]] = [{}, {}]
        for i, (window, one) in enumerate(zip(windows, columns, strict=True)):
            forces = np.stack([one[name] for name in ACCEL])
            integrals = np.empty_like(forces)
            integrate(forces, window.interval_s, integrals)
            integrals = window.quick(integrals)
            sums, square = self._products[i % 2], integrals @ integrals.T
            for name, gap in window.gaps(window.states(one), one).items():
                if name in AIR:
                    e, f, g = sums.get(name, (0.0, 0.0, 0.0))
                    sums[name] = (e + float(gap @ gap), f + integrals @ gap, g + square)

    def asks_for(self, reading: Hypothesis) -> bool:
        """Whether both halves of the flight ask for a reading of the accelerometers, on every axis that it changes."""
        if not set(reading.signals) <= set(ACCEL) or reading.gravity:
            return False
        change = np.zeros((3, 3))
        places = [ACCEL.index(name) for name in reading.signals]
        change[np.ix_(places, places)] = reading.matrix - np.eye(len(places))
        asked = [
            _asked(row, *sums[relation])
            for relation, row in zip(AIR, change, strict=True)
            if row.any()
            for sums in self._products
            if relation in sums
        ]
        return bool(asked) and all(_ASKED[0] < share < _ASKED[1] and left < _LEFT_OF_FORCE for share, left in asked)


def _asked(row: Array, gap: float, both: Array, forces: Array) -> tuple[float, float]:
    """Share of a change `row` (3,) that the products of a relation ask for, and what all of it leaves of the misfit."""
    made, shared = float(row @ forces @ row), float(row @ both)
    return shared / max(made, 1e-300), 1.0 + (made - 2.0 * shared) / max(gap, 1e-300)


def _products(taken: Array, made: Array) -> tuple[float, float, float, float]:
    gap = taken - made
    return float(gap @ gap), float(taken @ taken), float(made @ made), float(taken @ made)


def _factor(sums: Array) -> float:
    """Logarithm of the least factor between what is measured and made: each may have all of the noise."""
    _, taken, made, both = sums
    if both <= 0.0:
        return 0.0
    return float(max(np.log(both / made), -np.log(taken / both), 0.0))


def _large(values: Array) -> float:
    """Size that 95 % of the values stay below; a selection, since a percentile interpolates for ten times as long."""
    place = int(0.95 * (values.size - 1))
    return float(np.partition(np.abs(values), place)[place])


def _variances(one: Array, other: Array) -> Array:
    """(3,) products of two signals' deviations: of the first, of both, of the second."""
    first, second = one - one.mean(), other - other.mean()
    return np.array([first @ first, first @ second, second @ second])


def _limits(name: str) -> tuple[float, float]:
    return {"force": _FORCE, "lift": _LIFT}.get(name) or _ANGLES[name]


def _pair(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])
