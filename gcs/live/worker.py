"""The live process: bytes on standard input, what is known of the flight as JSON lines on standard output.

It ends when its input does. Nothing here can hold the recorder: the pipe is filled from a queue that drops what does
not fit (`gcs.live.feed`).
"""

from __future__ import annotations

import math
import os
import select
import signal
import sys
import time
from collections.abc import Sequence

import numpy as np

from gcs import portable
from gcs.errors import GcsError, in_words
from gcs.links.datagrams import Batch
from gcs.live.estimate_reports import EstimateReports
from gcs.live.messages import VehicleMessages
from gcs.live.protocol import Flight, Unpacker
from gcs.live.second_process import SecondProcess
from gcs.live.signals import Samples, SignalStream
from gcs.live.vehicle_status import MESSAGES as STATUS_MESSAGES
from gcs.live.vehicle_status import VehicleStatus
from gcs.live.vehiclefile import WatchedVehicle
from gcs.mavlink.dialect import Dialect
from gcs.text.jsontext import dumps
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.errors import SysidError
from sysid.live.identifier import LiveIdentifier
from sysid.live.posterior_window import warm_up
from sysid.numerics.threads import one_thread

# The recorder comes first where both want the processor.
_NICENESS = 5
_READ_BYTES = 1 << 20
# Messages are taken together: taking one costs hardly less than taking all of a turn. A turn begins as soon as
# something has come, but so long after the one before, or longer where that takes less than a share of one core: at
# most half a second.
_TURN_S = 0.04
_CORE_SHARE = 0.09
_LONGEST_TURN_S = 0.5
_COST_MEMORY = 0.05  # of a turn in the mean of what turns cost
# What nobody reads faster is sent no faster.
_SIGNALS_S = 0.1
_STATUS_S = 0.5
_MOST_SAMPLES = 5  # of a signal in one report: fifty a second
_SLACK_S = 0.02
_SILENT_S = 0.5
# A vehicle that was silent for longer may have been switched off, and its file edited meanwhile. One without a file
# that can be used has nothing to lose by another look.
_AWAY_NS = 2_000_000_000
# Bytes of one turn, beyond which it reports what it knows before it goes on.
_MOST_BYTES = 4 << 20
# Of what bytes can make of arithmetic: a turn is lost, not the process with all its estimates. Each is reported once.
_FAULTS = (ArithmeticError, ValueError)
_MOST_FAULTS = 100


def send(kind: str, **fields: object) -> None:
    """One line for the service."""
    print(dumps({"kind": kind, **fields}), flush=True)


