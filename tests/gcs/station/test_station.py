"""The station's threads live on whatever goes wrong in what they call."""

import logging
import socket
import threading
from contextlib import closing

import pytest
from processes import free_port
from traffic import wait_until

from gcs.links.datagrams import Batch
from gcs.links.opening import open_link
from gcs.links.udp import UdpLink
from gcs.station.station import Station


def test_an_error_that_nobody_thought_of_is_told_in_one_line_and_reception_goes_on(
    caplog: pytest.LogCaptureFixture,
) -> None:
    taken: list[bytes] = []
    ticks = threading.Event()

    def take(source: str, batch: Batch) -> None:
        taken.append(batch.data)
        if len(taken) <= 3:
            raise ZeroDivisionError("float\ndivision")

    def tick(now_ns: int) -> None:
        if len(taken) > 3:
            ticks.set()
        raise KeyError(5)

    port = free_port()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        closing(open_link(f"udpin:127.0.0.1:{port}")) as link,
    ):
        station = Station([link], take, tick)
        station.start()
        try:

            def reached() -> bool:
                sender.sendto(b"one", ("127.0.0.1", port))
                return len(taken) > 5 and ticks.is_set()

            wait_until(reached)
        finally:
            station.stop()
    lines = [record.getMessage() for record in caplog.records if record.levelno == logging.ERROR]
    assert sorted(lines) == [
        "the station goes on after an error: KeyError: 5",
        "the station goes on after an error: ZeroDivisionError: float division",
    ]


@pytest.mark.parametrize(("urls", "forward", "immediate"), [(1, 0, False), (2, 0, True), (1, 1, True)])
def test_where_there_are_several_links_none_lets_datagrams_gather_for_long(
    urls: int, forward: int, immediate: bool
) -> None:
    links = [open_link("udpin:127.0.0.1:0") for _ in range(urls + forward)]
    station = Station(links[:urls], lambda source, batch: None, lambda now_ns: None, links[urls:])
    assert [link.immediate for link in links] == [immediate] * len(links)
    assert not any(link.watched for link in links)
    station.stop()


def test_where_what_comes_is_watched_it_gathers_for_a_short_time_only() -> None:
    link = open_link("udpin:127.0.0.1:0")
    station = Station([link], lambda source, batch: None, lambda now_ns: None, listen=lambda source, batch: None)
    assert link.watched
    assert isinstance(link, UdpLink)
    for _ in range(20):
        link._adapt_wait(1, 1024)
    assert link._wait_s == 0.01
    station.stop()
