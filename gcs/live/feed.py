"""The service's end of the live process: bytes to it, its reports back, and starting it again when it dies.

Links hand their bytes in by `offer`, which returns at once: they wait in a queue of bounded size, and what does not fit
is dropped for the live side only and counted. Recording never waits for any of this.
"""

from __future__ import annotations

import json
import logging
import math
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import IO, Any

from gcs.errors import in_words
from gcs.jobs.programs import Program, begin
from gcs.links.datagrams import Batch
from gcs.live.place import metres
from gcs.live.protocol import Flight, pack_batch, pack_flight
from gcs.settings import Settings

_log = logging.getLogger(__name__)

_QUEUE_BYTES = 1 << 20
# Threads of a library that waits in a loop for matrices of size ten cost more than the matrices.
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
_LOOK_S = 0.25
_ASK_AGAIN_S = 2.0
_LOST_S = 2.0
# A process that has not looked at a batch for so long stands still.
_BEHIND_S = 10.0
_STOP_TIMEOUT_S = 3.0
# Of a track: the least between two places, m, and how many are kept at most.
_STEP_M, _MOST_PLACES = 2.0, 2000
# Reports whose samples are kept for who follows: two seconds.
_MOST_RECENT = 19
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 1.0, 30.0
# A process that has lived that long was well: the next pause is a short one again.
_WELL_S = 60.0


#: By signal its times, s, and values.
Samples = dict[str, tuple[list[float], list[float]]]


@dataclass
class LiveState:
    """The newest of what the live process reported. Replaced as a whole, so that readers need no lock.

    signals: name -> (value, UTC ns of reception, unit). numbers count reports, for those who wait for new ones.
    heard_s: when the newest bytes with a message of the vehicle came, monotonic. flight: the recorded one that all this
    is of, None for none. status: of the vehicle (gcs.live.vehicle_status); track: where it has been, m north and east
    of home. recent: samples of the newest reports, by the report's number.
    """

    time_s: float | None = None
    system: int | None = None
    signals: dict[str, tuple[float, int, str]] = field(default_factory=dict)
    identification: dict[str, Any] | None = None
    heard_s: float | None = None
    signals_number: int = 0
    estimate_number: int = 0
    flight: str | None = None
    status: dict[str, Any] = field(default_factory=dict)
    status_number: int = 0
    track: tuple[tuple[float, float], ...] = ()
    recent: tuple[tuple[int, Samples], ...] = ()


