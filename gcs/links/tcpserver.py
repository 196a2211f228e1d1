"""A TCP port that serves several clients at once."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections.abc import Callable, Sequence

from gcs.errors import LinkError
from gcs.links.datagrams import Batch, Peer
from gcs.links.link import Link, address_text, resolve
from gcs.links.outbox import Outbox
from gcs.links.sources import MOST_PEERS
from gcs.links.streams import CLOSED, GATHER_S, LINGER_S, READ_BYTES, prepare_socket, write_some
from gcs.links.url import LinkUrl
from gcs.text.oserrors import is_own, reason

_REFUSED_S = 0.05


class _Client:
    """One connection."""

    def __init__(
        self, sock: socket.socket, peer: Peer, taken: Callable[[int], None], dropped: Callable[[int], None]
    ) -> None:
        prepare_socket(sock)
        self.socket = sock
        self.peer = peer
        self.outbox = Outbox(lambda data: write_some(sock, data), taken, dropped)

    def close(self) -> None:
        """End the connection."""
        self.outbox.close()
        self.socket.close()


class TcpServerLink(Link):
    """`tcpin:HOST:PORT`: every client is a source of its own, and all get what is sent."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        try:
            family, address = resolve(url, socket.SOCK_STREAM)
            self._listener = socket.create_server(address, family=socket.AddressFamily(family), backlog=16)
        except OSError as error:
            raise LinkError(f"{url.text}: cannot listen there ({reason(error)}); choose another port") from error
        self._listener.setblocking(False)
        self._clients: dict[int, _Client] = {}

    @property
    def port(self) -> int:
        """The local port, of use where the URL asked for port 0."""
        return int(self._listener.getsockname()[1])

    def _fetch(self, timeout_s: float) -> None:
        runs: list[tuple[Peer, list[tuple[bytes, int]]]] = []
        deadline = time.monotonic() + timeout_s
        while (left := deadline - time.monotonic()) > 0:
            before = len(runs)
            for client in self._ready_clients(left):
                data = self._read(client)
                if not data:
                    continue
                if not runs or runs[-1][0] != client.peer:
                    runs.append((client.peer, []))
                runs[-1][1].append((data, time.time_ns()))
            if runs and not before:
                deadline = min(deadline, time.monotonic() + GATHER_S)
        for peer, chunks in runs:
            self._take(self.sources.of(peer, address_text(*peer)), Batch.of(chunks))
        self._forget_the_gone()

    def _ready_clients(self, timeout_s: float) -> list[_Client]:
        """Clients with bytes to read; takes in new ones, and gives those that read slowly what they take."""
        poll = select.poll()
        listener = self._listener.fileno()
        if len(self._clients) < MOST_PEERS:
            poll.register(listener, select.POLLIN)
        for number, client in self._clients.items():
            poll.register(number, select.POLLIN | (select.POLLOUT if len(client.outbox) else 0))
        found = poll.poll(1000.0 * timeout_s)
        readable = [number for number, events in found if events & ~select.POLLOUT]
        for number, events in found:
            if events & select.POLLOUT and number in self._clients:
                with contextlib.suppress(OSError):
                    self._clients[number].outbox.flush()
        if listener in readable:
            self._accept()
        return [self._clients[number] for number in readable if number in self._clients]

    def _accept(self) -> None:
        try:
            sock, address = self._listener.accept()
        except OSError as error:
            if is_own(error):  # else it had gone again before it was taken in
                self._failed(error)
                time.sleep(_REFUSED_S)  # it still waits to be taken in, and would be found again at once
            return
        client = _Client(sock, address[:2], self._sent, self._unsent)
        self._clients = {**self._clients, sock.fileno(): client}
        self.connected, self.problem, self.broken = True, "", False
        self.counters.connections += 1

    def _read(self, client: _Client) -> bytes:
        """What the client sent; one that has left is closed."""
        try:
            data = client.socket.recv(READ_BYTES)
            problem = CLOSED
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError as error:
            data, problem = b"", reason(error)
        if not data:
            self._clients = {number: one for number, one in self._clients.items() if one is not client}
            client.close()
            self.connected = bool(self._clients)
            if not self.connected:
                self.problem = problem
        return data

    def _forget_the_gone(self) -> None:
        here = {client.peer for client in self._clients.values()}
        for source in self.sources.recent():
            if source.peer not in here:
                self.sources.forget(source.peer)

    def send(self, data: bytes, wait_s: float = 0.0) -> None:
        self._offer([data], wait_s)

    def send_frames(self, frames: Sequence[bytes]) -> None:
        """Send frames behind one another; waits for nothing."""
        self._offer(frames, 0.0)

    def _offer(self, frames: Sequence[bytes], wait_s: float) -> None:
        for client in list(self._clients.values()):
            taken = 0
            with contextlib.suppress(OSError):  # reading says what became of the client
                taken = client.outbox.offer(frames, wait_s)
            self._unsent(len(frames) - taken)

    def close(self) -> None:
        for client in self._clients.values():
            with contextlib.suppress(OSError):
                client.outbox.flush(LINGER_S)
            client.close()
        self._clients = {}
        self.connected = False
        self._listener.close()
