"""Passing frames on to other ground stations and back, over real sockets."""

import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import pytest
from mavlink_frames import Sender
from patience import PATIENCE_S
from processes import free_port
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from traffic import Vehicle, decode, wait_until

from gcs.links.datagrams import Batch
from gcs.links.opening import TcpServerLink, UdpLink, open_link
from gcs.mavlink.dialect import Dialect
from gcs.station.forwarding import Forwarder, ForwardingCounts
from gcs.station.forwardrules import ForwardRule
from gcs.station.own_sender import StationVoice
from gcs.station.station import Station
from gcs.station.warmup import warm_up

KEY, FOREIGN_KEY = bytes(range(32)), bytes(range(100, 132))


class Taken:
    """What a station took, by source."""

    def __init__(self) -> None:
        self.streams: dict[str, bytes] = {}

    def __call__(self, source: str, batch: Batch) -> None:
        self.streams[source] = self.streams.get(source, b"") + batch.data


class Peer:
    """A UDP socket of a vehicle or another ground station, whose received datagrams are kept."""

    def __init__(self, stack: ExitStack, port: int | None = None) -> None:
        self.socket = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self.socket.bind(("127.0.0.1", 0))
        if port is not None:
            self.socket.connect(("127.0.0.1", port))
        self.socket.setblocking(False)
        self.got: list[bytes] = []
        self.caller: tuple[str, int] | None = None

    @property
    def port(self) -> int:
        return int(self.socket.getsockname()[1])

    def look(self) -> list[bytes]:
        """Everything received so far but the station's own heartbeats and clock messages."""
        while True:
            try:
                data, self.caller = self.socket.recvfrom(65536)
            except (BlockingIOError, ConnectionRefusedError):
                return self.got
            (message,) = decode(data)
            if message.get_srcSystem() != 255:
                self.got.append(data)

    def answer(self, data: bytes) -> None:
        assert self.caller is not None
        self.socket.sendto(data, self.caller)


@contextmanager
def running(
    vehicles: list[str], stations: list[str], take: Callable[[str, Batch], None], key: bytes | None = None
) -> Iterator[Station]:
    warm_up(Dialect.load())  # as the commands do: what waits for the compiler for too long is not passed on
    links, forward = [open_link(url) for url in vehicles], [open_link(url) for url in stations]
    station = Station(links, take, lambda now: None, forward, voice=StationVoice(key))
    station.start()
    try:
        yield station
    finally:
        station.stop()


def frames_of_all_kinds() -> list[bytes]:
    """MAVLink 1 and 2, signed by somebody else's key, and of an id that the dialect does not know."""
    vehicle, old, signed = Sender(1), Sender(1, version=1, seed=1), Sender(1, seed=2)
    signed.sign_from_now(FOREIGN_KEY)
    frames = [
        one.send(name).frame for one in (vehicle, old, signed) for name in ("ATTITUDE", "HEARTBEAT", "SYS_STATUS")
    ]
    unknown = bytearray(vehicle.send("ATTITUDE").frame)
    unknown[7:10] = (60_000).to_bytes(3, "little")
    crc = mavlink.x25crc(bytes(unknown[1:-2]))
    crc.accumulate(bytes([77]))
    unknown[-2:] = crc.crc.to_bytes(2, "little")
    return [*frames, bytes(unknown)]