class LiveProcess:
    """What the process holds of one vehicle. Times of `now_s` are monotonic. second: runs what takes longer."""

    def __init__(self, dialect: Dialect, file: WatchedVehicle | None, second: SecondProcess | None = None) -> None:
        self._file, self._second = file, second
        self._first, self._files = file, dict[str, WatchedVehicle]()
        vehicle = None if file is None else file.vehicle
        self._signals = SignalStream(vehicle or Vehicle.unknown())
        self._messages = VehicleMessages(dialect, self._wanted())
        self._status, self._status_sent, self._status_s = VehicleStatus(), 0, 0.0
        self._flight = Flight()
        self._newest: dict[str, tuple[float, int]] = {}
        self._recent: dict[str, list[Samples]] = {}
        self._fresh, self._anew, self._over = False, True, False
        self._taken = self._sent = 0
        self._sent_s = 0.0
        self._heard_ns = self._looked_ns = 0
        self._estimates = None if vehicle is None else EstimateReports(vehicle, second)

    def take(self, records: Sequence[Batch | Flight]) -> None:
        """Batches of links, and the flight that is followed from there on."""
        waiting: list[Batch] = []
        for record in records:
            if isinstance(record, Batch):
                waiting.append(record)
                continue
            self._take(waiting)
            waiting = []
            self._follow(record)
        self._take(waiting)

    def _follow(self, flight: Flight) -> None:
        """Go by this flight and its vehicle alone."""
        if flight.id:
            self._go_by(flight.vehicle)
        begun = bool(flight.id) and flight.id != self._flight.id
        ended = bool(self._flight.id) and flight.id != self._flight.id
        if not self._messages.bind(flight.system) or ended:
            # What is known of the flight, and still being estimated, stands until another vehicle or flight gives some.
            self._messages.restart()
            self._over, self._fresh = True, False
        if begun:
            self._forget()
            self._look()
        self._flight = flight

    def _go_by(self, vehicle: str) -> None:
        """Estimate by this vehicle file from here on, "" meaning the one that was given at the start."""
        if vehicle and vehicle not in self._files:
            self._files[vehicle] = WatchedVehicle(vehicle)
        file = self._files[vehicle] if vehicle else self._first
        if file is self._file:
            return
        self._file = file
        self._begin()
        if self._second is not None and file is not None and file.vehicle is not None:
            self._second.submit(warm_up, file.vehicle)
        send("vehicle", **_vehicle_fields(file))

    def _take(self, batches: Sequence[Batch]) -> None:
        self._taken += len(batches)
        before_s = self._messages.newest_s
        streams = self._messages.take(batches)
        if streams:
            self._forget()
            if before_s is not None and (self._messages.newest_s or 0.0) < before_s:
                self._begin()  # the vehicle was switched on again: what was estimated knows nothing of its new clock
            newest_ns = max(int(batch.received_ns[-1]) for batch in batches)
            bad = self._file is not None and self._file.vehicle is None
            if newest_ns - (self._looked_ns if bad else self._heard_ns) > _AWAY_NS:
                self._looked_ns = newest_ns
                self._look()
            self._heard_ns = newest_ns
            samples = self._signals.take(streams, self._messages.autopilot)
            self._keep(samples, newest_ns)
            self._status.take(streams)
            if self._estimates is not None:
                time_s = np.concatenate([stream.time_s for stream in streams])
                self._estimates.take(samples, time_s, np.concatenate([stream.log_ns for stream in streams]))

    def _forget(self) -> None:
        """Begin anew where a flight is over."""
        if not self._over:
            return
        self._over = False
        self._status = VehicleStatus()
        if self._file is not None:
            self._file.end_flight()
        self._begin()

    def _begin(self) -> None:
        """Signals and estimates anew, by the vehicle file as it was read last."""
        self._anew = True
        vehicle = None if self._file is None else self._file.vehicle
        self._signals = SignalStream(vehicle or Vehicle.unknown())
        self._messages.want(self._wanted())
        self._newest, self._recent = {}, {}
        self._estimates = None if vehicle is None else EstimateReports(vehicle, self._second)

    def _wanted(self) -> list[str]:
        return [*self._signals.messages, *STATUS_MESSAGES]

    def _look(self) -> None:
        """Whether the vehicle file is still the one that these estimates go by."""
        if self._file is None:
            return
        before = self._file.notes
        if self._file.look():
            self._begin()
        if self._file.notes != before:
            send("vehicle", **_vehicle_fields(self._file))

    def _thinned(self) -> dict[str, tuple[list[float], list[float]]]:
        """Times and values of each signal since the last report, as many as a plot shows."""
        found = {}
        for name, parts in self._recent.items():
            times, values = (np.concatenate([getattr(part, key) for part in parts]) for key in ("time_s", "values"))
            step = max(1, math.ceil(times.size / _MOST_SAMPLES))
            # From the newest back, so that it is there.
            kept = slice((times.size - 1) % step, None, step)
            found[name] = ([round(one, 3) for one in times[kept].tolist()],
                           [float(f"{one:.5g}") for one in values[kept].tolist()])  # fmt: skip
        self._recent = {}
        return found

    def _keep(self, samples: dict[str, Samples], received_ns: int) -> None:
        for name, found in samples.items():
            self._newest[name] = (float(found.values[-1]), received_ns)
            self._recent.setdefault(name, []).append(found)
        self._fresh = True

    def report(self, now_s: float) -> None:
        """Send what is due."""
        if self._fresh and (self._anew or now_s - self._sent_s >= _SIGNALS_S - _SLACK_S):
            if self._anew:
                send("begin")  # with the first that is new: what is known of a flight stands until another begins
            self._fresh = self._anew = False
            known = {
                name: [value, received_ns, self._signals.unit(name)]
                for name, (value, received_ns) in self._newest.items()
            }
            state = {"time_s": self._messages.newest_s, "system": self._messages.system, "signals": known,
                    "flight": self._flight.id or None}  # fmt: skip
            send("signals", taken=self._taken, recent=self._thinned(), **state)
            self._sent, self._sent_s = self._taken, now_s
        elif self._taken != self._sent and now_s - self._sent_s > _SILENT_S:
            # What comes is not the vehicle's: that is how the service knows that the vehicle has fallen silent.
            send("taken", taken=self._taken)
            self._sent, self._sent_s = self._taken, now_s
        if self._status.number != self._status_sent and now_s - self._status_s >= _STATUS_S - _SLACK_S:
            self._status_sent, self._status_s = self._status.number, now_s
            send("status", status=self._status.to_json())
        if self._estimates is None:
            return
        report = self._estimates.due(now_s)
        if report is not None:
            notes = () if self._file is None else self._file.notes
            report["warnings"] = [*notes, *self._signals.notes, *report["warnings"]]
            send("estimate", identification=report)
        elif (values := self._estimates.update(now_s)) is not None:
            send("values", **values)


