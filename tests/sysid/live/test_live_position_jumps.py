"""GPS positions that jump, against the ground velocity of the same receiver."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.live.signals.position_jumps import PositionJumps
from sysid.live.signals.sensor_failures import SensorFailure
from sysid.live.wording import failure_sentence, failure_text

HZ, JUMPS_S = 5.0, 20.0
RADIUS_M = 6371000.0  # another sphere than that of the nautical mile
Column = tuple[np.ndarray, np.ndarray]


def circle(noise_m: float = 0.0) -> dict[str, Column]:
    """40 s of a circle of 60 m at 15 m/s, 47 deg north, with a wandering position and 0.1 m/s of noise."""
    generator = np.random.default_rng(2)
    time_s = np.arange(0.0, 40.0, 1.0 / HZ)
    turned = 15.0 / 60.0 * time_s
    north, east = 60.0 * np.sin(turned), 60.0 * (1.0 - np.cos(turned))
    place = np.cumsum(noise_m * generator.standard_normal((2, time_s.size)), axis=1)
    speed = 0.1 * generator.standard_normal((2, time_s.size))
    return {
        "lat": (time_s, 47.0 + np.degrees((north + place[0]) / RADIUS_M)),
        "lon": (time_s, 8.0 + np.degrees((east + place[1]) / RADIUS_M / np.cos(np.radians(47.0)))),
        "vn": (time_s, 15.0 * np.cos(turned) + speed[0]),
        "ve": (time_s, 15.0 * np.sin(turned) + speed[1]),
    }


def jumped(columns: dict[str, Column], north_m: float, until_s: float = np.inf) -> dict[str, Column]:
    time_s, lat = columns["lat"]
    there = (time_s >= JUMPS_S) & (time_s < until_s)
    return {**columns, "lat": (time_s, lat + np.degrees(north_m / RADIUS_M) * there)}


def judged(columns: dict[str, Column], late_s: float = 0.0) -> list[SensorFailure]:
    """What is said of a flight that comes in pieces of 0.4 s, velocities later than positions."""
    watch, found = PositionJumps(), []
    for end in np.arange(0.4, 42.0, 0.4):
        piece = {}
        for name, (time_s, values) in columns.items():
            late = late_s if name in ("vn", "ve") else 0.0
            here = (time_s >= end - 0.4 - late) & (time_s < end - late)
            piece[name] = (time_s[here], values[here])
        watch.take(piece)
        if (one := watch.check()) is not None:
            found.append(one)
    return found


@pytest.mark.parametrize("late_s", [0.0, 0.6])
def test_a_position_that_jumps_is_reported_once_with_its_size(late_s: float) -> None:
    (found,) = judged(jumped(circle(0.1), -30.0), late_s)
    assert found.time_s == pytest.approx(JUMPS_S)
    assert found.size == pytest.approx(30.0, abs=1.0)
    assert failure_sentence(found) == (
        "the GPS position jumped by 30 m south since 20.0 s: check its antenna and satellites"
    )
    assert failure_text(found) == "GPS +30 m since 20.0s"


def test_a_turn_one_bad_reading_and_readings_that_are_lost_are_no_jump() -> None:
    flight = circle(0.1)
    assert judged(flight) == []
    assert judged(jumped(flight, 30.0, until_s=JUMPS_S + 0.9 / HZ)) == []
    kept = (flight["lat"][0] < 15.0) | (flight["lat"][0] > 25.0)
    assert judged({name: (time_s[kept], values[kept]) for name, (time_s, values) in flight.items()}) == []


def test_a_receiver_that_always_wanders_far_is_not_reported() -> None:
    assert judged(circle(2.0)) == []
    assert judged({name: one for name, one in circle(0.1).items() if name != "ve"}) == []


def test_velocities_that_are_lost_make_no_jump_and_nothing_grows() -> None:
    flight = {name: (time_s[::5], values[::5]) for name, (time_s, values) in circle(0.1).items()}
    kept = (flight["vn"][0] < 15.0) | (flight["vn"][0] > 30.0)
    for name in ("vn", "ve"):
        time_s, values = flight[name]
        flight[name] = (time_s[kept], values[kept])
    assert judged(flight) == []
    watch, time_s = PositionJumps(), np.arange(0.0, 300.0, 0.2)
    watch.take({"lat": (time_s, np.full(time_s.size, 47.0)), "lon": (time_s, np.full(time_s.size, 8.0))})
    assert watch.check() is None
    assert max(len(held) for held in watch._held.values()) < 60


def test_a_bad_reading_before_a_gap_and_a_receiver_without_a_fix_are_no_jump() -> None:
    flight = jumped(circle(0.1), 30.0, until_s=JUMPS_S + 0.5 / HZ)
    kept = (flight["lat"][0] <= JUMPS_S + 0.01) | (flight["lat"][0] > JUMPS_S + 1.8)
    assert judged({name: (time_s[kept], values[kept]) for name, (time_s, values) in flight.items()}) == []
    flight = circle(0.1)
    for name in ("lat", "lon"):
        time_s, values = flight[name]
        flight[name] = (time_s, np.where(time_s < 10.0, 0.0, values))
    assert judged(flight) == []