def test_frames_go_both_ways_byte_for_byte_and_not_between_ground_stations() -> None:
    sent, taken = frames_of_all_kinds(), Taken()
    with ExitStack() as stack:
        first, second = Peer(stack), Peer(stack)
        urls = [f"udpout:127.0.0.1:{peer.port}" for peer in (first, second)]
        port = free_port()
        vehicle = Peer(stack, port)
        with running([f"udpin:127.0.0.1:{port}"], urls, taken, KEY) as station:
            for frame in sent:
                vehicle.socket.send(b"noise" + frame)
            wait_until(lambda: len(first.look()) == len(sent) == len(second.look()))
            assert first.got == second.got == sent
            commands = []
            for number, peer in enumerate((first, second)):
                operator = Sender(240 + number, 190, seed=number)
                operator.sign_from_now(FOREIGN_KEY)
                commands.append(operator.send("COMMAND_LONG").frame)
                peer.answer(commands[-1])
            wait_until(lambda: len(vehicle.look()) == 2)
            assert sorted(vehicle.got) == sorted(commands)
            # Now that both have been answered, the next frame comes behind whatever went astray.
            vehicle.socket.send(sent[0][:4] + bytes([99]) + sent[0][5:])  # a broken one stays here
            last = Sender(1, seed=9).send("STATUSTEXT").frame
            vehicle.socket.send(last)
            wait_until(lambda: first.look()[-1] == last == second.look()[-1])
            assert len(first.got) == len(second.got) == len(sent) + 1
            assert (station._forwarder.counts.frames, station._forwarder.counts.copies) == (len(sent) + 3, 0)  # type: ignore[union-attr]
    for url, command in zip(urls, commands, strict=True):
        assert taken.streams[f"forward:{url}"] == command


def test_a_vehicle_on_two_links_is_passed_on_once_and_an_echo_never() -> None:
    taken = Taken()
    with ExitStack() as stack:
        other = Peer(stack)
        ports = [free_port(), free_port()]
        radios = [Peer(stack, port) for port in ports]
        with running([f"udpin:127.0.0.1:{p}" for p in ports], [f"udpout:127.0.0.1:{other.port}"], taken) as station:
            sender = Vehicle()
            sent = [sender.attitude(0.01 * i) for i in range(200)]
            for i, frame in enumerate(sent):
                for number, radio in enumerate(radios):
                    if i % 7 != number:  # each loses others
                        radio.socket.send(frame)
            wait_until(lambda: len(other.look()) >= 200)
            assert sorted(other.got) == sorted(sent)
            # A ring of stations, by which everything comes again from elsewhere.
            ring = Peer(stack, ports[0])
            for frame in sent:
                ring.socket.send(frame)
            # A station that sends everything back, as one does that forwards to us in turn.
            for frame in sent:
                other.answer(frame)
            command = Sender(240, 190).send("COMMAND_LONG").frame
            other.answer(command)
            wait_until(lambda: all(radio.look() for radio in radios))
            assert [radio.got for radio in radios] == [[command], [command]]
            assert station._forwarder is not None
            heard_twice = 200 - sum(i % 7 in (0, 1) for i in range(200))
            wait_until(lambda: station._forwarder.counts.copies == heard_twice + 400)  # type: ignore[union-attr]
            assert len(other.look()) == 200


def test_a_command_reaches_the_vehicle_though_its_every_frame_came_from_the_vehicles_side_before() -> None:
    taken = Taken()
    with ExitStack() as stack:
        operator, port = Peer(stack), free_port()
        vehicle, attacker = Peer(stack, port), Peer(stack, port)
        with running([f"udpin:127.0.0.1:{port}"], [f"udpout:127.0.0.1:{operator.port}"], taken):
            vehicle.socket.send(Vehicle().attitude(0.1))
            wait_until(operator.look)
            said = mavlink.MAVLink(None, srcSystem=240, srcComponent=190)
            command = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            every = []
            for sequence in range(256):
                said.seq = sequence
                every.append(bytes(command.pack(said)))
            for frame in every:
                attacker.socket.send(frame)
            wait_until(lambda: len(operator.look()) == 257)
            operator.answer(Sender(240, 190).send("STATUSTEXT").frame)
            wait_until(lambda: len(vehicle.look()) == 1)
            operator.answer(every[77])
            wait_until(lambda: every[77] in vehicle.look())
            assert vehicle.got.count(every[77]) == 1
            assert not set(every) & set(vehicle.got[:1])


