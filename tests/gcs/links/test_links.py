"""Links over real sockets and a real pseudo-terminal."""

import socket
import time
from contextlib import closing

import pytest
from patience import PATIENCE_S
from traffic import wait_until

from gcs.errors import LinkError
from gcs.links.datagrams import Batch
from gcs.links.opening import Link, TcpServerLink, UdpLink, open_link
from gcs.links.url import DEFAULT_BAUD, LinkKind, parse_url


@pytest.mark.parametrize(
    ("text", "kind", "host", "port"),
    [
        ("udpin:0.0.0.0:14550", LinkKind.UDP_IN, "0.0.0.0", 14550),
        ("udp:127.0.0.1:14550", LinkKind.UDP_IN, "127.0.0.1", 14550),
        ("udpin::14550", LinkKind.UDP_IN, "0.0.0.0", 14550),
        ("udpout:gcs:14550", LinkKind.UDP_OUT, "gcs", 14550),
        ("udpbcast:192.168.1.255:14550", LinkKind.UDP_BROADCAST, "192.168.1.255", 14550),
        ("mcast:", LinkKind.UDP_MULTICAST, "239.255.145.50", 14550),
        ("mcast:14560", LinkKind.UDP_MULTICAST, "239.255.145.50", 14560),
        ("mcast:239.1.2.3:14560", LinkKind.UDP_MULTICAST, "239.1.2.3", 14560),
        ("tcp:10.0.0.7:5760", LinkKind.TCP_CLIENT, "10.0.0.7", 5760),
        ("tcpin:[::1]:5760", LinkKind.TCP_SERVER, "::1", 5760),
    ],
)
def test_network_urls_mean_what_they_mean_to_pymavlink(text: str, kind: LinkKind, host: str, port: int) -> None:
    url = parse_url(text)
    assert (url.kind, url.host, url.port) == (kind, host, port)


@pytest.mark.parametrize(
    ("text", "device", "baud"),
    [
        ("/dev/ttyUSB0,921600", "/dev/ttyUSB0", 921600),
        ("/dev/serial/by-id/usb-FTDI", "/dev/serial/by-id/usb-FTDI", DEFAULT_BAUD),
        ("/dev/ttyACM*,57600", "/dev/ttyACM*", 57600),
        ("COM7,57600", "COM7", 57600),
    ],
)
def test_serial_urls(text: str, device: str, baud: int) -> None:
    url = parse_url(text)
    assert (url.kind, url.device, url.baud) == (LinkKind.SERIAL, device, baud)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "nonsense",
        "udpin:14550",
        "udpin:host:99999",
        "tcp::5760",
        "udpout:host:0",
        "udpbcast::14550",
        "mcast:10.0.0.1:14550",
        "mcast:fast",
        "/dev/ttyUSB0,fast",
        "http://x:1",
    ],
)
def test_a_wrong_url_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(LinkError) as error:
        parse_url(text)
    assert "\n" not in str(error.value)


def collect(link: Link, size: int, timeout_s: float = 30.0) -> list[Batch]:
    """Batches until `size` bytes have come."""
    batches: list[Batch] = []

    def enough() -> bool:
        found = link.receive(0.1)
        if found is not None:
            batches.append(found)
        return sum(len(entry.data) for entry in batches) >= size

    wait_until(enough, timeout_s)
    return batches


def udp_pair() -> tuple[UdpLink, socket.socket]:
    link = open_link("udpin:127.0.0.1:0")
    assert isinstance(link, UdpLink)
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.connect(("127.0.0.1", link.port))
    return link, sender


def stamping(link: UdpLink, sender: socket.socket) -> bool:
    """Whether the kernel stamps arrivals: it begins to only some time after the first socket asks for it."""
    sender.send(b"probe")
    time.sleep(0.05)
    fetched = time.time_ns()
    (batch,) = collect(link, 5)
    return int(batch.received_ns[0]) < fetched


def test_udp_keeps_every_datagram_in_order_with_its_arrival_time() -> None:
    link, sender = udp_pair()
    with closing(link), sender:
        assert any(stamping(link, sender) for _ in range(100))
        probed = link.counters.reads
        sent = [bytes([i % 256]) * (1 + i % 300) for i in range(2000)]
        before = time.time_ns()
        for data in sent:
            sender.send(data)
        time.sleep(0.5)
        fetched = time.time_ns()
        batches = collect(link, sum(map(len, sent)))
        assert [chunk for entry in batches for chunk in entry.chunks()] == sent
        times = [int(at) for entry in batches for at in entry.received_ns]
        assert times == sorted(times)
        # The kernel stamps arrival, on a busy machine some 20 ms after sending, however late the datagram is fetched.
        assert before - 1_000_000 <= times[0]
        assert times[-1] <= fetched - 200_000_000
        assert link.counters.reads - probed == len(sent)
        assert link.counters.dropped == 0


