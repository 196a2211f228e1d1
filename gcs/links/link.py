"""What all links share: the interface, the counters, and the spacing of attempts to reconnect.

A link gives batches of bytes, each read stamped with its UTC time of arrival, and takes bytes to send. One that
loses its peer goes on trying; nothing that happens on a link raises out of `receive` or `send`.
"""

from __future__ import annotations

import select
import socket
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from gcs.links.datagrams import Batch
from gcs.links.sources import Source, Sources
from gcs.links.url import LinkKind, LinkUrl
from gcs.text.oserrors import is_own, reason

_BACKOFF_S = (0.1, 0.2, 0.5, 1.0, 2.0)


@dataclass
class LinkCounters:
    """What went over a link since it was opened.

    dropped: datagrams the kernel had no room for. refused: bytes that peers sent beyond what one may. connections: how
    often bytes could begin to flow; reconnects: those of them behind a loss. send_errors: pieces that could not be
    sent, as nobody took them in time.
    """

    bytes: int = 0
    reads: int = 0
    dropped: int = 0
    refused: int = 0
    bytes_sent: int = 0
    send_errors: int = 0
    connections: int = 0
    reconnects: int = 0
    last_received_ns: int = 0


class Link(ABC):
    """Base of all links. `connected` is whether bytes can flow now, `problem` why not, in words. `broken` is whether
    this computer refuses the link, whoever is at its other end.

    immediate: set where what arrives is passed on at once, so that it is not left to gather. watched: set
    where it is looked at as it arrives, so that it gathers for a short time only.
    """

    def __init__(self, url: LinkUrl) -> None:
        self.url = url
        self.name = url.text
        self.counters = LinkCounters()
        self.sources = Sources(url.text)
        self.connected = False
        self.immediate = self.watched = False
        self.problem = ""
        self.broken = False
        self._waiting: deque[Batch] = deque()
        self._counting = threading.Lock()

    def _failed(self, error: OSError) -> None:
        """Remember why bytes cannot flow."""
        self.problem, self.broken = reason(error), is_own(error)

    def receive(self, timeout_s: float) -> Batch | None:
        """Bytes of one source that arrived within `timeout_s`, or None; never raises for what a peer does."""
        if not self._waiting:
            self._fetch(timeout_s)
        if not self._waiting:
            return None
        batch = self._waiting.popleft()
        self.counters.bytes += len(batch.data)
        self.counters.reads += batch.ends.size
        self.counters.last_received_ns = int(batch.received_ns[-1])
        return batch

    def _take(self, source: Source, batch: Batch) -> None:
        """Put what a peer has sent behind what waits, as far as it may send that much."""
        taken = source.take(batch, self.name)
        self.counters.refused += len(batch.data) - (len(taken.data) if taken else 0)
        if taken:
            self._waiting.append(taken)

    @abstractmethod
    def _fetch(self, timeout_s: float) -> None:
        """Put what arrives within `timeout_s` into `_waiting`."""

    @abstractmethod
    def send(self, data: bytes, wait_s: float = 0.0) -> None:
        """Send whole frames to every peer known now; what cannot be sent within `wait_s` is dropped and counted."""

    def send_frames(self, frames: Sequence[bytes]) -> None:
        """Send frames, each in a datagram of its own where the link has datagrams; waits for nothing."""
        for frame in frames:
            self.send(frame)

    def _sent(self, count: int) -> None:
        """Count bytes that were sent, from whatever thread."""
        with self._counting:
            self.counters.bytes_sent += count

    def _unsent(self, count: int = 1) -> None:
        """Count frames that could not be sent."""
        with self._counting:
            self.counters.send_errors += count

    @abstractmethod
    def close(self) -> None:
        """Give the socket or device back; the link must not be used after it."""

    @property
    def ready(self) -> bool:
        """Whether there is a peer to send to."""
        return self.connected

    @property
    def up(self) -> bool:
        """Whether the link stands as far as this computer can do anything for it: one that listens waits for peers."""
        return self.connected or (self.url.kind is LinkKind.TCP_SERVER and not self.broken)

    def status(self) -> dict[str, object]:
        """Counters and state as JSON-ready values."""
        return {
            "url": self.name,
            "connected": self.connected,
            "problem": self.problem,
            **asdict(self.counters),
            "sources": self.sources.to_json(),
        }


def readable(descriptor: int, timeout_s: float) -> bool:
    """Whether there is something to read, or an end to see, within `timeout_s`; of a descriptor of any number."""
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(1000.0 * timeout_s))


def resolve(url: LinkUrl, kind: socket.SocketKind) -> tuple[int, tuple[str, int]]:
    """Family and address of the URL's host; OSError where the name is unknown."""
    info = socket.getaddrinfo(url.host, url.port, type=kind)
    family, _, _, _, address = min(info, key=lambda entry: entry[0] != socket.AF_INET)
    return family, (str(address[0]), int(address[1]))


def address_text(host: str, port: int) -> str:
    """HOST:PORT, an IPv6 host in brackets."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


class Backoff:
    """Spaces the attempts to reconnect: 0.1 s at first, then up to `longest_s`."""

    def __init__(self, longest_s: float = _BACKOFF_S[-1]) -> None:
        self._longest_s = longest_s
        self._failures = 0
        self._next = 0.0

    def due(self, timeout_s: float) -> bool:
        """Wait for the next attempt, at most `timeout_s`; whether it is due."""
        wait = self._next - time.monotonic()
        if wait > 0:
            time.sleep(min(wait, timeout_s))
        if time.monotonic() < self._next:
            return False
        pause = _BACKOFF_S[min(self._failures, len(_BACKOFF_S) - 1)]
        self._next = time.monotonic() + min(pause, self._longest_s)
        self._failures += 1
        return True

    def reset(self) -> None:
        self._failures = 0