@pytest.mark.whole_flight
def test_a_ground_station_that_does_not_read_holds_up_nothing() -> None:
    taken = Taken()
    with ExitStack() as stack:
        deaf = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        well = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        port, nobody = free_port(), free_port()
        urls = [f"tcp:127.0.0.1:{server.getsockname()[1]}" for server in (deaf, well)]
        with running([f"tcpin:127.0.0.1:{port}"], [*urls, f"udpout:127.0.0.1:{nobody}"], taken) as station:
            vehicle = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
            reader = stack.enter_context(well.accept()[0])
            stack.enter_context(deaf.accept()[0])
            wait_until(lambda: all(link.connected for link in station.forward))
            heard = bytearray()

            def listen() -> None:
                while data := reader.recv(1 << 16):
                    heard.extend(data)

            listener = threading.Thread(target=listen)
            listener.start()
            sender = Sender(1, seed=4)
            piece = b"".join(sender.send("GPS_STATUS").frame for _ in range(1000))
            rounds = 0

            def overflowing() -> bool:
                nonlocal rounds
                vehicle.sendall(piece)
                rounds += 1
                # The listener keeps up, so that only the deaf one is behind.
                wait_until(lambda: len(taken.streams.get(f"tcpin:127.0.0.1:{port}", b"")) == rounds * len(piece))
                wait_until(lambda: len(heard) >= min(rounds, 1) * len(piece))
                return station.forward[0].counters.send_errors > 0

            wait_until(overflowing)
            assert taken.streams[f"tcpin:127.0.0.1:{port}"] == piece * rounds
            assert station.forward[2].counters.send_errors > 0
            wait_until(lambda: len(heard) == station.forward[1].counters.bytes_sent)
            assert decode(bytes(heard[: len(piece)]))[0].get_type() == "GPS_STATUS"
        listener.join(PATIENCE_S)


def test_pieces_of_two_vehicles_never_mix_on_the_way_to_a_ground_station() -> None:
    taken = Taken()
    with ExitStack() as stack:
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        port = free_port()
        url = f"tcp:127.0.0.1:{server.getsockname()[1]}"
        with running([f"udpin:127.0.0.1:{port}"], [url], taken) as station:
            reader = stack.enter_context(server.accept()[0])
            reader.settimeout(PATIENCE_S)
            wait_until(lambda: station.forward[0].connected)
            vehicles, peers = [Vehicle(1), Vehicle(2)], [Peer(stack, port), Peer(stack, port)]
            sent: list[list[bytes]] = [[], []]
            got = b""
            # Whole frames first, so that all code is loaded before halves of frames wait for each other.
            for pieces in ((slice(0, None),), (slice(0, 9), slice(9, None))):
                for i in range(50):
                    frames = [vehicle.attitude(0.1 * i) for vehicle in vehicles]
                    for part in pieces:
                        for k in (0, 1):
                            peers[k].socket.send(frames[k][part])
                    for k in (0, 1):
                        sent[k].append(frames[k])
                while len(got) < sum(len(frame) for frames in sent for frame in frames):
                    got += reader.recv(1 << 16)
            messages = decode(got)
            for k in (0, 1):
                own = [bytes(m.get_msgbuf()) for m in messages if m.get_srcSystem() == k + 1]
                assert own == sent[k]


@pytest.mark.parametrize("key", [None, KEY])
def test_only_the_stations_own_frames_are_signed_and_only_when_told_to(key: bytes | None) -> None:
    with ExitStack() as stack:
        port = free_port()
        vehicle = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        vehicle.connect(("127.0.0.1", port))
        vehicle.settimeout(PATIENCE_S)
        with running([f"udpin:127.0.0.1:{port}"], [], Taken(), key):
            vehicle.send(Vehicle().heartbeat())
            frames = [vehicle.recv(1000) for _ in range(2)]
    checker = mavlink.MAVLink(None)
    checker.signing.secret_key = KEY
    for frame in frames:
        assert frame[5] == 255
        assert bool(frame[2] & 1) is (key is not None)
        if key is not None:
            assert checker.check_signature(bytearray(frame), frame[5], frame[6])
    sequence = [frame[4] for frame in frames]
    assert sequence[1] == sequence[0] + 1


def test_links_of_both_kinds_are_given_back() -> None:
    with running(["udpin:127.0.0.1:0"], ["tcpin:127.0.0.1:0"], Taken()) as station:
        (link,), (forward,) = station.links, station.forward
        assert isinstance(link, UdpLink)
        assert isinstance(forward, TcpServerLink)
        ports = link.port, forward.port
    for port, kind in zip(ports, (socket.SOCK_DGRAM, socket.SOCK_STREAM), strict=True):
        with socket.socket(socket.AF_INET, kind) as again:
            again.bind(("127.0.0.1", port))


