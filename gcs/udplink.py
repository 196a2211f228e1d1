"""UDP links."""

from __future__ import annotations

import select
import socket
import time

from gcs.datagrams import Batch, DatagramReceiver
from gcs.errors import LinkError
from gcs.link import Backoff, Link, resolve
from gcs.linkurl import LinkKind, LinkUrl

RECEIVE_BUFFER_BYTES = 4 * 1024 * 1024  # holds about 25 s of ordinary telemetry while the process is held up
# Waking up is what costs at ordinary rates. The kernel stamps the arrival of datagrams, so they may wait together:
# long where few come, short where many do.
_LONGEST_WAIT_S = 0.05
_SHORTEST_WAIT_S = 0.002
_MANY_DATAGRAMS = 128
_PEER_MEMORY_S = 30.0


class UdpLink(Link):
    """`udpin:` binds and answers whoever spoke within 30 s; `udpout:` sends to one address first."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._listens = url.kind is LinkKind.UDP_IN
        self._socket: socket.socket | None = None
        self._receiver: DatagramReceiver | None = None
        self._peers: dict[tuple[str, int], float] = {}
        self._wait_s = _SHORTEST_WAIT_S
        self._retry = Backoff()
        if self._listens:
            try:
                self._open()
            except OSError as error:
                raise LinkError(
                    f"{url.text}: cannot listen there ({error.strerror or error}); choose another port"
                ) from error

    @property
    def port(self) -> int:
        """The local port, of use where the URL asked for port 0."""
        return int(self._socket.getsockname()[1]) if self._socket else 0

    @property
    def ready(self) -> bool:
        """Whether there is a peer to send to."""
        return self.connected and (not self._listens or bool(self._peers))

    def _open(self) -> None:
        family, address = resolve(self.url, socket.SOCK_DGRAM)
        sock = socket.socket(family, socket.SOCK_DGRAM)
        try:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            sock.setblocking(False)
            receiver = DatagramReceiver(sock)
            if self._listens:
                sock.bind(address)
            else:
                sock.connect(address)
        except OSError:
            sock.close()
            raise
        self._socket, self._receiver = sock, receiver
        self.connected, self.problem = True, ""
        self.counters.connections += 1

    def receive(self, timeout_s: float) -> Batch | None:
        if self._socket is None and not self._reopen(timeout_s):
            return None
        assert self._socket is not None
        assert self._receiver is not None
        if not select.select([self._socket], [], [], timeout_s)[0]:
            return None
        if self._wait_s:
            time.sleep(self._wait_s)
        try:
            batch, peers = self._receiver.drain()
        except OSError as error:  # a connected socket hears of a port that nobody listens on
            self.problem = error.strerror or str(error)
            return None
        if batch is None:
            return None
        self._adapt_wait(batch.ends.size, self._receiver.slots)
        self.problem = ""
        self.counters.dropped = self._receiver.dropped
        now = time.monotonic()
        self._peers.update(dict.fromkeys(peers, now))
        return self._count(batch) if batch.data else None

    def _adapt_wait(self, datagrams: int, slots: int) -> None:
        """How long to let datagrams gather before the next fetch; not at all while more are waiting."""
        if datagrams >= slots:
            self._wait_s = 0.0
        elif datagrams > _MANY_DATAGRAMS:
            self._wait_s = max(self._wait_s / 2, _SHORTEST_WAIT_S)
        elif datagrams < _MANY_DATAGRAMS // 4:
            self._wait_s = min(max(self._wait_s * 2, _SHORTEST_WAIT_S), _LONGEST_WAIT_S)

    def _reopen(self, timeout_s: float) -> bool:
        if not self._retry.due(timeout_s):
            return False
        try:
            self._open()
        except OSError as error:
            self.problem = error.strerror or str(error)
            return False
        self._retry.reset()
        return True

    def send(self, data: bytes) -> None:
        if self._socket is None:
            return
        if self._listens:
            oldest = time.monotonic() - _PEER_MEMORY_S
            self._peers = {peer: seen for peer, seen in self._peers.items() if seen >= oldest}
        for peer in list(self._peers) if self._listens else [None]:
            try:
                self._socket.sendto(data, peer) if peer else self._socket.send(data)
                self.counters.bytes_sent += len(data)
            except OSError:
                self.counters.send_errors += 1

    def close(self) -> None:
        self.connected = False
        if self._socket is not None:
            self._socket.close()