class LiveFeed:
    """Runs the live process. flights: gives the id of each flight being recorded, in the order in which they began, and
    the system that flies it, None while that is not known. worker: the command that runs the process. vehicle_of: the
    vehicle file of a flight by its id and system, "" for the one that the service was started with, None where it is
    not known.

    on_estimate: called with each identification report and the flight's time, s, from a thread of this feed.
    """

    def __init__(
        self,
        settings: Settings,
        flights: Callable[[], Mapping[str, int | None]],
        worker: Sequence[str] = (sys.executable, "-m", "gcs.live.worker"),
        vehicle_of: Callable[[str, int | None], str | None] = lambda flight, system: "",
    ) -> None:
        self._vehicle_of = vehicle_of
        self._command = (*worker, settings.link.dialect, settings.vehicle or "")
        self._flights = flights
        self.on_estimate: Callable[[dict[str, Any], float], None] | None = None
        self._queue: deque[bytes] = deque()
        self._queued_bytes = 0
        # Batches that the process has been given and not yet reported as taken: number and time, monotonic.
        self._given: deque[tuple[int, float]] = deque()
        self._number = 0
        self._changed = threading.Condition()
        self._process: Program | subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._run, name="live", daemon=True)
        self._failure = ""
        self.state = LiveState()
        # The flight that is followed, None for none, and with the vehicle that was sent to the process with it.
        self.flight: str | None = None
        self._followed = Flight()
        self._ask_again_s = 0.0
        # The name in the vehicle file that estimates go by.
        self.vehicle: str | None = None
        # Why the vehicle file that was given does not count, while none does.
        self._no_vehicle = ""
        self.process_state = "starting"
        self.restarts = 0
        self.dropped_bytes = 0
        self.ending = threading.Event()

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End the process and the threads."""
        self.ending.set()
        with self._changed:
            self._changed.notify()
        if self._process is not None:
            self._process.terminate()
        if self._thread.ident is not None:
            self._thread.join(_STOP_TIMEOUT_S)

    def offer(self, source: str, batch: Batch) -> None:
        """Queue what a link brought; returns at once."""
        record = pack_batch(source, batch)
        with self._changed:
            if self._queued_bytes + len(record) > _QUEUE_BYTES:
                self.dropped_bytes += len(batch.data)
                return
            self._number += 1
            self._given.append((self._number, time.monotonic()))
            self._put(record)

    @property
    def current(self) -> LiveState:
        """The state of the flight that is recorded: nothing yet while only the one before it has been reported; of the
        last one where none is recorded.
        """
        state, flight = self.state, self.flight
        if flight is None or state.flight is None or state.flight == flight:
            return state
        return _nothing_of(state)

    @property
    def problem(self) -> str:
        """Why nothing live comes, in words; empty when all is well."""
        return (
            f"live identification stands still: {self._failure}" if self.process_state == "failed" else self._no_vehicle
        )

    @property
    def link_state(self) -> str:
        """Whether messages come: waiting (none yet), live, or lost (none for 2 s).

        By the time at which bytes came, not at which their signals are reported: a process that is behind on a busy
        machine loses nothing. What it has not looked at yet counts as neither, unless it has not for 10 s.
        """
        heard = self.state.heard_s
        if heard is None:
            return "waiting"
        with self._changed:
            now = time.monotonic()
            looked_s = max(self._given[0][1], now - _BEHIND_S) if self._given else now
        return "live" if looked_s - heard < _LOST_S else "lost"

    def _put(self, record: bytes) -> None:
        self._queue.append(record)
        self._queued_bytes += len(record)
        self._changed.notify()

    def _run(self) -> None:
        pause = _FIRST_PAUSE_S
        while not self.ending.is_set():
            begun = time.monotonic()
            try:
                self._run_once()
            except Exception as error:  # whatever it is, the next life begins
                self._failure = in_words(error)
            if self.ending.is_set():
                return
            self.process_state = "failed"
            self._failure = self._failure or "its process ended"
            _log.error("%s", self.problem)
            pause = _FIRST_PAUSE_S if time.monotonic() - begun > _WELL_S else min(2.0 * pause, _LONGEST_PAUSE_S)
            self.ending.wait(pause)
            self.restarts += 1

    def _run_once(self) -> None:
        """One life of the process."""
        self._failure = ""
        with begin(self._command, text=False, variables=_ONE_THREAD) as process:
            self._process = process
            assert process.stdin is not None
            assert process.stdout is not None
            with self._changed:
                self._queue.clear()
                self._given.clear()
                self._queued_bytes = self._number = 0
            self.flight, self._followed = None, Flight()
            reader = threading.Thread(target=self._read, args=(process.stdout,), daemon=True)
            reader.start()
            try:
                self._write(process, process.stdin)
            except OSError:
                pass  # it has died, which the caller reports
            finally:
                process.kill()
                reader.join(_STOP_TIMEOUT_S)
            code = process.wait()
            if not self._failure:
                self._failure = f"its process ended with code {code}"

    def _write(self, process: Program | subprocess.Popen[bytes], pipe: IO[bytes]) -> None:
        while not self.ending.is_set() and process.poll() is None:
            self._follow_flight()
            with self._changed:
                if not self._queue:
                    self._changed.wait(_LOOK_S)
                records = b"".join(self._queue)
                self._queue.clear()
                self._queued_bytes = 0
            if records:
                pipe.write(records)
                pipe.flush()

    def _follow_flight(self) -> None:
        """The flight that is followed stays so while it lasts, whoever else takes off; then the oldest one is."""
        live = self._flights()
        flight = self.flight if self.flight in live else next(iter(live), None)
        system = None if flight is None else live[flight]
        another = (flight or "", system) != (self._followed.id, self._followed.system)
        # Somebody may choose its aircraft while it flies, or its board be known only now.
        if another or (flight is not None and time.monotonic() > self._ask_again_s):
            self._ask_again_s = time.monotonic() + _ASK_AGAIN_S
            vehicle = None if flight is None else self._vehicle_of(flight, system)
            if vehicle is None:  # not known, or not now: what was known of the same flight holds
                vehicle = "" if another else self._followed.vehicle
            followed = Flight() if flight is None else Flight(flight, system, vehicle)
            if followed == self._followed:
                return
            self.flight, self._followed = flight, followed
            with self._changed:
                self._put(pack_flight(followed))

    def _read(self, pipe: IO[bytes]) -> None:
        for line in pipe:
            try:
                self._take(json.loads(line))
            except Exception as error:  # one report that nobody can read does not end those behind it
                _log.error("a report of the live process was left out: %s", in_words(error))

    def _taken(self, number: int) -> float:
        """The process has taken so many batches; when the last of them came."""
        with self._changed:
            at_s = self._given[0][1] if self._given else time.monotonic()
            while self._given and self._given[0][0] <= number:
                at_s = self._given.popleft()[1]
        return at_s

    def _take(self, report: dict[str, Any]) -> None:
        kind = report.pop("kind")
        old = self.state
        if kind in ("ready", "vehicle"):
            self.vehicle = report["vehicle"]
            self._no_vehicle = "" if self.vehicle else " ".join(report["notes"])
            for note in report["notes"]:
                _log.warning("%s", note)
            if kind == "ready":
                self.process_state = "running"
        elif kind == "begin":
            self.state = _nothing_of(old)
        elif kind == "error":
            self._failure = report["text"]
        elif kind == "fault":
            _log.error("live identification left something out: %s", report["text"])
        elif kind == "taken":
            self._taken(report["taken"])
        elif kind == "signals":
            signals = {name: tuple(entry) for name, entry in report["signals"].items()}
            self.state = replace(
                old, time_s=report["time_s"], system=report["system"], signals=signals,
                heard_s=self._taken(report["taken"]), signals_number=old.signals_number + 1, flight=report["flight"],
                recent=(*old.recent[-_MOST_RECENT:], (old.signals_number + 1, report["recent"])),
            )  # fmt: skip
        elif kind == "status":
            status = report["status"]
            self.state = replace(
                old, status=status, status_number=old.status_number + 1, track=_longer(_from_home(old, status), status)
            )
        elif kind == "values" and old.identification is not None:
            self.state = replace(old, identification=_renewed(old.identification, report))
        elif kind == "estimate":
            number = old.estimate_number + 1
            self.state = replace(old, identification=report["identification"], estimate_number=number)
            if old.time_s is not None and self.on_estimate is not None:
                self.on_estimate(report["identification"], old.time_s)


def _nothing_of(state: LiveState) -> LiveState:
    """Another flight: nothing is known of it, and numbers go on."""
    return LiveState(
        heard_s=state.heard_s, signals_number=state.signals_number, estimate_number=state.estimate_number,
        status_number=state.status_number,
    )  # fmt: skip


def _from_home(old: LiveState, status: dict[str, Any]) -> tuple[tuple[float, float], ...]:
    """The track so far, from the home that the vehicle has now."""
    before, now = (one.get("home", {}).get("place") for one in (old.status, status))
    if not old.track or before is None or now is None or before == now:
        return old.track
    north, east = metres((before[0], before[1]), (now[0], now[1]))
    return tuple((one[0] + north, one[1] + east) for one in old.track)


def _longer(track: tuple[tuple[float, float], ...], status: dict[str, Any]) -> tuple[tuple[float, float], ...]:
    """The track with where the vehicle is now; of a long one every other place stays."""
    if "position" not in status:
        return track
    north, east = status["position"]
    if track and math.dist(track[-1], (north, east)) < _STEP_M:
        return track
    kept = track if len(track) < _MOST_PLACES else track[::2]
    return (*kept, (north, east))


def _renewed(identification: dict[str, Any], report: dict[str, Any]) -> dict[str, Any]:
    """What is known with newer values; whether one counts as known, and all that has words, the next report says."""
    coefficients = dict(identification["coefficients"])
    for name, (value, std) in report["values"].items():
        if "value" in coefficients.get(name, ()) and value is not None and std is not None:
            coefficients[name] = {**coefficients[name], "value": value, "std": std}
    return {**identification, "time_s": report["time_s"], "coefficients": coefficients}
