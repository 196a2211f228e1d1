"""How the vehicles' clocks ran during a recording, for `gcs info`."""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs.clock.fit import NS_PER_S, fit_clock
from gcs.clock.stamps import Stamps, longest_run, restarts
from gcs.clock.timesync import RoundTrips, own_replies
from gcs.clock.track import is_real_time, rate_text
from gcs.flights.streams import Columns, ColumnSource, Stream
from gcs.text.utctext import utc_text

_SHORTEST_S = 10.0
Sender = tuple[int, int]


def clocks(recording: ColumnSource) -> list[dict[str, Any]]:
    """One entry, ready for JSON, per component that sends ATTITUDE, which comes often, or else SYSTEM_TIME.

    It describes the longest run between two restarts of the clock. `offset_s`: this computer's UTC less the time since
    boot, in the middle of that run; `delays`: s beyond the smallest, or typical, one that the offset contains.
    """
    utc = _by_sender(recording, "SYSTEM_TIME")
    timed = {**utc, **_by_sender(recording, "ATTITUDE")}
    replies = _by_sender(recording, "TIMESYNC")
    found = []
    for sender, columns in sorted(timed.items()):
        stamps = Stream(columns.name, columns.component, columns.log_time, columns.fields).stamps
        if not stamps.valid.any():
            continue
        knows_utc = sender in utc and bool(np.any(utc[sender].fields["time_unix_usec"] > 0))
        identity = {"system": columns.system, "component": columns.component}
        found.append({**identity, **_describe(_since_boot(stamps), replies.get(sender)), "knows_utc": knows_utc})
    return found


def _by_sender(recording: ColumnSource, message: str) -> dict[Sender, Columns]:
    return {(c.system, c.component): c for c in recording.columns(message) if c.fields.size}


def _since_boot(stamps: Stamps) -> Stamps:
    keep = stamps.valid
    return Stamps(stamps.message, stamps.component, stamps.log_ns[keep], stamps.raw_ns[keep], stamps.period_ns)


def _describe(stamps: Stamps, replies: Columns | None) -> dict[str, Any]:
    first, last = longest_run([stamps], [])
    inside = (stamps.log_ns >= first) & (stamps.log_ns <= last)
    fit = fit_clock(stamps.log_ns[inside], stamps.raw_ns[inside])
    span_s = float(np.ptp(stamps.log_ns[inside])) / NS_PER_S
    rate = 1.0 / (1.0 + fit.drift) if span_s >= _SHORTEST_S and fit.drift > -1.0 else None
    drifts = rate is not None and is_real_time(rate)
    offset, std, trips = fit.offset_ns, fit.offset_std_s, None
    if replies is not None:
        trips = _round_trips(replies, first, last, fit.drift)
        if trips is not None:
            offset, std = trips.offset_ns(fit.origin_ns), trips.offset_std_s
    return {
        "boot_utc": utc_text(offset - round(fit.drift * fit.origin_ns)),
        "rate": rate,
        "drift_ppm": (rate - 1.0) * 1e6 if drifts and rate is not None else None,
        "drift_std_ppm": _finite(fit.drift_std * 1e6) if drifts else None,
        "offset_s": offset / NS_PER_S,
        "offset_std_s": _finite(std),
        "offset_bound_s": trips.asymmetry_s if trips else None,
        "round_trip_s": trips.median_s if trips else None,
        "delay_s": trips.delay_s if trips else None,
        "delays": {"beyond": fit.anchor, "median_s": fit.delays.median_s, "q95_s": fit.delays.q95_s},
        "resets": int(restarts(stamps).size),
    }


def _round_trips(replies: Columns, first: int, last: int, drift: float) -> RoundTrips | None:
    log, tc1, ts1 = replies.log_time, replies.fields["tc1"], replies.fields["ts1"]
    use = own_replies(log, tc1, ts1) & (log >= first) & (log <= last)
    return RoundTrips(log[use], tc1[use], ts1[use], drift) if use.any() else None


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def clock_text(clock: dict[str, Any]) -> str:
    """One line for a terminal."""
    parts = [
        f"clock of system {clock['system']}: started {clock['boot_utc']}",
        rate_text(clock["rate"], clock["drift_ppm"], clock["drift_std_ppm"]),
        "" if clock["round_trip_s"] is None else f"round trip {clock['round_trip_s'] * 1e3:.1f} ms",
        "" if not clock["resets"] else f"restarted {clock['resets']} times",
        "" if clock["knows_utc"] else "it does not know UTC",
    ]
    return ", ".join(part for part in parts if part)
