"""Sending a recording again, byte for byte: at the pace at which it was received, faster, or in lock-step.

In lock-step the other side sets the pace: a step is sent, and the next only once something has come back for it.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gcs.errors import LinkError, RecordingError
from gcs.links.opening import Link, open_link
from gcs.recording.joined import all_parts
from gcs.recording.reader import Recording, WirePieces

_CONNECT_TIMEOUT_S = 30.0
_POLL_S = 0.05
_SEND_TIMEOUT_S = 5.0  # for a receiver that is slower than the replay


@dataclass(frozen=True)
class Replayed:
    """What a replay sent: frames (and stretches of bytes between them), and the time it took, s."""

    pieces: int
    bytes: int
    unsent_bytes: int
    duration_s: float


def timeline(recording: Recording, link: str | None = None) -> Iterator[tuple[int, bytes]]:
    """(UTC of reception in ns, bytes) of every frame and every stretch of noise, all links merged in time.

    link: only what that link received. RecordingError if there is no such link.
    """
    if link is not None and link not in recording.links():
        raise RecordingError(f"{recording.path} has no link {link!r}; it has {', '.join(recording.links())}")
    together: list[WirePieces] = []
    for part in recording.wire_pieces():
        if link is not None and part.link != link:
            continue
        if any(part.link == other.link for other in together):  # the next chunk begins
            yield from _merged(together)
            together = []
        together.append(part)
    yield from _merged(together)


def _merged(parts: list[WirePieces]) -> Iterator[tuple[int, bytes]]:
    entries = [
        (int(at), number, part.data[start : start + length].tobytes())
        for number, part in enumerate(parts)
        for at, start, length in part.pieces[:, :3].tolist()
    ]
    entries.sort(key=lambda entry: entry[:2])  # stable, so each link keeps its order
    return ((at, data) for at, _, data in entries)


def replay(
    pieces: Iterator[tuple[int, bytes]],
    send: Callable[[bytes], None],
    speed: float = 1.0,
    *,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], object] = time.sleep,
    progress: Callable[[int], None] = lambda ns: None,
) -> tuple[int, int]:
    """Send each piece when it is due; (pieces, bytes) sent.

    speed: 1 is the recorded pace, 0 or infinity as fast as possible. Every wake-up is computed from the start, so
    errors of sleeping do not add up. clock, sleep: seconds. progress: called with the ns of flight replayed so far.
    """
    started = clock()
    first_ns: int | None = None
    count = total = 0
    paced = speed > 0 and math.isfinite(speed)
    for at_ns, data in pieces:
        first_ns = at_ns if first_ns is None else first_ns
        if paced:
            wait = started + (at_ns - first_ns) / 1e9 / speed - clock()
            if wait > 0:
                sleep(wait)
        send(data)
        count += 1
        total += len(data)
        progress(at_ns - first_ns)
    return count, total


def steps(pieces: Iterable[tuple[int, bytes]], step_ns: int = 0) -> Iterator[tuple[int, list[bytes]]]:
    """(UTC of reception in ns of the last, pieces) of each step.

    A step is what came at one time, or within one of the spans of `step_ns` counted from the first piece.
    """
    first_ns: int | None = None
    number, last_ns = 0, 0
    together: list[bytes] = []
    for at_ns, data in pieces:
        first_ns = at_ns if first_ns is None else first_ns
        of = (at_ns - first_ns) // step_ns if step_ns > 0 else at_ns - first_ns
        if together and of != number:
            yield last_ns, together
            together = []
        number, last_ns = of, at_ns
        together.append(data)
    if together:
        yield last_ns, together


class ReplayStepper:
    """A replay that goes on when it is asked to.

    send: takes each frame, or stretch of bytes between frames. step_ns: as in `steps`. link: only what it received.
    """

    def __init__(
        self, recording: Recording, send: Callable[[bytes], object], step_ns: int = 0, link: str | None = None
    ) -> None:
        self._steps = steps(timeline(recording, link), step_ns)
        self._send = send
        self.pieces = 0
        self.bytes = 0

    def step(self) -> int | None:
        """Send the next step; the UTC in ns at which its last piece was received, None when there is nothing left."""
        found = next(self._steps, None)
        if found is None:
            return None
        at_ns, pieces = found
        for data in pieces:
            self._send(data)
            self.pieces += 1
            self.bytes += len(data)
        return at_ns


def replay_in_lock_step(
    path: Path,
    url: str,
    step_ns: int = 0,
    *,
    link: str | None = None,
    answer_timeout_s: float = 30.0,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Replayed:
    """Replay a recording to a connection string, each step once any bytes have come back for the one before.

    Raises RecordingError; LinkError also if no answer comes within `answer_timeout_s`.
    """
    recording = Recording(all_parts(path))
    span = max(recording.end_ns - recording.start_ns, 1)
    out = open_link(url)
    try:
        stepper = ReplayStepper(recording, partial(out.send, wait_s=_SEND_TIMEOUT_S), step_ns, link)
        started = time.monotonic()
        _wait_for_peer(out, lambda: out.receive(_POLL_S))
        while True:
            while out.receive(0.0) is not None:
                pass  # what came before a step is no answer to it
            at_ns = stepper.step()
            if at_ns is None:
                break
            passed_s = (at_ns - recording.start_ns) / 1e9
            _wait_for_answer(out, answer_timeout_s, passed_s)
            progress(passed_s * 1e9 / span)
    finally:
        out.close()
    if stepper.pieces == 0:
        raise RecordingError(f"{path} holds no bytes of any link; there is nothing to replay")
    unsent = stepper.bytes - out.counters.bytes_sent
    return Replayed(stepper.pieces, stepper.bytes, unsent, time.monotonic() - started)


def _wait_for_answer(link: Link, timeout_s: float, passed_s: float) -> None:
    deadline = time.monotonic() + timeout_s
    while link.receive(_POLL_S) is None:
        if time.monotonic() > deadline:
            raise LinkError(
                f"{link.name}: no answer for {timeout_s:g} s to what was received {passed_s:.3f} s into the recording"
            )


def replay_file(
    path: Path,
    url: str,
    speed: float = 1.0,
    *,
    link: str | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Replayed:
    """Replay a recording to a connection string. Raises RecordingError, LinkError."""
    recording = Recording(all_parts(path))
    span = max(recording.end_ns - recording.start_ns, 1)
    pieces = timeline(recording, link)
    out = open_link(url)
    stopping = threading.Event()
    listener = threading.Thread(target=_listen, args=(out, stopping), daemon=True)
    listener.start()
    started = time.monotonic()
    try:
        _wait_for_peer(out, lambda: time.sleep(_POLL_S))
        send = partial(out.send, wait_s=_SEND_TIMEOUT_S)
        count, total = replay(pieces, send, speed, progress=lambda ns: progress(ns / span))
    finally:
        stopping.set()
        listener.join()
        out.close()
    if count == 0:
        raise RecordingError(f"{path} holds no bytes of any link; there is nothing to replay")
    return Replayed(count, total, total - out.counters.bytes_sent, time.monotonic() - started)


def _listen(link: Link, stopping: threading.Event) -> None:
    """Connect, notice a lost connection, and throw away what the other side says."""
    while not stopping.is_set():
        link.receive(_POLL_S)


def _wait_for_peer(link: Link, wait: Callable[[], object]) -> None:
    deadline = time.monotonic() + _CONNECT_TIMEOUT_S
    while not link.ready:
        if time.monotonic() > deadline:
            raise LinkError(
                f"{link.name}: nobody to send to after {_CONNECT_TIMEOUT_S:.0f} s ({link.problem or 'silent'})"
            )
        wait()


__all__ = ["ReplayStepper", "Replayed", "replay", "replay_file", "replay_in_lock_step", "steps", "timeline"]
