"""Runs over many seeds go on where they were stopped, and give what a run in one go gives."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from seed_lines import fingerprint, fly_missing


def square(seed, log):
    """Stands for a flight: tells in `log` that it was flown."""
    with Path(log).open("a", encoding="utf-8") as sink:
        sink.write(f"{seed}\n")
    return {"seed": seed, "square": seed**2}


def stopped_at_three(seed, log):
    if seed == 3:
        raise KeyboardInterrupt
    return square(seed, log)


def flown(log):
    return [int(line) for line in log.read_text(encoding="utf-8").split()]


@pytest.mark.parametrize("workers", [1, 2])
def test_only_what_is_missing_is_flown(tmp_path, workers):
    log, kept = tmp_path / "log", tmp_path / "deep" / "kept.jsonl"
    with pytest.raises(KeyboardInterrupt):
        fly_missing(stopped_at_three, range(6), 1, kept, log)
    with kept.open("a", encoding="utf-8") as sink:
        sink.write('{"seed": 4, "squ')  # the power went while it was written
    lines = fly_missing(square, range(6), workers, kept, log)
    assert [line["square"] for line in lines] == [0, 1, 4, 9, 16, 25]
    assert sorted(flown(log)) == [0, 1, 2, 3, 4, 5]
    again = [json.loads(text)["seed"] for text in kept.read_text(encoding="utf-8").splitlines() if text.endswith("}")]
    assert sorted(again) == [0, 1, 2, 3, 4, 5]
    assert fly_missing(square, range(2, 4), 1, kept, log) == lines[2:4]
    assert len(flown(log)) == 6


def test_without_a_file_nothing_is_kept(tmp_path):
    log = tmp_path / "log"
    for _ in range(2):
        assert fly_missing(square, range(2), 1, None, log) == [{"seed": 0, "square": 0}, {"seed": 1, "square": 1}]
    assert flown(log) == [0, 1, 0, 1]


def test_other_sources_are_another_run(tmp_path):
    source = tmp_path / "source.py"
    source.write_text("a = 1\n", encoding="utf-8")
    before = fingerprint(("seed_lines",), source)
    assert fingerprint(("seed_lines",), source) == before
    source.write_text("a = 2\n", encoding="utf-8")
    assert fingerprint(("seed_lines",), source) != before
