"""UDP links: listening, sending to one address, to a broadcast address, and multicast."""

from __future__ import annotations

import contextlib
import errno
import socket
import struct
import sys
import time

from gcs.errors import LinkError
from gcs.links.datagrams import Batch, DatagramReceiver, Peer
from gcs.links.link import Backoff, Link, address_text, readable, resolve
from gcs.links.url import LinkKind, LinkUrl
from gcs.text.oserrors import reason

# Holds over a minute of ordinary telemetry while the process is held up. The system grants a quarter of it or less to
# those who may not overrule its limit (net.core.rmem_max).
RECEIVE_BUFFER_BYTES = 16 * 1024 * 1024
_SO_RCVBUFFORCE = 33
# Waking up is what costs. The kernel stamps the arrival of datagrams, so they may wait together: until there are many,
# but no longer than a person would notice, and less where somebody watches them or waits for them to be passed on.
_LONGEST_WAIT_S = 0.05
_LONGEST_WATCHED_WAIT_S = 0.01
_LONGEST_IMMEDIATE_WAIT_S = 0.002
_SHORTEST_WAIT_S = 0.0005
_MANY_DATAGRAMS = 512  # a twentieth of what 4 MB of buffer hold


def _join_route(sender: socket.socket, group: Peer) -> None:
    """Connect to a multicast group; within this machine where it is on no network."""
    try:
        sender.connect(group)
    except OSError as error:
        if error.errno != errno.ENETUNREACH:
            raise
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        sender.connect(group)


def _widen(sock: socket.socket) -> None:
    """Give a socket as large a receive buffer as it may have."""
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
    if sys.platform == "linux":
        with contextlib.suppress(PermissionError):
            sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES)


class UdpLink(Link):
    """A UDP socket.

    `udpin:` binds and answers whoever spoke within 30 s. `udpout:` sends to one address first. `udpbcast:` sends to a
    broadcast address until somebody answers, then to those. `mcast:` speaks and listens in a multicast group.
    """

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._socket: socket.socket | None = None
        self._sender: socket.socket | None = None
        self._target: Peer | None = None
        self._own: Peer | None = None
        self._receiver: DatagramReceiver | None = None
        self._wait_s = _SHORTEST_WAIT_S
        self._flowing = False
        self._retry = Backoff()
        # At once, so that what is sent before the first reception is not lost.
        try:
            self._open()
        except OSError as error:
            if url.kind is LinkKind.UDP_IN:
                raise LinkError(f"{url.text}: cannot listen there ({reason(error)}); choose another port") from error
            self._failed(error)

    @property
    def port(self) -> int:
        """The local port, of use where the URL asked for port 0."""
        return int(self._socket.getsockname()[1]) if self._socket else 0

    @property
    def ready(self) -> bool:
        """Whether there is a peer to send to."""
        return self.connected and (self.url.kind is not LinkKind.UDP_IN or bool(self.sources.recent()))

    def _open(self) -> None:
        kind = self.url.kind
        family, address = resolve(self.url, socket.SOCK_DGRAM)
        with contextlib.ExitStack() as undo:
            sock = undo.enter_context(socket.socket(family, socket.SOCK_DGRAM))
            _widen(sock)
            sock.setblocking(False)
            receiver = DatagramReceiver(sock)
            sender = sock
            if kind is LinkKind.UDP_IN:
                sock.bind(address)
            elif kind is LinkKind.UDP_OUT:
                sock.connect(address)
            elif kind is LinkKind.UDP_BROADCAST:
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
                self._target = address
            else:
                # Sent from a socket of its own, whose address marks the copies of what we sent ourselves.
                sender = undo.enter_context(socket.socket(family, socket.SOCK_DGRAM))
                sender.setblocking(False)
                _join_route(sender, address)
                host, port = sender.getsockname()[:2]
                self._own = (host, port)
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                sock.bind(address)
                group = struct.pack("4s4s", socket.inet_aton(address[0]), socket.inet_aton(host))
                sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
            undo.pop_all()
        self._socket, self._sender, self._receiver = sock, sender, receiver
        self.connected, self.problem, self.broken = True, "", False
        self.counters.connections += 1

    def _fetch(self, timeout_s: float) -> None:
        if self._socket is None and not self._reopen(timeout_s):
            return
        assert self._socket is not None
        assert self._receiver is not None
        arrived: list[tuple[Peer, Batch]] = []
        if self._flowing:
            time.sleep(min(self._wait_s, timeout_s))
            arrived = self._drain()
        if not arrived and readable(self._socket.fileno(), timeout_s):
            arrived = self._drain()
        self._flowing = bool(arrived)
        if not arrived:
            return
        self._adapt_wait(sum(batch.ends.size for _, batch in arrived), self._receiver.slots)
        self.problem, self.broken = "", False
        self.counters.dropped = self._receiver.dropped
        for peer, batch in arrived:
            if peer == self._own or not batch.data:
                continue
            self._take(self.sources.of(peer, address_text(*peer)), batch)

    def _drain(self) -> list[tuple[Peer, Batch]]:
        """What waits in the socket."""
        assert self._receiver is not None
        try:
            return self._receiver.drain()
        except OSError as error:  # a connected socket hears of a port that nobody listens on
            self._failed(error)
            return []

    def _adapt_wait(self, datagrams: int, slots: int) -> None:
        """How long to let datagrams gather before the next fetch; not at all while more are waiting."""
        if datagrams >= slots:
            self._wait_s = 0.0
            return
        wait = max(self._wait_s, _SHORTEST_WAIT_S) * min(_MANY_DATAGRAMS / datagrams, 2.0)
        longest = _LONGEST_WATCHED_WAIT_S if self.watched else _LONGEST_WAIT_S
        longest = _LONGEST_IMMEDIATE_WAIT_S if self.immediate else longest
        self._wait_s = min(max(wait, _SHORTEST_WAIT_S), longest)

    def _reopen(self, timeout_s: float) -> bool:
        if not self._retry.due(timeout_s):
            return False
        try:
            self._open()
        except OSError as error:
            self._failed(error)
            return False
        self._retry.reset()
        return True

    def send(self, data: bytes, wait_s: float = 0.0) -> None:
        if self._sender is None:
            return
        for peer in self._receivers():
            try:
                self._sender.sendto(data, peer) if peer else self._sender.send(data)
                self._sent(len(data))
            except OSError:
                self._unsent()

    def _receivers(self) -> list[Peer | None]:
        """Whom to send to; None where the socket is connected."""
        if self.url.kind in (LinkKind.UDP_OUT, LinkKind.UDP_MULTICAST):
            return [None]
        heard: list[Peer | None] = [source.peer for source in self.sources.recent()]
        return heard or ([self._target] if self._target else [])

    def close(self) -> None:
        self.connected = False
        for sock in (self._socket, self._sender):
            if sock is not None:
                sock.close()
