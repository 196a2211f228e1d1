"""Several peers on one link, over real sockets: no byte of one ever stands inside a frame of another."""

import socket
import threading
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path

from patience import PATIENCE_S
from traffic import Vehicle, wait_until
from wire_streams import wire_streams

from gcs.links.opening import Link, TcpServerLink, UdpLink, open_link
from gcs.links.sources import MOST_PEERS, PEER_MEMORY_S, Sources
from gcs.mavlink.dialect import Dialect
from gcs.recording.reader import Recording
from gcs.station.capture import Capture

Streams = dict[str, bytes]


def listen(link: Link, expected: int, meanwhile: Callable[[], object] = lambda: None) -> Streams:
    """What each source sent, until `expected` bytes have come."""
    streams: Streams = {}

    def enough() -> bool:
        meanwhile()
        while (batch := link.receive(0.02)) is not None:
            name = batch.source or link.name
            streams[name] = streams.get(name, b"") + batch.data
        return sum(map(len, streams.values())) >= expected

    wait_until(enough)
    return streams


def udp_port() -> UdpLink:
    link = open_link("udpin:127.0.0.1:0")
    assert isinstance(link, UdpLink)
    return link


def clients(stack: ExitStack, port: int, count: int, kind: socket.SocketKind) -> list[socket.socket]:
    """Sockets connected to a port of this machine."""
    made = [stack.enter_context(socket.socket(socket.AF_INET, kind)) for _ in range(count)]
    for client in made:
        client.connect(("127.0.0.1", port))
    return made


def test_frames_of_two_udp_peers_survive_when_their_datagrams_interleave_inside_a_frame(tmp_path: Path) -> None:
    vehicles = [Vehicle(1), Vehicle(2)]
    sent = [b"", b""]
    path = tmp_path / "two.mcap"
    with ExitStack() as stack:
        link = stack.enter_context(closing(udp_port()))
        peers = clients(stack, link.port, 2, socket.SOCK_DGRAM)
        capture = Capture(path, Dialect.load())
        for i in range(100):
            frames = [vehicle.attitude(0.01 * i) for vehicle in vehicles]
            for half in (slice(0, 20), slice(20, None)):
                for k, peer in enumerate(peers):
                    peer.send(frames[k][half])
                    sent[k] += frames[k][half]

        def take() -> bool:
            while (batch := link.receive(0.02)) is not None:
                capture.take(batch.source or link.name, batch)
            return capture.bytes == sum(map(len, sent))

        wait_until(take)
        capture.close(0)
        assert capture.messages == 200
        recording = Recording(path)
        streams = {source: b"".join(data for _, data in pieces) for source, pieces in wire_streams(recording).items()}
        assert streams == {link.name: sent[0], f"{link.name}#2": sent[1]}
        assert [entry["address"] for entry in link.sources.to_json()] == [
            f"127.0.0.1:{peer.getsockname()[1]}" for peer in peers
        ]
        assert [len(columns) for columns in recording.columns("ATTITUDE")] == [100, 100]


def test_datagrams_of_many_peers_at_once_keep_their_order_and_their_arrival_times() -> None:
    with ExitStack() as stack:
        link = stack.enter_context(closing(udp_port()))
        peers = clients(stack, link.port, 5, socket.SOCK_DGRAM)
        for i in range(400):
            for k, peer in enumerate(peers):
                peer.send(bytes([k, i % 256]))
        streams = listen(link, 400 * 5 * 2)
    expected = b"".join(bytes([i % 256]) for i in range(400))
    assert {data[::2] for data in streams.values()} == {bytes([k]) * 400 for k in range(5)}
    assert all(data[1::2] == expected for data in streams.values())
    assert set(streams) == {link.name, *(f"{link.name}#{k}" for k in range(2, 6))}


def test_tcp_clients_are_served_together_and_never_mix() -> None:
    with ExitStack() as stack:
        link = open_link("tcpin:127.0.0.1:0")
        assert isinstance(link, TcpServerLink)
        stack.enter_context(closing(link))
        peers = clients(stack, link.port, 3, socket.SOCK_STREAM)
        wait_until(lambda: link.receive(0.01) is None and link.counters.connections == 3)
        vehicles = [Vehicle(k + 1) for k in range(3)]
        sent = [b"".join(vehicle.attitude(0.01 * i) for i in range(200)) for vehicle in vehicles]
        at = 0

        def pieces() -> None:
            nonlocal at
            for k, peer in enumerate(peers):
                peer.sendall(sent[k][at : at + 333])
            at += 333

        streams = listen(link, sum(map(len, sent)), pieces)
        assert sorted(streams.values()) == sorted(sent)
        link.send(b"to all")
        for peer in peers:
            peer.settimeout(PATIENCE_S)
            assert peer.recv(100) == b"to all"


