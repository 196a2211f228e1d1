"""One simulated vehicle at its link: ticks become frames that leave in time, and what is asked is answered."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from sim_vehicle.flight.arming import Arming
from sim_vehicle.flight.tick import Tick
from sim_vehicle.mavlink.boot_clock import VehicleClock
from sim_vehicle.mavlink.fault_options import Faults
from sim_vehicle.mavlink.faulty_link import Arrival, FaultyLink
from sim_vehicle.mavlink.frame_encoder import Voice
from sim_vehicle.mavlink.outputs import Sink
from sim_vehicle.mavlink.pacing import Pacer
from sim_vehicle.mavlink.parameter_service import Onboard
from sim_vehicle.mavlink.services import Protocol
from sim_vehicle.mavlink.telemetry import Telemetry
from sim_vehicle.mavlink.timeline import Timeline
from sim_vehicle.vehicle.vehicle_file import Vehicle


@dataclass
class Channel:
    """What all vehicles of a run share: the sink, its time, and one hand on it at a time.

    pacer: None for a file. start_ns: UTC of flight time 0.
    """

    sink: Sink
    pacer: Pacer | None
    timeline: Timeline
    utc_ns: Callable[[], int] = time.time_ns
    start_ns: int | None = None
    lock: threading.RLock = field(default_factory=threading.RLock)

    def begin(self) -> int:
        """UTC of flight time 0, which is now at the first call."""
        if self.start_ns is None:
            self.start_ns = self.utc_ns()
        return self.start_ns

    def write(self, data: bytes, time_s: float) -> None:
        """Send or store bytes as of flight time `time_s`."""
        with self.lock:
            self.sink.write(data, self.begin() + round(time_s * 1e9))


class Craft:
    """One vehicle. `__call__` takes its ticks, `hear` what a ground station sends.

    seed: of the link's faults, down and up.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        channel: Channel,
        voice: Voice,
        arming: Arming,
        faults: Faults,
        seed: np.random.SeedSequence,
    ) -> None:
        self.arming = arming
        self.parser = voice.parser()
        self.frames = 0
        self.flown_s = 0.0
        self._vehicle, self._channel, self._voice, self._faults = vehicle, channel, voice, faults
        self._clock = VehicleClock(drift=faults.drift_ppm * 1e-6, resets=faults.resets)
        down, up = seed.spawn(2)
        self._down = FaultyLink(faults, down) if faults.on_link else None
        self._up = FaultyLink(faults.of_requests(), up) if faults.on_link else None
        self._telemetry: Telemetry | None = None
        self._protocol: Protocol | None = None

    def __call__(self, tick: Tick) -> None:
        """Say what the vehicle says in one tick, when its time has come."""
        channel = self._channel
        start_ns = channel.begin()
        if channel.pacer:
            channel.pacer.wait_until(tick.time_s)
        channel.timeline.advance(tick.time_s)
        with channel.lock:
            if self._telemetry is None:
                self._telemetry = self._boot(start_ns)
            self._send(self._telemetry.frames(tick), tick.time_s)
        self.flown_s = tick.time_s

    def _boot(self, start_ns: int) -> Telemetry:
        epoch_us = start_ns // 1000 - round(self._clock.boot_s * 1e6)
        telemetry = Telemetry(epoch_us=epoch_us, clock=self._clock, voice=self._voice)
        onboard = Onboard(self._vehicle, self._voice.system, telemetry.rates)
        self._protocol = Protocol(telemetry, onboard, self.arming, lambda: self._clock.since_boot(self._now()))
        return telemetry

    def _now(self) -> float:
        """Flight time, s, never before the last tick's."""
        pacer = self._channel.pacer
        return max(pacer.flight_time() if pacer else 0.0, self.flown_s)

    def _send(self, frames: list[bytes], time_s: float) -> None:
        self.frames += len(frames)
        for frame in frames:
            if self._down:
                self._arrive(self._down.send(frame, time_s))
            else:
                self._channel.write(frame, time_s)

    def _arrive(self, arrivals: list[Arrival]) -> None:
        for when, data in arrivals:
            self._channel.timeline.at(when, partial(self._channel.write, data, when))

    def hear(self, data: bytes) -> None:
        """Bytes that a ground station sent, which may be for another vehicle."""
        for message in self.parser.parse_buffer(data) or []:
            if not self._up:
                self._answer(message)
                continue
            with self._channel.lock:
                arrivals = self._up.send(bytes(message.get_msgbuf()), self._now())
            for when, _ in arrivals:
                self._channel.timeline.at(when, partial(self._answer, message))

    def _answer(self, message: Any) -> None:
        with self._channel.lock:
            if self._protocol:
                self._protocol.answer(message)
                self._send(self._voice.take(), self._now())

    def finish(self) -> None:
        """Let go what the link still holds; the timeline sends it."""
        if self._down:
            self._arrive(self._down.rest())
