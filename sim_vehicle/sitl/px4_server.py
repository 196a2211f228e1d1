"""The simulator's side of PX4's lockstep: PX4 connects over TCP, each step of its clock is one of ours."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim_vehicle.errors import SinkError
from sim_vehicle.mavlink.frame_encoder import Voice
from sim_vehicle.sitl.hil_messages import Actuators, Sensors
from sim_vehicle.sitl.physics import AutopilotFlight

_WAIT_S = 0.2  # so that Ctrl-C is heard
_LARGEST = 65536
_PATIENCE_S = 2.0
_LATE_S = 0.1
_GPS_HZ, _TRUTH_HZ, _HEARTBEAT_HZ = 10.0, 50.0, 1.0
# PX4 takes its clock from the first stamp; 0 counts as none.
_FIRST_US = 1_000_000


@dataclass
class LockstepCounts:
    """What has come and gone. strange: pieces that are no MAVLink. missing: answers that never came."""

    steps: int = 0
    answers: int = 0
    strange: int = 0
    missing: int = 0
    connections: int = 0

    def __str__(self) -> str:
        return f"{self.steps} steps, {self.answers} answers, {self.missing} missing, {self.connections} connections"


class Px4Server:
    """Flies one PX4 after the other; each begins on the ground. rate_hz: of HIL_SENSOR. speed: times real time, 0 as
    fast as both sides can.
    """

    def __init__(
        self, flight: AutopilotFlight, place: tuple[str, int], rate_hz: float, speed: float,
        generator: np.random.Generator, say: Callable[[str], None],
    ) -> None:  # fmt: skip
        """Raises SinkError where the port cannot be had."""
        self._flight, self._say = flight, say
        self._dt, self._speed, self._generator = 1.0 / rate_hz, speed, generator
        controls = flight.plant.vehicle.controls
        self._motors = controls["throttle"].servos if "throttle" in controls else ()
        self.counts = LockstepCounts()
        self._listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listening.bind(place)
            self._listening.listen(1)
        except OSError as error:
            self._listening.close()
            host, port = place
            raise SinkError(f"TCP {host}:{port}: {error.strerror or error}; give another port with --listen") from None
        self._listening.settimeout(_WAIT_S)

    @property
    def address(self) -> tuple[str, int]:
        """Host and port it listens at."""
        host, port = self._listening.getsockname()
        return str(host), int(port)

    def serve(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Fly whoever connects until `stop` says so."""
        while not stop():
            try:
                link, _ = self._listening.accept()
            except TimeoutError:
                continue
            self.counts.connections += 1
            self._say("PX4 has connected: the aircraft stands on the ground")
            with link:
                link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._fly(_Link(link, self.counts), stop)
            self._flight.restart()
            if not stop():
                self._say("PX4 has gone: waiting for it to connect again")

    def close(self) -> None:
        """Give the port back."""
        self._listening.close()

    def _fly(self, link: _Link, stop: Callable[[], bool]) -> None:
        """One connection: until PX4's first answer time goes on by itself, then it waits for each."""
        flight, dt, voice = self._flight, self._dt, Voice()
        sensors = Sensors(voice.build, self._generator)
        pulses: tuple[int, ...] = ()
        answered, step = False, 0
        begun = time.monotonic()
        try:
            while not stop():
                motion, now_us = flight.motion, _FIRST_US + round(step * dt * 1e6)
                wind = np.asarray(flight.wind.at(float(-motion.position[2])), dtype=np.float64)
                voice.say(sensors.readings(now_us, motion, wind))
                if _is_due(step, dt, _GPS_HZ):
                    voice.say(sensors.position(now_us, motion))
                if _is_due(step, dt, _TRUTH_HZ):
                    voice.say(sensors.truth(now_us, motion, wind))
                if _is_due(step, dt, _HEARTBEAT_HZ):
                    voice.say(voice.build.heartbeat_encode(1, 8, 0, 0, 4))
                link.send(b"".join(voice.take()), stop)
                answer = link.wait(now_us, stop) if answered else link.newest()
                if answer is not None:
                    if not answered and not answer.lockstep:
                        self._say("this PX4 was built without lockstep: it goes by its own clock, run it at real time")
                    answered = True
                    pulses = answer.pulses(self._motors)
                flight.step(pulses, dt)
                step += 1
                self.counts.steps += 1
                if self._speed > 0.0 or not answered:
                    # Before the first answer PX4 starts up, which takes its time.
                    ahead = begun + step * dt / (self._speed or 1.0) - time.monotonic()
                    time.sleep(max(ahead, 0.0))
                    # What was held up, as by a debugger, is not made up for.
                    begun -= min(ahead + _LATE_S, 0.0)
        except (OSError, EOFError):
            return  # it has gone, or its machine has


def _is_due(step: int, dt: float, rate_hz: float) -> bool:
    """Whether a message of that rate is sent with this step."""
    return step == 0 or int(step * dt * rate_hz + 1e-6) != int((step - 1) * dt * rate_hz + 1e-6)


class _Link:
    """Frames from and to one PX4."""

    def __init__(self, link: socket.socket, counts: LockstepCounts) -> None:
        self._link, self._counts = link, counts
        self._parser: Any = Voice().parser()
        self._last: Actuators | None = None
        self._keeps_time = False
        self._link.settimeout(_WAIT_S)

    def send(self, frames: bytes, stop: Callable[[], bool]) -> None:
        """Raises OSError where nobody is there."""
        self._link.settimeout(_WAIT_S)
        left = memoryview(frames)
        while left and not stop():
            try:
                left = left[self._link.send(left) :]
            except TimeoutError:  # it does not read, as one that stands in a debugger
                continue

    def newest(self) -> Actuators | None:
        """The newest answer that is there already. Raises EOFError where PX4 has gone."""
        self._link.setblocking(False)
        try:
            self._hear(self._link.recv(_LARGEST))
        except BlockingIOError:
            return None
        return self._last

    def wait(self, now_us: int, stop: Callable[[], bool]) -> Actuators | None:
        """The answer to the sensors of `now_us`: in lockstep there is one to each. None if it is to stop.

        One that does not come at all, as garbage took it, must not hold both sides up for ever: then the last counts.
        Of one whose answers carry the sensors' time an older answer is none.
        """
        before, given_up = self._counts.answers, time.monotonic() + _PATIENCE_S
        self._link.settimeout(_WAIT_S)
        while self._counts.answers == before or (self._keeps_time and self._last is not None
                                                 and self._last.time_us < now_us):  # fmt: skip
            if stop():
                return None
            if time.monotonic() > given_up:
                self._counts.missing += 1
                return self._last
            try:
                self._hear(self._link.recv(_LARGEST))
            except TimeoutError:
                continue
        self._keeps_time = self._last is not None and self._last.time_us >= now_us
        return self._last

    def _hear(self, data: bytes) -> None:
        if not data:
            raise EOFError
        for message in self._parser.parse_buffer(data) or ():
            name = message.get_type()
            if name == "HIL_ACTUATOR_CONTROLS":
                self._last = Actuators.of(message)
                self._counts.answers += 1
            elif name == "BAD_DATA":
                self._counts.strange += 1
