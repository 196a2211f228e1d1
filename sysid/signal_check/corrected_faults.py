"""Mistakes in signals that no owner would doubt, and the flight as it reads without them.

A reading of the data (sysid.signal_check.fault_hypotheses) is decisive where the kinematic relations do not hold as
recorded and do as corrected, in either half of the flight by itself (sysid.signal_check.relation_misfit). What is less
than that stays as recorded: noise, lags and gusts make a wrong reading likelier than the right one by any likelihood
that does not know them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import SignalError
from sysid.signal_check.fault import Mistake
from sysid.signal_check.fault_hypotheses import SI, Hypothesis, hypotheses, scale_hypothesis
from sysid.signal_check.impossible_values import impossible_thrust, require_possible_density
from sysid.signal_check.kinematic_relations import AIR, GROUND, Columns, Window
from sysid.signal_check.relation_misfit import OVER_GROUND, ForceBalance, Misfit
from sysid.signal_check.remedies import named_cures
from sysid.signal_check.reported_faults import TURNS, uncorrected_mistakes
from sysid.signals.flight import FlightData, FlightSignals
from sysid.signals.preparation import Prepared
from sysid.signals.sensor_groups import ACCEL, ATTITUDE, GROUPS, GYRO, IMU, VANES
from sysid.signals.sensor_mounting import SensorMounting

# A gain of a gyro counts from this error on, and up to a factor that is rather a unit.
_GAIN, _LARGEST_GAIN = 0.2, 20.0
_MOST = 4
# What a reading must leave less of than a simpler one, in shares, a unit of its penalty.
_SIMPLER = 0.02
_FEWEST = 100  # samples of a part
_LONGEST_S = 60.0
_SPEEDS = frozenset((*GROUND, "airspeed"))
# Two units are distinguished where one leaves so many times the other's misfit.
_DISTINGUISHED = 1.15


@dataclass(frozen=True)
class Correction:
    """A mistake and the reading of the signals that is free of it. others: readings that are as likely."""

    mistake: Mistake
    reading: Hypothesis
    others: tuple[Hypothesis, ...] = ()

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


def repaired(
    signals: FlightSignals, flight: Prepared, vehicle: Vehicle, as_recorded: Collection[str] = ()
) -> tuple[FlightSignals, list[Mistake]]:
    """A flight without the mistakes that no owner would doubt, and what they are.

    flight: the signals prepared. as_recorded: signals that are never considered wrong, beside those of the vehicle
    file. Raises SignalError where the density of the air is one that no air has, and for a name of no signal.
    """
    kept = {*as_recorded, *vehicle.as_recorded}
    require_searched(kept)
    require_possible_density(flight)
    # Where an accelerometer or a gyro is missing, no relation of the motion can be held against the other sensors.
    whole = set(IMU) <= signals.signals.keys()
    parts = [one.data for one in flight.stretches] if whole else []
    found, uncorrected = decisive_corrections(parts, flight.layout, kept)
    strong = None if "thrust" in kept else impossible_thrust(flight, vehicle)
    if strong is not None and np.isfinite(strong.found):
        reading = Hypothesis(("thrust",), "unit", strong.sentence, np.full((1, 1), strong.found))
        found.append(Correction(strong, reading))
    for one in found:
        if one.others:
            _require_one_unit(one)
        signals = one.apply(signals)
    cured = named_cures([each.mistake for each in found], flight, vehicle)
    reported = [_reported(one, each.others) for one, each in zip(cured, found, strict=True)]
    if strong is not None and not np.isfinite(strong.found):
        signals = replace(signals, signals={n: one for n, one in signals.signals.items() if n != "thrust"})
        reported.append(replace(strong, sentence=f"{strong.sentence}; it is left out"))
    return signals, [*reported, *uncorrected]


def _require_one_unit(found: Correction) -> None:
    """Raise SignalError for an airspeed whose unit decides on every coefficient and stays in doubt."""
    every = [found.reading, *found.others]
    if found.reading.signals == ("airspeed",):
        units, factors = (" or ".join(words) for words in ([o.unit for o in every], [f"{o.factor:.4g}" for o in every]))
        raise SignalError(
            f"airspeed is not in m/s: it looks like {units}, which this flight does not distinguish: scale it by"
            f" {factors} in [signals] of the vehicle file (--as-recorded airspeed takes it as recorded)"
        )


def _reported(mistake: Mistake, others: Sequence[Hypothesis]) -> Mistake:
    doubt = f" (or {' or '.join(one.unit for one in others)}: this flight does not distinguish them)" if others else ""
    keep = " ".join(f"--as-recorded {name}" for name in mistake.signals)
    return replace(mistake, sentence=f"{mistake.sentence}{doubt}; it was read so here ({keep} takes it as recorded)")


def _at(flight: FlightSignals, name: str, time_s: Array) -> Array:
    one = flight.signals[name]
    if one.time_s.size == time_s.size and np.array_equal(one.time_s, time_s):
        return one.values
    return np.interp(time_s, one.time_s, one.values, left=np.nan, right=np.nan)


def decisive_corrections(
    parts: Sequence[FlightData], layout: SensorMounting, as_recorded: Collection[str] = ()
) -> tuple[list[Correction], list[Mistake]]:
    """Mistakes of uniform parts without NaN in IMU, attitude and airspeed, the surest first; and those of which it is
    not sure whose they are, which nothing mends.

    as_recorded: signals that are never considered wrong.
    """
    # What the accelerometers' lever arm adds is small beside any mistake, and takes longer than all else.
    layout = replace(layout, accelerometer=(0.0, 0.0, 0.0))
    windows = [Window(half, layout) for part in _longest(parts) for half in _halves(part)]
    columns = [{name: window.data[name] for name in _examined(window.data)} for window in windows]
    found: list[Correction] = []
    uncorrected: list[Mistake] = []
    with np.errstate(all="ignore"):  # readings far from any motion overflow, and then win nothing
        while windows and len(found) < _MOST:
            before, forces = Misfit.of(windows, columns), ForceBalance(windows, columns)
            tried = [
                (one, Misfit.of(windows, [one.apply(c) for c in columns]))
                for one in _tried(windows, columns, before, forces)
                if not set(as_recorded) & set(one.signals)
            ]
            mending = [
                (one, after)
                for one, after in tried
                if before.mended_by(after, forces.asks_for(one)) and not _silenced(one, after)
            ]
            if not mending:
                uncorrected = uncorrected_mistakes(before, windows, columns, as_recorded)
                break
            best = _best(mending)
            found.append(Correction(best.as_mistake(), best, _as_likely(best, tried)))
            columns = [best.apply(c) for c in columns]
    return found, uncorrected


def _silenced(one: Hypothesis, after: Misfit) -> bool:
    """Whether a reading makes a rate so small that the attitude it is the rate of moves without it: what a rate that
    is late spoils holds better without any rate, too.
    """
    return any(rate in one.signals and turn in after.shares and after.silences(turn) for turn, rate in TURNS)


def _best(mending: Sequence[tuple[Hypothesis, Misfit]]) -> Hypothesis:
    """The reading that leaves least, and where that is a unit all axes of its chip if that harms none."""
    best, left = min(mending, key=lambda entry: entry[1].total() + _SIMPLER * entry[0].penalty)
    for chip in (ACCEL, GYRO, GROUND):
        if best.kind == "unit" and set(best.signals) < set(chip):
            wide = [(o, m) for o, m in mending if o.kind == "unit" and o.signals == chip and not left.harmed_by(m)]
            best, left = min(wide, key=lambda entry: entry[1].total(), default=(best, left))
    if best.kind == "unit" and set(best.signals) <= _SPEEDS:
        alike = [(o, m) for o, m in mending if o.kind == "unit" and o.signals == best.signals]
        best, _ = min(alike, key=lambda entry: entry[1].of_speed(best.signals))
    return best


def _as_likely(best: Hypothesis, tried: Sequence[tuple[Hypothesis, Misfit]]) -> tuple[Hypothesis, ...]:
    """Other units of the same signals that the flight does not distinguish from the best."""
    if best.kind != "unit" or not set(best.signals) <= _SPEEDS:
        return ()
    alike = [(one, m.of_speed(best.signals)) for one, m in tried if one.kind == "unit" and one.signals == best.signals]
    least = _DISTINGUISHED * next(left for one, left in alike if one is best)
    return tuple(one for one, left in alike if one is not best and left < least)


def _halves(part: FlightData) -> tuple[FlightData, FlightData]:
    size = part.time_s.size
    return part.window(0, size // 2), part.window(size // 2, size)


def _tried(
    windows: Sequence[Window], columns: Sequence[Columns], before: Misfit, forces: ForceBalance
) -> Iterator[Hypothesis]:
    """Readings of signals that a failing relation or an impossible level puts in doubt."""
    failing = before.failing()
    doubted: set[str] = set(before.impossible())
    if failing & set(ATTITUDE):
        doubted |= {*GYRO, *ATTITUDE, *(ACCEL if failing & {*AIR, *GROUND} else ())}
    if failing & set(AIR):
        doubted |= {*VANES, "airspeed", *(() if windows[0].has_psi else ("r",))}
    if failing & set(GROUND):
        doubted |= {*GROUND, *(() if windows[0].air else ACCEL)}
    if failing & set(OVER_GROUND):
        doubted |= {*GROUND, "airspeed", "psi"}
    if "lift" in doubted:
        doubted |= {*VANES}
    if "force" in doubted:
        doubted |= {*ACCEL, *ATTITUDE[:2]}
    for one in hypotheses(set.union(*(set(c) for c in columns)), windows[0].layout.gravity):
        if doubted.issuperset(one.signals) or forces.asks_for(one):
            yield one
    for name, rate in TURNS[:2]:
        gain = before.gain(name)
        if name in failing and abs(gain - 1.0) > _GAIN and 1.0 / _LARGEST_GAIN < gain < _LARGEST_GAIN:
            yield scale_hypothesis((rate,), 1.0 / gain - 1.0)


def _longest(parts: Sequence[FlightData]) -> list[FlightData]:
    """The longest parts, together at most some minutes: more of the same adds nothing new."""
    kept: list[FlightData] = []
    total = 0.0
    for part in sorted(map(_whole, parts), key=lambda one: -one.time_s.size):
        if part.time_s.size < _FEWEST or (kept and total > 2.0 * _LONGEST_S):
            break
        kept.append(part)
        total += part.time_s.size * part.interval_s
    return kept


def _whole(part: FlightData) -> FlightData:
    """The longest run in which vanes and heading, where they are there at all, carry values."""
    good = np.ones(part.time_s.size, dtype=np.bool_)
    for name in (*VANES, "psi"):
        if name in part and np.isfinite(part[name]).mean() > 0.5:
            good &= np.isfinite(part[name])
    edges = np.concatenate(([-1], np.flatnonzero(~good), [good.size]))
    run = int(np.argmax(np.diff(edges)))
    return part.window(int(edges[run]) + 1, int(edges[run + 1]))


def _examined(part: FlightData) -> list[str]:
    """Signals that are examined and carry values."""
    names = [name for group in GROUPS.values() for name in group]
    return [name for name in dict.fromkeys(names) if name in part and np.isfinite(part[name]).any()]
