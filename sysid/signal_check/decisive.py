"""Mistakes in signals that no owner would doubt, and the flight as it reads without them.

A reading of the data (sysid.signal_check.fault_hypotheses) is decisive where the kinematic relations do not hold as
recorded and do as corrected, in either half of the flight by itself. What is less than that stays as recorded: noise,
lags and gusts make a wrong reading likelier than the right one by any likelihood that does not know them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import SignalError
from sysid.signal_check.check import impossible_values, stop_at_unusable
from sysid.signal_check.fault import Mistake
from sysid.signal_check.fault_hypotheses import SI, Hypothesis, hypotheses, scale_hypothesis
from sysid.signal_check.fault_search import Columns, LikelyReading, discrete_readings, known, longest
from sysid.signal_check.kinematic_residuals import AIR, GROUND, KinematicResiduals, Window
from sysid.signal_check.remedies import named_cures
from sysid.signals.flight import FlightData, FlightSignals
from sysid.signals.preparation import Prepared
from sysid.signals.sensor_groups import ACCEL, ATTITUDE, GYRO, IMU, VANES
from sysid.signals.sensor_layout import SensorLayout

# A relation fails from this share of its motion on: a wrong sign leaves 2 of it, a wrong unit from 0.18 (knots) on.
_FAILS = 0.15
# What a correction may leave of a relation's misfit; by how much it may worsen one that holds, and one that does not.
_LEFT, _WORSE, _MUCH_WORSE = 0.25, 0.05, 1.2
# A half of the flight has a say in a relation where it holds this share of the motion.
_SAY = 0.2
# Mean specific force that attitude and motion leave unexplained, m/s^2: impossible as recorded, ordinary as corrected.
_FORCE = (4.0, 1.5)
# Angles, rad, that 19 of 20 samples stay below: impossible as recorded, ordinary as corrected.
_ANGLES = {"phi": (3.3, 3.15), "theta": (1.7, 1.6), "alpha": (1.7, 0.8), "beta": (1.7, 0.8)}
# A gain of a gyro counts from this error on, and up to a factor that is rather a unit.
_GAIN, _LARGEST_GAIN = 0.2, 20.0
_MOST = 4


@dataclass(frozen=True)
class Correction:
    """A mistake and the reading of the signals that is free of it."""

    mistake: Mistake
    reading: Hypothesis

    def apply(self, flight: FlightSignals) -> FlightSignals:
        """The flight as its sensors meant it, each signal on its own stamps; unchanged where a signal is missing."""
        reading = self.reading
        needed = (*reading.signals, *(ATTITUDE[:2] if reading.gravity else ()))
        if not all(name in flight.signals for name in needed):
            return flight
        every = dict(flight.signals)
        for i, name in enumerate(reading.signals):
            # An exchanged axis brings the stamps of the axis that it is read from.
            source = flight.signals[reading.signals[int(np.argmax(np.abs(reading.matrix[i])))]]
            at = {n: _at(flight, n, source.time_s) for n in needed}
            every[name] = replace(source, values=reading.apply(at)[name])
        return replace(flight, signals=every)


def require_searched(names: Collection[str]) -> None:
    """Raise SignalError for a name of no signal that is searched for mistakes."""
    if strange := sorted({*names} - {*SI, "thrust"}):
        known_names = ", ".join((*SI, "thrust"))
        raise SignalError(
            f"as recorded: {', '.join(strange)} is no signal searched for mistakes; those are {known_names}"
        )


def as_meant(
    signals: FlightSignals, flight: Prepared, vehicle: Vehicle, as_recorded: Collection[str] = ()
) -> tuple[FlightSignals, list[Mistake]]:
    """A flight without the mistakes that no owner would doubt, and what they are.

    flight: the signals prepared. as_recorded: signals that are never taken for wrong, beside those of the vehicle file.
    Raises SignalError where the density of the air is one that no air has, and for a name of no signal.
    """
    kept = {*as_recorded, *vehicle.as_recorded}
    require_searched(kept)
    stop_at_unusable([one for one in impossible_values([flight], vehicle) if one.signal == "air_density"], signals.name)
    found = decisive_corrections([stretch.data for stretch in flight.stretches], flight.layout, kept)
    strong = [one for one in impossible_values([flight], vehicle) if one.signal == "thrust" and "thrust" not in kept]
    found += [
        Correction(one, Hypothesis(("thrust",), "unit", one.sentence, np.full((1, 1), one.found)))
        for one in strong
        if np.isfinite(one.found)
    ]
    for one in found:
        signals = one.apply(signals)
    if any(not np.isfinite(one.found) for one in strong):
        signals = replace(signals, signals={n: one for n, one in signals.signals.items() if n != "thrust"})
    told = [_told(one) for one in named_cures([each.mistake for each in found], [flight], vehicle)]
    told += [replace(one, sentence=f"{one.sentence}; it is left out") for one in strong if not np.isfinite(one.found)]
    return signals, told


def _told(mistake: Mistake) -> Mistake:
    keep = " ".join(f"--as-recorded {name}" for name in mistake.signals)
    return replace(mistake, sentence=f"{mistake.sentence}; it was read so here ({keep} takes it as recorded)")


def _at(flight: FlightSignals, name: str, time_s: Array) -> Array:
    one = flight.signals[name]
    if one.time_s.size == time_s.size and np.array_equal(one.time_s, time_s):
        return one.values
    return np.interp(time_s, one.time_s, one.values, left=np.nan, right=np.nan)


def decisive_corrections(
    parts: Sequence[FlightData], layout: SensorLayout, as_recorded: Collection[str] = ()
) -> list[Correction]:
    """Mistakes of uniform parts without NaN in IMU, attitude and airspeed, the surest first.

    as_recorded: signals that are never taken for wrong.
    """
    # What the accelerometers' lever arm adds is small beside any mistake, and takes longer than all else.
    layout = replace(layout, accelerometer=(0.0, 0.0, 0.0))
    windows = [Window(half, layout) for part in longest(parts) for half in _halves(part)]
    columns = [{name: window.data[name] for name in known(window.data)} for window in windows]
    found: list[Correction] = []
    with np.errstate(all="ignore"):  # readings far from any motion overflow, and then win nothing
        while windows and len(found) < _MOST:
            before = _Misfit.of(windows, columns)
            mending = [
                one
                for one in _tried(windows, columns, before)
                if not set(as_recorded) & set(one.signals)
                and before.mended_by(_Misfit.of(windows, [one.apply(c) for c in columns]))
            ]
            if not mending:
                break
            likelier = discrete_readings(windows, columns, KinematicResiduals(windows, columns), mending)
            if not likelier:
                break
            best = _likeliest(windows, likelier)
            reading = next(one for one in mending if one.sentence == best.mistake.sentence)
            found.append(Correction(best.mistake, reading))
            columns = best.columns
    return found


def _likeliest(windows: Sequence[Window], likelier: Sequence[LikelyReading]) -> LikelyReading:
    """The likeliest, but of like units that which leaves least, and of a chip all axes if that harms none."""
    first = likelier[0].mistake

    def best_of(signals: Collection[str]) -> tuple[LikelyReading, _Misfit] | None:
        alike = [one for one in likelier if one.mistake.kind == first.kind and set(one.mistake.signals) == set(signals)]
        tried = [(one, _Misfit.of(windows, one.columns)) for one in alike]
        return min(tried, key=lambda entry: entry[1].total(), default=None)

    best = best_of(first.signals)
    assert best is not None
    for chip in (ACCEL, GYRO):
        wide = best_of(chip) if first.kind == "unit" and set(first.signals) < set(chip) else None
        if wide is not None and not best[1].harmed_by(wide[1]):
            best = wide
    return best[0]


def _halves(part: FlightData) -> tuple[FlightData, FlightData]:
    size = part.time_s.size
    return part.window(0, size // 2), part.window(size // 2, size)


def _tried(windows: Sequence[Window], columns: Sequence[Columns], before: _Misfit) -> Iterator[Hypothesis]:
    """Readings of signals that a failing relation or an impossible level puts in doubt."""
    failing = before.failing()
    doubted: set[str] = set(before.impossible())
    if failing & {"phi", "theta", "psi"}:
        doubted |= {*GYRO, *ATTITUDE}
    if failing & set(AIR):
        doubted |= {*IMU, *ATTITUDE, *VANES, "airspeed"}
    if failing & set(GROUND):
        doubted |= {*GROUND, *ACCEL, *ATTITUDE}
    if "force" in doubted:
        doubted |= {*ACCEL, *ATTITUDE[:2]}
    for one in hypotheses(set.union(*(set(c) for c in columns)), windows[0].layout.gravity):
        if doubted.issuperset(one.signals):
            yield one
    for name, rate in (("phi", "p"), ("theta", "q")):
        gain = before.gains[name]
        if name in failing and abs(gain - 1.0) > _GAIN and 1.0 / _LARGEST_GAIN < gain < _LARGEST_GAIN:
            yield scale_hypothesis((rate,), 1.0 / gain - 1.0)


@dataclass(frozen=True)
class _Misfit:
    """How badly the relations hold, in either half of the flight.

    shares: relation -> energy of measured less integrated over that of both, slow motions left out; 0 to 2. gains:
    relation -> measured over integrated, by least squares. levels: name of a level -> its size.
    """

    energies: dict[str, tuple[float, float]]
    shares: dict[str, tuple[float, float]]
    gains: dict[str, float]
    levels: dict[str, tuple[float, float]]

    @classmethod
    def of(cls, windows: Sequence[Window], columns: Sequence[Columns]) -> _Misfit:
        sums: dict[str, Array] = {}
        forces, angles = np.zeros((2, 3)), {name: ([0.0], [0.0]) for name in _ANGLES}
        for i, (window, one) in enumerate(zip(windows, columns, strict=True)):
            states, half = window.states(one, {}), i % 2
            measured, gaps = window.fast(window.measured(states, one)), window.gaps_of(states, one)
            for name, gap in gaps.items():
                told = measured[name]
                made = told - gap
                sums.setdefault(name, np.zeros((2, 4)))[half] += (gap @ gap, told @ told, made @ made, told @ made)
            forces[half] += window.level(states) * window.size
            for name, sizes in angles.items():
                if name in one:
                    sizes[half].append(_large(one[name]))
        lengths = np.maximum([sum(w.size for w in windows[half::2]) for half in (0, 1)], 1)
        energies = {name: _pair(s[:, 1] + s[:, 2]) for name, s in sums.items()}
        shares = {name: _pair(s[:, 0] / np.maximum(s[:, 1] + s[:, 2], 1e-300)) for name, s in sums.items()}
        gains = {name: float(s[:, 3].sum() / max(float(s[:, 2].sum()), 1e-300)) for name, s in sums.items()}
        levels = {name: (max(first), max(second)) for name, (first, second) in angles.items()}
        levels["force"] = _pair(np.linalg.norm(forces, axis=1) / lengths)
        return cls(energies, shares, gains, levels)

    def impossible(self) -> set[str]:
        """Levels that no flight has, in either half."""
        return {name for name, sizes in self.levels.items() if min(sizes) > _limits(name)[0]}

    def mended_by(self, after: _Misfit) -> bool:
        """Whether what fails here holds there, and nothing else fails there instead."""
        for name, sizes in after.levels.items():
            if max(sizes) > max(_limits(name)[1], *self.levels[name]) + 1e-6:
                return False
        if self.harmed_by(after):
            return False
        wrong = self.impossible()
        if any(max(after.levels[name]) < _limits(name)[1] for name in wrong):
            return True
        return any(
            all(
                a > _FAILS and b < _LEFT * a
                for a, b in ((self.shares[name][half], after.shares[name][half]) for half in self._moving(name))
            )
            for name in self.failing()
        )

    def harmed_by(self, after: _Misfit) -> bool:
        """Whether a relation that holds here does not there, or one that does not is far worse."""
        return any(
            b > max(a + _WORSE, _MUCH_WORSE if a > _FAILS else 0.0)
            for name, halves in after.shares.items()
            for a, b in zip(self.shares[name], halves, strict=True)
        )

    def failing(self) -> set[str]:
        """Relations that do not hold, in either half that moves."""
        return {
            name for name, halves in self.shares.items() if all(halves[half] > _FAILS for half in self._moving(name))
        }

    def total(self) -> float:
        """Sum of the shares."""
        return float(sum(sum(halves) for halves in self.shares.values()))

    def _moving(self, name: str) -> list[int]:
        energies = self.energies[name]
        return [half for half in (0, 1) if energies[half] >= _SAY * sum(energies)]


def _large(values: Array) -> float:
    """Size that 95 % of the values stay below; a selection, since a percentile interpolates for ten times as long."""
    place = int(0.95 * (values.size - 1))
    return float(np.partition(np.abs(values), place)[place])


def _limits(name: str) -> tuple[float, float]:
    return _FORCE if name == "force" else _ANGLES[name]


def _pair(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])