def test_udp_keeps_datagrams_of_every_size_whole() -> None:
    link, sender = udp_pair()
    with closing(link), sender:
        sizes = (1, 37, 280, 511, 512, 513, 1472, 9000, 65_507)
        sent = [bytes((i * 7 + k) % 251 for k in range(size)) for i in range(4) for size in sizes]
        for data in sent:
            sender.send(data)
        batches = collect(link, sum(map(len, sent)))
        assert [chunk for entry in batches for chunk in entry.chunks()] == sent


def test_udp_counts_what_the_kernel_had_no_room_for() -> None:
    link, sender = udp_pair()
    with closing(link), sender:
        sent = 40_000  # more than any receive buffer of ours holds
        for _ in range(sent):
            sender.send(bytes(1000))
        received = 0
        while (entry := link.receive(0.2)) is not None:
            received += entry.ends.size
        sender.send(b"last")  # the kernel reports its count with the next datagram
        received += collect(link, 4)[-1].ends.size
        assert received < sent
        assert received + link.counters.dropped == sent + 1


def test_udp_answers_every_peer_that_spoke() -> None:
    link, first = udp_pair()
    with closing(link), first, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second:
        second.connect(("127.0.0.1", link.port))
        assert not link.ready
        first.send(b"a")
        second.send(b"b")
        collect(link, 2)
        assert link.ready
        link.send(b"answer")
        for peer in (first, second):
            peer.settimeout(PATIENCE_S)
            assert peer.recv(100) == b"answer"


def test_udp_out_survives_a_port_that_nobody_listens_on() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with closing(open_link(f"udpout:127.0.0.1:{port}")) as link:
        assert link.receive(0.01) is None
        assert link.connected
        assert not link.problem

        def refused() -> bool:
            link.send(b"x")
            return link.receive(0.01) is None and bool(link.problem)

        wait_until(refused)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.bind(("127.0.0.1", port))
            peer.settimeout(0.05)
            callers = []

            def heard() -> bool:
                link.send(b"hello")
                try:
                    data, caller = peer.recvfrom(100)
                except TimeoutError:
                    return False
                callers.append(caller)
                return data == b"hello"

            wait_until(heard)
            peer.sendto(b"telemetry", callers[0])
            assert collect(link, 9)[0].data == b"telemetry"
            assert not link.problem


def test_a_taken_port_is_refused_in_one_line() -> None:
    link, sender = udp_pair()
    with closing(link), sender, pytest.raises(LinkError, match="choose another port"):
        open_link(f"udpin:127.0.0.1:{link.port}")


def test_tcp_client_comes_back_after_the_server_went_away() -> None:
    server = socket.create_server(("127.0.0.1", 0))
    port = server.getsockname()[1]
    with closing(open_link(f"tcp:127.0.0.1:{port}")) as link:
        for round_number in range(2):
            server.settimeout(0.05)
            peer = wait_until(lambda: _accept_while_receiving(server, link))
            with peer:
                peer.sendall(b"telemetry")
                assert collect(link, 9)[0].data == b"telemetry"
                link.send(b"command")
                peer.settimeout(PATIENCE_S)
                assert peer.recv(100) == b"command"
            wait_until(lambda: link.receive(0.01) is None and not link.connected)
            assert link.problem
            assert link.counters.connections == round_number + 1
            assert link.counters.reconnects == round_number
    server.close()


def _accept_while_receiving(server: socket.socket, link: Link) -> socket.socket | None:
    link.receive(0.05)
    try:
        return server.accept()[0]
    except TimeoutError:
        return None


def test_tcp_server_takes_the_next_client_after_the_first() -> None:
    with closing(open_link("tcpin:127.0.0.1:0")) as link:
        assert isinstance(link, TcpServerLink)
        for word in (b"first", b"second"):
            with socket.create_connection(("127.0.0.1", link.port)) as client:
                client.sendall(word)
                assert b"".join(entry.data for entry in collect(link, len(word))) == word
        assert link.counters.connections == 2
