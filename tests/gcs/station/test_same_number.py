"""Two vehicles of one number: said while they fly and in their flight, and never of one vehicle."""

import re
from pathlib import Path

import pytest
from recorder_rig import Rig
from traffic import SECOND, Vehicle, batch

from gcs.recording.parts import WARNINGS

ONE, OTHER = "udpin:0.0.0.0:14550", "udpin:0.0.0.0:14550/127.0.0.1:40001"


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


def together(rig: Rig, seconds: int, *heard: tuple[str, Vehicle], late_ns: int = 0) -> None:
    """What each vehicle sends in so many seconds, over its source; the last one's comes late."""
    for _ in range(seconds):
        for number, (source, vehicle) in enumerate(heard):
            sent = vehicle.second()
            late = late_ns if number == len(heard) - 1 else 0
            for i in range(0, len(sent), 5):
                at = rig.now + late + i * SECOND // len(sent)
                rig.recorder.feed(source, batch(sent[i : i + 5], at, SECOND // 10))
        rig.now += SECOND
        rig.recorder.tick(rig.now)


def booted(ms: int, system: int = 7) -> Vehicle:
    vehicle = Vehicle(system)
    vehicle.boot_ms = ms
    return vehicle


@pytest.mark.parametrize("ahead_ms", [800_000, 6_000, -800_000])
def test_two_vehicles_of_one_number_are_said_with_what_to_do_and_in_their_flight(rig: Rig, ahead_ms: int) -> None:
    one, other = booted(1_000_000), booted(1_000_000 + ahead_ms)
    together(rig, 3, (ONE, one), (OTHER, other))
    assert rig.recorder.state.doubled == ""  # not sure yet
    together(rig, 3, (ONE, one), (OTHER, other))
    said = rig.recorder.state.doubled
    assert said.startswith(f"two vehicles send as system 7, their clocks {abs(ahead_ms) // 1000} s apart")
    assert "SYSID_THISMAV, MAV_SYS_ID on a PX4" in said
    assert not re.search(r"\d+\.\d+\.\d+", said)  # health is open, and a shared link shows the flight
    together(rig, 13, (ONE, one))
    assert rig.recorder.state.doubled == ""
    (flight,) = rig.finish()
    assert rig.recording(flight).metadata()[WARNINGS] == {"same number": said}


def test_one_vehicle_over_two_links_that_starts_anew_and_whose_clock_is_set_is_one(rig: Rig) -> None:
    links = []
    for boot_ms in (100_000, 900_000, 5_000, 500_000):  # a jump, a reboot, a jump
        links = [booted(boot_ms), booted(boot_ms)]
        together(rig, 8, (ONE, links[0]), (OTHER, links[1]), late_ns=2 * SECOND)
        assert rig.recorder.state.doubled == ""
    together(rig, 8, (ONE, links[0]), (OTHER, links[1]))
    assert rig.recorder.state.doubled == ""
    assert all(WARNINGS not in rig.recording(flight).metadata() for flight in rig.finish())


def test_what_a_link_held_back_is_not_another_vehicle(rig: Rig) -> None:
    fast, held = booted(100_000), booted(80_000)
    for _ in range(8):  # 20 s behind, and nearer with each second
        together(rig, 1, (ONE, fast), (OTHER, held))
        held.boot_ms += 2_000
    assert rig.recorder.state.doubled == ""


def test_two_vehicles_of_two_numbers_and_one_after_the_other_are_no_trouble(rig: Rig) -> None:
    together(rig, 6, (ONE, booted(100_000, 1)), (OTHER, booted(900_000, 2)))
    together(rig, 6, (ONE, booted(900_000, 3)))
    together(rig, 6, (OTHER, booted(100_000, 3)))
    assert rig.recorder.state.doubled == ""
