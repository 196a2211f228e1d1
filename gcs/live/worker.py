"""The live process: bytes on standard input, what is known of the flight as JSON lines on standard output.

It ends when its input does. Nothing here can hold the recorder: the pipe is filled from a queue that drops what does
not fit (`gcs.live.feed`).
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time

from gcs.errors import GcsError
from gcs.links.datagrams import Batch
from gcs.live.estimates import EstimateReports
from gcs.live.messages import VehicleMessages
from gcs.live.protocol import Unpacker
from gcs.live.signals import Samples, SignalStream
from gcs.mavlink.dialect import Dialect
from gcs.text.jsontext import dumps
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.vehicle import Vehicle, load_vehicle
from sysid.errors import SysidError

NICENESS = 5
_READ_BYTES = 1 << 20
_WAIT_S = 0.1
# Messages of the same instant come in several datagrams: a short pause lets them be taken together.
_GATHER_S = 0.008
_SIGNALS_S = 0.1


def tell(kind: str, **fields: object) -> None:
    """One line for the service."""
    print(dumps({"kind": kind, **fields}), flush=True)


class LiveProcess:
    """What the process holds of one vehicle. Times of `now_s` are monotonic."""

    def __init__(self, dialect: Dialect, vehicle: Vehicle | None) -> None:
        self._signals_of = vehicle or Vehicle.unknown()
        self._signals = SignalStream(self._signals_of)
        self._messages = VehicleMessages(dialect, self._signals.messages)
        self._flight = ""
        self._newest: dict[str, tuple[float, int]] = {}
        self._told_s = -1.0
        self._fresh = False
        self._estimates = None if vehicle is None else EstimateReports(vehicle)

    def take(self, record: Batch | str) -> None:
        """A batch of a link, or the id of the flight that is recorded now."""
        if isinstance(record, str):
            if self._flight and record != self._flight:
                self._restart()
            self._flight = record
            return
        streams = self._messages.take(record)
        if not streams:
            return
        samples = self._signals.take(streams, self._messages.autopilot)
        self._keep(samples, int(record.received_ns[-1]))

    def _restart(self) -> None:
        self._messages.restart()
        self._signals = SignalStream(self._signals_of)
        self._newest = {}
        if self._estimates is not None:
            self._estimates = EstimateReports(self._signals_of)

    def _keep(self, samples: dict[str, Samples], received_ns: int) -> None:
        for name, found in samples.items():
            self._newest[name] = (float(found.values[-1]), received_ns)
        self._fresh = True
        if self._estimates is not None:
            self._estimates.take(samples, received_ns)

    def report(self, now_s: float) -> None:
        """Tell what is due."""
        if self._fresh and now_s - self._told_s >= _SIGNALS_S:
            self._told_s, self._fresh = now_s, False
            known = {
                name: [value, received_ns, self._signals.unit(name)]
                for name, (value, received_ns) in self._newest.items()
            }
            tell("signals", time_s=self._messages.newest_s, system=self._messages.system, signals=known)
        report = None if self._estimates is None else self._estimates.due(now_s)
        if report is not None:
            tell("estimate", identification=report)


def run(live: LiveProcess) -> None:
    """Work until standard input ends."""
    unpacker = Unpacker()
    while True:
        ready, _, _ = select.select([0], [], [], _WAIT_S)
        if ready:
            data = os.read(0, _READ_BYTES)
            if not data:
                return
            for record in unpacker.feed(data):
                live.take(record)
        live.report(time.monotonic())
        time.sleep(_GATHER_S)


def main(arguments: list[str]) -> int:
    """arguments: the dialect, and the vehicle file or "". Exit code 1 for a named error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the end of the input tells when to stop
    os.nice(NICENESS)
    dialect, vehicle = arguments
    try:
        live = LiveProcess(Dialect.load(dialect), load_vehicle(vehicle) if vehicle else None)
        tell("ready")
        run(live)
    except (GcsError, SysidError, SimVehicleError) as error:
        tell("error", text=str(error))
        return 1
    except BrokenPipeError:
        return 0
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