def _vehicle_fields(file: WatchedVehicle | None) -> dict[str, object]:
    """The name in the vehicle file that counts, None without one, and what its user is to know."""
    name = None if file is None or file.vehicle is None else file.vehicle.name
    return {"vehicle": name, "notes": () if file is None else file.notes}


def run(live: LiveProcess) -> None:
    """Work until standard input ends."""
    unpacker = Unpacker()
    cost_s = _CORE_SHARE * _TURN_S
    faults: set[str] = set()
    while (records := _read(unpacker)) is not None:
        begun_s, begun_cpu = time.monotonic(), time.process_time()
        try:
            live.take(records)
            live.report(time.monotonic())
        except _FAULTS as error:
            words = in_words(error)
            if words not in faults and len(faults) < _MOST_FAULTS:
                faults.add(words)
                send("fault", text=words)
        cost_s += _COST_MEMORY * (time.process_time() - begun_cpu - cost_s)
        turn_s = min(max(_TURN_S, cost_s / _CORE_SHARE), _LONGEST_TURN_S)
        time.sleep(max(begun_s + turn_s - time.monotonic(), 0.0))


def _read(unpacker: Unpacker) -> list[Batch | Flight] | None:
    """Everything that waits on standard input once there is something, nothing after a turn; None at its end."""
    select.select([0], [], [], _SIGNALS_S)
    records: list[Batch | Flight] = []
    taken = 0
    while taken < _MOST_BYTES and select.select([0], [], [], 0.0)[0]:
        data = os.read(0, _READ_BYTES)
        if not data:
            return records or None
        records += unpacker.feed(data)
        taken += len(data)
    return records


def main(arguments: list[str]) -> int:
    """arguments: the dialect, and the vehicle file or "". Exit code 1 for a named error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the end of the input says when to stop
    portable.stand_back(_NICENESS)
    one_thread()
    dialect, vehicle = arguments
    second = SecondProcess(forked=True)
    try:
        file = WatchedVehicle(vehicle) if vehicle else None
        live = LiveProcess(Dialect.load(dialect), file, second)
        if file is not None and file.vehicle is not None:
            second.submit(warm_up, file.vehicle)
            LiveIdentifier.warm_up(file.vehicle)
        send("ready", **_vehicle_fields(file))
        run(live)
    except (GcsError, SysidError, SimVehicleError) as error:
        send("error", text=str(error))
        return 1
    except BrokenPipeError:
        return 0
    finally:
        second.close()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
