"""Signals put right in time: what the delays found mean for the data, and the flights prepared anew with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.numerics.fractional_delay import read_later
from sysid.signals.flight import FlightData
from sysid.signals.preparation import Prepared, Stretch
from sysid.signals.record import make_records
from sysid.signals.sensor_groups import GROUND, GROUPS, joined


@dataclass(frozen=True)
class Delay:
    """How late some signals are.

    signals: which. value, std: s; positive where they come late.
    """

    signals: tuple[str, ...]
    value: float
    std: float

    @property
    def name(self) -> str:
        """Name of the group, or of the signal."""
        for group, names in GROUPS.items():
            if set(self.signals) <= set(names) and (len(self.signals) > 1 or len(names) == 1):
                return group
        return joined(self.signals)


def in_time(data: FlightData, delays: Sequence[Delay]) -> FlightData:
    """The flight with its late signals put where they belong; sparse GPS samples move to the nearest sample."""
    columns = dict(data.columns)
    for delay in delays:
        for name in delay.signals:
            if name not in columns:
                continue
            if name in GROUND:
                columns[name] = _moved(columns[name], round(delay.value / data.interval_s))
            else:
                columns[name] = read_later(columns[name], delay.value, data.interval_s)
    return replace(data, columns=columns)


def _moved(values: Array, samples: int) -> Array:
    """(N,) sparse samples moved earlier by whole samples, NaN where nothing comes from."""
    moved = np.full(values.size, np.nan)
    source = slice(max(samples, 0), min(values.size, values.size + samples))
    moved[source.start - samples : source.stop - samples] = values[source]
    return moved


def prepared_in_time(prepared: Sequence[Prepared], vehicle: Vehicle, delays: Sequence[Delay]) -> list[Prepared]:
    """Flights with their late signals put where they belong, in the same stretches."""
    if not delays:
        return list(prepared)
    found = []
    for flight in prepared:
        data = in_time(flight.data, delays)
        starts = [stretch.data.time_s[0] - 0.5 * data.interval_s for stretch in flight.stretches]
        begins = np.searchsorted(data.time_s, starts).tolist()
        spans = [(begin, begin + one.data.time_s.size) for begin, one in zip(begins, flight.stretches, strict=True)]
        records = make_records(data, vehicle, spans)
        stretches = [
            Stretch(stretch.segment, data.window(*span), record)
            for stretch, span, record in zip(flight.stretches, spans, records, strict=True)
        ]
        found.append(replace(flight, data=data, stretches=tuple(stretches)))
    return found


def delay_sentence(delay: Delay, corrected: bool = True) -> str:
    """What is said of a delay in one line."""
    done = "corrected" if corrected else "left as it is, since a lag may be the missing effect"
    size = f"{abs(delay.value) * 1e3:.1f} ± {delay.std * 1e3:.1f} ms"
    verb = "comes" if len(delay.signals) == 1 else "come"
    way = "late" if delay.value > 0.0 else "early"
    return f"{joined(delay.signals)} {verb} {size} {way} against the other signals: {done}"
