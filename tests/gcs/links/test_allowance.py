"""How much one peer may send: against the closed form of a token bucket, and over a real socket."""

import socket
import time
from contextlib import ExitStack, closing

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from traffic import wait_until

from gcs.links.allowance import BURST_S, BYTES_PER_S, Allowance
from gcs.links.datagrams import Batch
from gcs.links.opening import UdpLink, open_link


def batch(sizes: list[int]) -> Batch:
    """Reads of so many bytes, each marked by its number."""
    return Batch.of([(bytes([number % 256]) * size, number) for number, size in enumerate(sizes)])


@given(
    st.lists(
        st.tuples(st.floats(0.0, 2.0), st.lists(st.integers(1, 400), min_size=1, max_size=9)), min_size=1, max_size=40
    )
)
def test_over_any_stretch_no_more_is_taken_than_rate_and_burst_allow(events: list[tuple[float, list[int]]]) -> None:
    allowance, now, taken = Allowance(bytes_per_s=1000.0, burst_s=0.5), 0.0, []
    for pause, sizes in events:
        now += pause
        whole = batch(sizes)
        kept, refused = allowance.take(whole, now)
        size = len(kept.data) if kept else 0
        assert size + refused == len(whole.data)
        if kept:
            assert kept.chunks() == whole.chunks()[: kept.ends.size]  # whole reads, from the front
            assert np.array_equal(kept.received_ns, whole.received_ns[: kept.ends.size])
        taken.append((now, size))
    for first in range(len(taken)):
        for last in range(first, len(taken)):
            between = taken[last][0] - taken[first][0]
            assert sum(size for _, size in taken[first : last + 1]) <= 1000.0 * between + 500.0 + 1e-6


def test_a_peer_within_its_rate_loses_nothing() -> None:
    allowance = Allowance(bytes_per_s=1000.0, burst_s=0.5)
    assert all(allowance.take(batch([10] * 10), 0.1 * turn)[1] == 0 for turn in range(1000))


def test_what_waited_while_the_station_was_held_up_is_taken_whole() -> None:
    allowance = Allowance()
    assert allowance.take(batch([1000]), 0.0)[1] == 0
    assert allowance.take(batch([40_000] * 400), 6.0)[1] == 0  # a whole receive buffer


def test_one_peer_that_floods_is_cut_and_named_and_the_other_heard() -> None:
    link = open_link("udpin:127.0.0.1:0")
    assert isinstance(link, UdpLink)
    with ExitStack() as stack:
        stack.enter_context(closing(link))
        honest, flooding = (stack.enter_context(socket.socket(type=socket.SOCK_DGRAM)) for _ in range(2))
        heard: dict[str, int] = {}

        def hear() -> None:
            while (got := link.receive(0.0)) is not None:
                heard[got.source] = heard.get(got.source, 0) + len(got.data)

        def flood() -> bool:
            for _ in range(20):
                flooding.sendto(bytes(60_000), ("127.0.0.1", link.port))
                hear()
            return link.counters.refused > 0

        honest.sendto(b"h" * 20, ("127.0.0.1", link.port))
        wait_until(lambda: (hear(), heard.get("") == 20)[1])
        began = time.monotonic()
        wait_until(flood)
        honest.sendto(b"h" * 20, ("127.0.0.1", link.port))
        wait_until(lambda: (hear(), heard.get("") == 40)[1])
        (peer,) = link.sources.too_fast()
        assert peer.address == f"127.0.0.1:{flooding.getsockname()[1]}"
        assert heard[peer.name] == peer.bytes <= BYTES_PER_S * (BURST_S + time.monotonic() - began)
        assert link.status()["refused"] == peer.refused >= 60_000