def test_a_tcp_client_that_does_not_read_delays_nobody_and_never_gets_half_a_frame() -> None:
    frames = [Vehicle(k % 250 + 1).attitude(0.1) * 400 for k in range(1000)]
    total = sum(map(len, frames))
    with ExitStack() as stack:
        link = open_link("tcpin:127.0.0.1:0")
        assert isinstance(link, TcpServerLink)
        stack.enter_context(closing(link))
        slow = stack.enter_context(socket.socket())
        slow.connect(("127.0.0.1", link.port))
        quick = stack.enter_context(socket.create_connection(("127.0.0.1", link.port)))
        wait_until(lambda: link.receive(0.01) is None and link.counters.connections == 2)
        arrived = bytearray()

        def read() -> None:
            while len(arrived) < total:
                arrived.extend(quick.recv(1 << 16))

        reader = threading.Thread(target=read)
        reader.start()
        for i, frame in enumerate(frames):
            behind = (i - 10) * len(frame)
            wait_until(lambda behind=behind: len(arrived) >= behind)  # type: ignore[misc]
            link.send(frame)
        link.receive(0.01)
        assert link.counters.send_errors > 0
        # What the slow one gets in the end is made of whole pieces.
        slow.settimeout(PATIENCE_S)
        got = bytearray()

        def caught_up() -> bool:
            got.extend(slow.recv(1 << 16))
            link.receive(0.01)
            return len(got) + total == link.counters.bytes_sent

        wait_until(caught_up)
        assert len(got) % len(frames[0]) == 0
        expected = iter(frames)
        for i in range(0, len(got), len(frames[0])):
            piece = bytes(got[i : i + len(frames[0])])
            assert any(frame == piece for frame in expected)
        reader.join(PATIENCE_S)
    assert bytes(arrived) == b"".join(frames)


def test_broadcast_reaches_whoever_listens_and_then_stays_with_who_answered() -> None:
    with ExitStack() as stack:
        vehicles = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2)]
        for vehicle in vehicles:
            vehicle.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            vehicle.settimeout(PATIENCE_S)
        vehicles[0].bind(("0.0.0.0", 0))
        port = vehicles[0].getsockname()[1]
        vehicles[1].bind(("0.0.0.0", port))
        link = stack.enter_context(closing(open_link(f"udpbcast:127.255.255.255:{port}")))
        wait_until(lambda: link.receive(0.01) is None and link.connected)
        link.send(b"anybody?")
        answers = [vehicle.recvfrom(100) for vehicle in vehicles]
        assert [data for data, _ in answers] == [b"anybody?"] * 2
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("127.0.0.1", 0))
            other.settimeout(PATIENCE_S)
            other.sendto(b"here", answers[0][1])
            assert listen(link, 4) == {link.name: b"here"}
            link.send(b"you")
            assert other.recv(100) == b"you"
        vehicles[0].settimeout(0.0)
        assert not _waiting(vehicles[0])


def _waiting(sock: socket.socket) -> bool:
    try:
        return bool(sock.recv(100))
    except BlockingIOError:
        return False


def test_members_of_a_multicast_group_hear_each_other_and_not_themselves() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        url = f"mcast:{probe.getsockname()[1]}"
    with closing(open_link(url)) as first, closing(open_link(url)) as second:
        for link in (first, second):
            wait_until(lambda link=link: link.receive(0.01) is None and link.connected)  # type: ignore[misc]
        first.send(b"from the first")
        second.send(b"from the second")
        assert listen(second, 14) == {url: b"from the first"}
        assert listen(first, 15) == {url: b"from the second"}


def test_names_are_few_however_many_peers_come_and_go() -> None:
    sources = Sources("tcpin:h:1")
    for port in range(100):
        assert sources.of(("h", port), "").name == "tcpin:h:1"
        sources.forget(("h", port))
    together = {sources.of(("h", port), "").name for port in range(MOST_PEERS)}
    assert len(together) == MOST_PEERS
    assert sources.of(("h", 1000), "").name == f"tcpin:h:1#{MOST_PEERS}"
    assert len(sources.recent()) == MOST_PEERS
    for entry in sources._slots:
        entry.heard -= PEER_MEMORY_S + 1
    assert sources.recent() == []
    assert sources.of(("h", 2000), "").name == "tcpin:h:1"
