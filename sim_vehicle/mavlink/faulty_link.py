"""A bad link: what becomes of frames on their way, the same for the same seed.

Delay and jitter keep the order: what comes behind a held-up burst is held up as well, as in a radio's queue. Late
bursts are delayed alone, and are overtaken, as over several paths; reordered frames are passed by a few others.
"""

from __future__ import annotations

import numpy as np

from sim_vehicle.mavlink.fault_options import Faults

_GARBAGE_BYTES = 64  # at most, in one burst of noise
_OVERTAKEN_BY = 3  # at most, frames that pass a reordered one
_KINDS = ("loss", "jitter", "late", "duplicate", "reorder", "corrupt", "garbage", "corrupt copy", "garbage copy")

Arrival = tuple[float, bytes]


class FaultyLink:
    """One direction of one vehicle's link.

    Each kind of fault draws from a generator of its own, and for every frame whatever its fate, so that turning one on
    leaves the others as they were.
    """

    def __init__(self, faults: Faults, seed: np.random.SeedSequence) -> None:
        self._faults = faults
        children = seed.spawn(len(_KINDS))
        self._random = {kind: np.random.default_rng(child) for kind, child in zip(_KINDS, children, strict=True)}
        self._burst_s = -1.0
        self._queue_s = 0.0  # when the burst before leaves the queue
        self._burst_arrival_s = 0.0
        self._held: list[tuple[int, bytes]] = []

    def send(self, frame: bytes, time_s: float) -> list[Arrival]:
        """Send one frame at flight time `time_s`: what arrives because of it, and when, s."""
        arrival = self._arrival(time_s)
        copies = [self._damaged(frame, "")]
        if self._happens("duplicate", self._faults.duplicate):
            copies.append(self._damaged(frame, " copy"))
        lost = self._happens("loss", self._faults.loss)
        lost = lost or any(begin <= time_s < end for begin, end in self._faults.outages)
        if lost:
            copies = []
        if self._happens("reorder", self._faults.reorder):
            passed_by = int(self._random["reorder"].integers(1, _OVERTAKEN_BY + 1))
            self._held += [(passed_by, copy) for copy in copies]
            return []
        return [(arrival, item) for item in copies + self._released()]

    def rest(self) -> list[Arrival]:
        """Frames that still wait to be overtaken when the flight ends."""
        held, self._held = self._held, []
        return [(self._burst_arrival_s, frame) for _, frame in held]

    def _arrival(self, time_s: float) -> float:
        faults = self._faults
        if time_s != self._burst_s:
            self._burst_s = time_s
            arrival = time_s + faults.delay
            if faults.jitter:
                arrival += float(self._random["jitter"].exponential(faults.jitter))
            self._queue_s = max(self._queue_s, arrival)
            self._burst_arrival_s = self._queue_s
            if self._happens("late", faults.late):
                self._burst_arrival_s += float(self._random["late"].uniform(0.0, faults.late_s))
        return self._burst_arrival_s

    def _happens(self, kind: str, share: float) -> bool:
        return share > 0.0 and bool(self._random[kind].random() < share)

    def _released(self) -> list[bytes]:
        """Held frames that enough others have passed."""
        passed = [(left - 1, frame) for left, frame in self._held]
        self._held = [(left, frame) for left, frame in passed if left > 0]
        return [frame for left, frame in passed if left <= 0]

    def _damaged(self, frame: bytes, copy: str) -> bytes:
        """What comes of a frame, or of its ` copy`."""
        data, bits_random, noise_random = frame, self._random[f"corrupt{copy}"], self._random[f"garbage{copy}"]
        if self._faults.corrupt:
            bits = np.unpackbits(np.frombuffer(frame, dtype=np.uint8))
            bits ^= bits_random.random(bits.size) < self._faults.corrupt
            data = np.packbits(bits).tobytes()
        if self._faults.garbage > 0.0 and noise_random.random() < self._faults.garbage:
            data = noise_random.bytes(int(noise_random.integers(1, _GARBAGE_BYTES + 1))) + data
        return data
