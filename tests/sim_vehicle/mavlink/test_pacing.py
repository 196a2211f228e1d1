"""The pacer on a clock that the test moves."""

import pytest

from sim_vehicle.mavlink.pacing import Pacer


class Clock:
    """Seconds that pass only by sleeping, or by being pushed."""

    def __init__(self, oversleep: float = 0.0) -> None:
        self.now = 1000.0
        self.slept: list[float] = []
        self._oversleep = oversleep

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += seconds + self._oversleep


def test_errors_of_sleeping_do_not_add_up() -> None:
    clock = Clock(oversleep=0.003)
    pacer = Pacer(1.0, clock, clock.sleep)
    for k in range(501):
        pacer.wait_until(k * 0.02)
    assert clock.now - 1000.0 == pytest.approx(10.003)


def test_speed() -> None:
    clock = Clock()
    pacer = Pacer(4.0, clock, clock.sleep)
    for k in range(101):
        pacer.wait_until(k * 0.02)
    assert clock.now - 1000.0 == pytest.approx(0.5)


def test_a_stall_is_caught_up_without_sleeping() -> None:
    clock = Clock()
    pacer = Pacer(1.0, clock, clock.sleep)
    pacer.wait_until(0.0)
    clock.now += 0.1
    for k in range(1, 6):
        pacer.wait_until(k * 0.02)
    assert clock.slept == []
    pacer.wait_until(0.12)
    assert clock.now - 1000.0 == pytest.approx(0.12)
