"""Round trips by TIMESYNC (mavlink.io/en/services/timesync.html): the station asks, each vehicle answers.

A request carries tc1 = 0 and ts1 = the station's time; the reply carries ts1 back and the vehicle's time in tc1. Two
stations may ask the same vehicle, and a reply may go to both: the last three digits of ts1 show whose it is, now and
when a recording is read.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common

from gcs.clock.stamppass import LONGEST_NS, TAG_NS, TAG_PERIOD_NS

Times = NDArray[np.int64]

BEST_SHARE = 0.1
FEWEST_BEST = 3


def request(now_ns: int) -> Any:
    """pymavlink's TIMESYNC message that asks every vehicle of a link; now_ns: the station's UTC, ns."""
    return common.MAVLink_timesync_message(0, now_ns // TAG_PERIOD_NS * TAG_PERIOD_NS + TAG_NS)


def own_replies(log_ns: Times, tc1: Times, ts1: Times) -> NDArray[np.bool_]:
    """(N,) which TIMESYNC messages received at `log_ns` answer a request of this station."""
    way = log_ns - ts1
    return np.asarray((tc1 != 0) & (ts1 % TAG_PERIOD_NS == TAG_NS) & (way >= 0) & (way < LONGEST_NS))


class RoundTrips:
    """N >= 1 round trips: log_ns, tc1, ts1: (N,) reception, the vehicle's time, the request's sending, ns."""

    def __init__(self, log_ns: Times, tc1: Times, ts1: Times, drift: float = 0.0) -> None:
        taken = (log_ns - ts1).astype(np.float64) / 1e9
        order = np.argsort(taken, kind="stable")
        best = order[: max(FEWEST_BEST, round(BEST_SHARE * order.size))]
        middle = ts1 + (log_ns - ts1) // 2
        base = int(middle[best[0]] - tc1[best[0]])
        self.at_ns = int(np.median(tc1[best]))
        # Offsets of the quickest trips, moved along the drift to one moment.
        moved = (middle - tc1 - base)[best].astype(np.float64) - drift * (tc1[best] - self.at_ns).astype(np.float64)
        self._offset_ns = base + round(float(np.median(moved)))
        self._beside_quickest_s = abs(float(np.median(moved) - moved[0])) / 1e9
        self.count = int(order.size)
        self.smallest_s = float(taken[best[0]])
        self.median_s = float(np.median(taken))
        self._drift = drift
        spread = 1.4826 * float(np.median(np.abs(moved - np.median(moved)))) / 1e9
        # What the quickest trips scatter, and what a lopsided wait of each may add.
        wait = 0.5 * float(taken[best].mean() - taken[best[0]])
        self.offset_std_s = 1.2533 * float(np.hypot(spread, wait)) / best.size**0.5

    def offset_ns(self, vehicle_ns: int) -> int:
        """The station's clock less the vehicle's at a vehicle's time, both directions taking the same time."""
        return self._offset_ns + round(self._drift * (vehicle_ns - self.at_ns))

    @property
    def delay_s(self) -> float:
        """One way at the smallest round trip, s."""
        return 0.5 * self.smallest_s

    @property
    def asymmetry_s(self) -> float:
        """By how much the offset may be wrong at most, s.

        The truth is within half the smallest round trip of that trip's middle, wherever the time was spent.
        """
        return 0.5 * self.smallest_s + self._beside_quickest_s
