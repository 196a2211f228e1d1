"""The last minute that a page which opens in flight begins with."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from api_bench import Bench
from serving import serving
from traffic import SECOND, wait_until

from gcs.api.last_minute import LastMinute
from gcs.live.feed import LiveState


def told(number: int, time_s: float, flight: str = "f", **signals: tuple[float, float]) -> LiveState:
    """A state with signals as (value, time of reception, s)."""
    entries = {name: (value, round(at_s * SECOND), "rad") for name, (value, at_s) in signals.items()}
    return LiveState(time_s=time_s, signals=entries, signals_number=number, flight=flight)


def test_the_last_minute_is_kept_and_no_more() -> None:
    minute = LastMinute()
    for number in range(500):
        at_s = 0.25 * number
        minute.look(told(number + 1, at_s, alpha=(1e-7 + number, at_s)))
        minute.look(told(number + 1, at_s, alpha=(0.0, at_s)))  # nothing new was told
    found = minute.to_json()
    assert (found["flight"], len(found["time_s"])) == ("f", 241)
    assert (found["time_s"][0], found["signals"]["alpha"][0]) == (64.75, 259.0)


def test_a_signal_that_stops_or_comes_late_has_no_value_then() -> None:
    minute = LastMinute()
    minute.look(LiveState())
    for number, (alpha_at, beta_at) in enumerate([(1.0, None), (4.0, 4.0), (4.0, 8.0)], 1):
        beta = {} if beta_at is None else {"beta": (0.2, beta_at)}
        minute.look(told(number, float(number), alpha=(0.1, alpha_at), **beta))
    assert minute.to_json()["signals"] == {"alpha": [0.1, 0.1, None], "beta": [None, 0.2, 0.2]}


def test_the_next_flight_begins_anew() -> None:
    minute = LastMinute()
    minute.look(told(1, 50.0, alpha=(0.1, 1.0)))
    minute.look(told(2, 51.0, "g", alpha=(0.2, 2.0)))
    assert minute.to_json() == {"flight": "g", "time_s": [51.0], "signals": {"alpha": [0.2]}}
    minute.look(told(3, 0.5, "g", alpha=(0.3, 3.0)))
    assert minute.to_json()["time_s"] == [0.5]


def test_it_is_read_whole_while_it_is_kept() -> None:
    """Requests are answered in threads of their own, here on and on until as much was kept meanwhile."""
    minute, usual = LastMinute(), sys.getswitchinterval()
    for number in range(200):
        minute.look(told(number + 1, 0.25 * number, alpha=(0.1, 1.0), beta=(0.2, 1.0)))
    answers: list[dict[str, Any]] = []
    begun, over = threading.Event(), threading.Event()

    def read() -> None:
        while len(answers) < 300 or not over.is_set():
            answers.append(minute.to_json())
            begun.set()

    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(1) as pool:
            reading = pool.submit(read)
            begun.wait()
            for number in range(200, 400):
                minute.look(told(number + 1, 0.25 * number, alpha=(0.1, 1.0), beta=(0.2, 1.0)))
            over.set()
            reading.result()
    finally:
        sys.setswitchinterval(usual)
    assert all(len(one["time_s"]) == len(one["signals"]["beta"]) for one in answers)


def test_the_service_keeps_what_it_tells(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    with serving(bench.app) as client:
        assert client.get("/api/live/minute").json() == {"flight": None, "time_s": [], "signals": {}}
        bench.app.state.service.live.state = told(1, 3.0, alpha=(0.1, 1.0))
        wait_until(lambda: client.get("/api/live/minute").json()["signals"] == {"alpha": [0.1]})