@pytest.mark.whole_flight
def test_two_stations_that_forward_to_each_other_pass_everything_on_once() -> None:
    taken = [Taken(), Taken()]
    with ExitStack() as stack:
        ports = [free_port(), free_port()]
        vehicle = Peer(stack, ports[0])
        stations = [
            stack.enter_context(
                running([f"udpin:127.0.0.1:{ports[k]}"], [f"udpout:127.0.0.1:{ports[1 - k]}"], taken[k])
            )
            for k in (0, 1)
        ]
        craft = Vehicle()
        sent = [craft.attitude(0.01 * i) for i in range(100)]
        for frame in sent:
            vehicle.socket.send(frame)

        def own_frames(k: int) -> list[bytes]:
            """What station k heard of itself, round the ring."""
            messages = decode(taken[k].streams.get(f"forward:udpout:127.0.0.1:{ports[1 - k]}", b""))
            return [bytes(message.get_msgbuf()) for message in messages]

        first = stations[0]._forwarder
        assert first is not None
        wait_until(lambda: first.counts.copies >= 100 and all(len(own_frames(k)) >= 6 for k in (0, 1)))
        for k in (0, 1):
            # Both stations are system 255, so their first frames are alike: each may come from either.
            assert max(Counter(own_frames(k)).values()) <= 2
        assert taken[1].streams[f"udpin:127.0.0.1:{ports[1]}"] == b"".join(sent)
        assert taken[0].streams[f"udpin:127.0.0.1:{ports[0]}#2"] == b"".join(sent)


def test_what_waited_too_long_is_not_passed_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs.station.forwarding.STALE_S", 1.0)
    with ExitStack() as stack:
        other = Peer(stack)
        link = open_link(f"udpout:127.0.0.1:{other.port}")
        stack.callback(link.close)
        link.receive(0.01)
        forwarder = Forwarder([], [link], Dialect.load())
        old, new = Vehicle(1).attitude(), Vehicle(2).attitude()
        forwarder.offer("old", Batch.of([(old, 0)]), from_vehicle=True)
        time.sleep(1.1)
        forwarder.start()
        forwarder.offer("new", Batch.of([(new, 0)]), from_vehicle=True)
        wait_until(other.look)
        forwarder.stop(30)
        assert other.got == [new]
        assert forwarder.counts.dropped_bytes == len(old)


def test_only_what_may_reaches_the_vehicles_and_the_rest_is_counted() -> None:
    taken = Taken()
    with ExitStack() as stack:
        port, other = free_port(), free_port()
        vehicle = Peer(stack, port)
        links, forward = [open_link(f"udpin:127.0.0.1:{port}")], [open_link(f"udpin:127.0.0.1:{other}")]
        rules = {forward[0].name: ForwardRule(systems=frozenset({254}))}
        station = Station(links, taken, lambda now: None, forward, rules=rules, forward_key=KEY)
        station.start()
        stack.callback(station.stop)
        ours, stranger, unsigned = Sender(254, 190), Sender(253, 190), Sender(254, 190, seed=5)
        now = (time.time_ns() - 1_420_070_400_000_000_000) // 10_000
        for one in (ours, stranger):
            one.sign_from_now(KEY)
            one.mavlink.signing.timestamp = now
        ground = Peer(stack, other)
        vehicle.socket.send(Sender(1).send("HEARTBEAT").frame)
        wait_until(station.links[0].sources.recent)
        good = ours.send("COMMAND_LONG").frame
        for frame in (stranger.send("COMMAND_LONG").frame, unsigned.send("COMMAND_LONG").frame, good):
            ground.socket.send(frame)
        wait_until(vehicle.look)
        assert vehicle.got == [good]
        assert station._forwarder is not None
        assert station._forwarder.counts == ForwardingCounts(frames=1, refused=3)  # with the vehicle's own heartbeat
        assert sum(map(len, taken.streams.values())) > len(good)  # all is recorded
