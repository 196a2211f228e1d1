"""A few of the crash campaign's trials (`make campaign NAME=crash` runs thousands)."""

import random
from pathlib import Path

import pytest
from crash_trials import Undamaged, damage_trial, flipped, kill_trial, zeroed

from gcs.recording.repair import complete

pytestmark = pytest.mark.whole_flight


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Undamaged:
    return Undamaged(tmp_path_factory.mktemp("whole") / "whole.mcap")


@pytest.mark.parametrize("seed", [10, 7])
def test_a_killed_station_leaves_an_unbroken_beginning(seed: int, tmp_path: Path) -> None:
    killed = kill_trial(seed, tmp_path, allowed_s=3.0, keeping_up=True)  # the campaign allows 1 s at any moment
    assert killed.wrong == ""
    assert killed.messages > 0


def test_a_file_cut_anywhere_keeps_every_whole_chunk(whole: Undamaged, tmp_path: Path) -> None:
    chance = random.Random(5)
    for _ in range(40):
        at = chance.randrange(len(whole.bytes))
        wrong = damage_trial(whole, whole.bytes[:at], whole.expected_after_cut(at), tmp_path / "a.mcap", complete)
        assert wrong == "", at


def test_a_flipped_bit_costs_one_chunk_at_most(whole: Undamaged, tmp_path: Path) -> None:
    chance = random.Random(6)
    heads = list(range(12)) + [whole.chunks[3][0] + place for place in range(9 + 28)]
    for place in [*heads[::3], *(chance.randrange(len(whole.bytes)) for _ in range(20))]:
        at, bit = place, chance.randrange(8)
        damaged = flipped(whole.bytes, at, bit)
        wrong = damage_trial(whole, damaged, whole.expected_after_damage(at), tmp_path / "a.mcap", complete)
        assert wrong == "", (at, bit)


def test_damage_in_an_unfinished_file_costs_its_own_chunks_and_no_more(whole: Undamaged, tmp_path: Path) -> None:
    chance = random.Random(7)
    data = whole.unfinished
    heads = [whole.chunks[k][0] + chance.randrange(60) for k in range(0, len(whole.chunks), 12)]
    for place in [*heads, *(chance.randrange(len(data)) for _ in range(6))]:
        damaged = flipped(data, place, chance.randrange(8))
        expected = whole.expected_after_damage(place)
        assert damage_trial(whole, damaged, expected, tmp_path / "a.mcap", complete) == "", place
    for _ in range(6):
        place, size = chance.randrange(len(data)), chance.choice((16, 512, 4096))
        expected = whole.expected_after_damage(place, size)
        assert damage_trial(whole, zeroed(data, place, size), expected, tmp_path / "a.mcap", complete) == "", place
