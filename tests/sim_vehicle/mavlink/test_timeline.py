"""Actions at flight times: in a file's own time, and on the thread that keeps the wall clock."""

import threading

import pytest
from patience import PATIENCE_S

from sim_vehicle.errors import SinkError
from sim_vehicle.mavlink.pacing import Pacer
from sim_vehicle.mavlink.timeline import Timeline


def test_without_a_clock_time_goes_on_when_told() -> None:
    timeline, done = Timeline(None), []
    for name, when in (("b", 2.0), ("a", 1.0), ("c", 2.0), ("d", 3.0)):
        timeline.at(when, lambda name=name: done.append(name))
    timeline.advance(0.5)
    assert done == []
    timeline.advance(2.0)
    assert done == ["a", "b", "c"]
    timeline.finish()
    assert done == ["a", "b", "c", "d"]


class SteppedClock:
    """Stands still until it is told to run, then goes on 3 ms whenever it is read."""

    def __init__(self) -> None:
        self.now = 0.0
        self.runs = False

    def __call__(self) -> float:
        self.now += 0.003 * self.runs
        return self.now


def test_on_the_clock_nothing_is_done_early_or_out_of_order() -> None:
    clock = SteppedClock()
    pacer = Pacer(2.0, clock)
    pacer.wait_until(0.0)
    timeline, done = Timeline(pacer), []
    # Between two ticks of 20 ms, and given latest first.
    for when in (0.093, 0.051, 0.0715, 0.07, 0.047):
        timeline.at(when, lambda when=when: done.append((when, 2.0 * clock.now)))
    assert done == []
    clock.runs = True
    timeline.finish()
    assert [when for when, _ in done] == [0.047, 0.051, 0.07, 0.0715, 0.093]
    # Within the steps of 6 ms of flight in which it looked, and a step is taken for each action that is due.
    assert all(when - 1e-9 <= ran <= when + 0.02 for when, ran in done)


def test_an_error_is_told_to_the_next_who_gives_an_action() -> None:
    pacer = Pacer()
    pacer.wait_until(0.0)
    timeline, failed = Timeline(pacer), threading.Event()

    def fail() -> None:
        failed.set()
        raise SinkError("the link is gone")

    timeline.at(0.0, fail)
    assert failed.wait(PATIENCE_S)
    with pytest.raises(SinkError, match="the link is gone"):
        timeline.finish()
    with pytest.raises(SinkError, match="the link is gone"):
        timeline.at(0.0, fail)


def test_closing_drops_what_is_left() -> None:
    pacer = Pacer()
    pacer.wait_until(0.0)
    timeline, done = Timeline(pacer), []
    timeline.at(3600.0, lambda: done.append(1))
    timeline.close()
    assert done == []
