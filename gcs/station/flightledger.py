"""What becomes of flights that have ended: recordings completed, the catalogue updated, in a thread of its own.

Completing a file waits for the disk, and so does the catalogue; reception of other vehicles must not.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gcs.catalogue.flight_duration import vehicle_seconds
from gcs.catalogue.flight_table import Flight
from gcs.catalogue.store import Catalogue
from gcs.recording.parts import Metadata
from gcs.station.liveflight import LiveFlight

_log = logging.getLogger(__name__)

_RETRY_S = 1.0


@dataclass(frozen=True)
class _Ended:
    """A flight whose file is to be completed. ending: gives metadata of what is known only at the end."""

    live: LiveFlight
    reason: str
    ending: Callable[[], Metadata]


class FlightLedger:
    """Completes recordings and lists flights, in the order in which they are given.

    on_flight_end: called with each flight that has ended, after it is in the catalogue. failed: called with what went
    wrong. lost: called with the bytes of a flight that its disk did not take. All three by the ledger's thread.
    """

    def __init__(
        self,
        catalogue: Catalogue,
        on_flight_end: Callable[[Flight], None],
        failed: Callable[[Exception], None],
        lost: Callable[[int], None],
    ) -> None:
        self._catalogue = catalogue
        self._on_flight_end = on_flight_end
        self._failed = failed
        self._lost = lost
        self._unlisted: dict[str, Flight] = {}
        self._orders: deque[Flight | _Ended] = deque()
        self._changed = threading.Condition()
        self._busy = False
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="flights", daemon=True)

    def put(self, flight: Flight) -> None:
        """Have the catalogue know how a flight stands; returns at once."""
        self._order(flight)

    def end(self, live: LiveFlight, reason: str, ending: Callable[[], Metadata]) -> None:
        """Have a recording completed and listed; returns at once. Nothing may be written to it any more.

        ending: called by the ledger's thread for the metadata of what is known only at the end.
        """
        self._order(_Ended(live, reason, ending))

    def settle(self) -> None:
        """Wait until all that was ordered has been done, or tried where the catalogue refuses."""
        with self._changed:
            self._changed.wait_for(lambda: not self._orders and not self._busy)

    def close(self) -> None:
        """Do what is left, then end the thread."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        if self._thread.ident is not None:
            self._thread.join()

    def _order(self, order: Flight | _Ended) -> None:
        with self._changed:
            if self._thread.ident is None:
                self._thread.start()
            self._orders.append(order)
            self._changed.notify_all()

    def _run(self) -> None:
        closed = False
        while not closed:
            with self._changed:
                wait_s = _RETRY_S if self._unlisted else None
                self._changed.wait_for(lambda: bool(self._orders) or self._closing, wait_s)
                closed = self._closing and not self._orders
                order = self._orders.popleft() if self._orders else None
                self._busy = True
            try:
                if isinstance(order, _Ended):
                    self._complete(order)
                elif order is not None:
                    self._unlisted[order.id] = order
                self._list()
            except Exception as error:
                self._failed(error)
            with self._changed:
                self._busy = False
                self._changed.notify_all()

    def _complete(self, ended: _Ended) -> None:
        live, reason = ended.live, ended.reason
        try:
            live.writer.close(ended.ending())
        except Exception as error:
            self._failed(error)
            reason = f"{reason}; the end is missing: {error}"
        lost = live.writer.lost.bytes
        if lost:
            self._lost(lost)
        if lost and live.writer.counts.bytes == lost:
            self._forget(live)
            return
        entry = live.entry("complete", reason)
        self._unlisted[live.id] = replace(entry, vehicle_s=self._vehicle_seconds(live.writer.parts, entry.system))
        _log.info("flight %s ends (%s)", live.id, reason)

    def _vehicle_seconds(self, paths: Sequence[Path], system: int | None) -> float | None:
        """A flight whose length is not known is listed all the same."""
        try:
            return vehicle_seconds(paths, system)
        except Exception as error:
            self._failed(error)
            return None

    def _forget(self, live: LiveFlight) -> None:
        """A flight of which the disk took nothing is none."""
        self._unlisted.pop(live.id, None)
        for path in live.writer.parts:
            path.unlink(missing_ok=True)
        self._catalogue.remove_flight(live.id)

    def _list(self) -> None:
        """Put flights into the catalogue; what it cannot take now, it is given again in a while."""
        for flight in list(self._unlisted.values()):
            self._catalogue.put_flight(flight)
            del self._unlisted[flight.id]
            if flight.state != "recording":
                self._on_flight_end(flight)
