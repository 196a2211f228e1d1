"""Who speaks on a link: names for its peers, so that the bytes of each are framed and recorded on their own.

The first peer carries the link's own name. One heard while others are there gets a number behind it: `NAME#2`. The
number of a peer that is gone is given to the next, so a vehicle that comes back twenty times a day, each time from
another port, goes on under few names.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

from gcs.links.allowance import REFUSED_MEMORY_S, Allowance
from gcs.links.datagrams import Batch, Peer

#: In front of the name of a source behind a link to another ground station: it brings commands, not telemetry.
FORWARD = "forward:"
#: After this time in silence a peer is not answered any more, and its name is free.
PEER_MEMORY_S = 30.0
#: Peers distinguished at one time; those beyond share the last name.
MOST_PEERS = 32


@dataclass
class Source:
    """One peer of a link: host and port, or device and baud.

    heard: monotonic time of its last bytes, s. refused: bytes beyond what one peer may send, which were left out.
    """

    name: str
    peer: Peer
    address: str
    heard: float
    bytes: int = 0
    reads: int = 0
    refused: int = 0
    last_received_ns: int = 0
    refused_at: float = float("-inf")
    _allowance: Allowance = field(default_factory=Allowance)

    def take(self, batch: Batch, link: str) -> Batch | None:
        """What of a batch is within the peer's allowance, under the source's name; it is counted. link: its name."""
        now = time.monotonic()
        taken, refused = self._allowance.take(batch, now)
        if refused:
            self.refused += refused
            self.refused_at = now
        if taken is None:
            return None
        self.bytes += len(taken.data)
        self.reads += taken.ends.size
        self.last_received_ns = int(taken.received_ns[-1])
        return taken if self.name == link else replace(taken, source=self.name)


class Sources:
    """The peers of one link."""

    def __init__(self, link: str) -> None:
        self._link = link
        self._slots: list[Source] = []
        self._by_peer: dict[Peer, Source] = {}

    def of(self, peer: Peer, address: str) -> Source:
        """The source of a peer that was just heard. address: the peer in words."""
        now = time.monotonic()
        source = self._by_peer.get(peer)
        if source is None:
            source = self._admit(peer, address, now)
        source.heard = now
        return source

    def _admit(self, peer: Peer, address: str, now: float) -> Source:
        taken = next((i for i, slot in enumerate(self._slots) if now - slot.heard > PEER_MEMORY_S), len(self._slots))
        if taken >= MOST_PEERS:
            return self._slots[-1]
        name = f"{self._link}#{taken + 1}" if taken else self._link
        if taken < len(self._slots):
            self._by_peer.pop(self._slots[taken].peer, None)
            self._slots[taken] = Source(name, peer, address, now)
        else:
            self._slots.append(Source(name, peer, address, now))
        self._by_peer[peer] = self._slots[taken]
        return self._slots[taken]

    def forget(self, peer: Peer) -> None:
        """The peer has left: its name is free at once."""
        source = self._by_peer.pop(peer, None)
        if source is not None:
            source.heard = float("-inf")

    def recent(self) -> list[Source]:
        """Peers heard of late, to whom answers go."""
        oldest = time.monotonic() - PEER_MEMORY_S
        return [source for source in self._by_peer.copy().values() if source.heard >= oldest]

    def all(self) -> list[Source]:
        """Every source heard, those that fell silent too."""
        return self._slots.copy()

    def too_fast(self) -> list[Source]:
        """Peers that have sent more than they may within the last seconds."""
        since = time.monotonic() - REFUSED_MEMORY_S
        return [source for source in self._slots.copy() if source.refused_at >= since]

    def to_json(self) -> list[dict[str, object]]:
        """The same as JSON."""
        return [
            {
                "source": slot.name,
                "address": slot.address,
                "bytes": slot.bytes,
                "reads": slot.reads,
                "refused": slot.refused,
                "last_received_ns": slot.last_received_ns,
            }
            for slot in self.all()
        ]
