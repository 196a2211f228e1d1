"""A part of a flight that is none is refused before anything is read."""

from __future__ import annotations

import pytest

from gcs.analysis.flight_part import part_problem
from gcs.cli import main


@pytest.mark.parametrize(("start", "stop"), [(None, None), (5.0, None), (None, 5.0), (0.0, 5.0), (5.0, 5.1)])
def test_parts_that_may_be(start: float | None, stop: float | None) -> None:
    assert part_problem(start, stop) == ""


@pytest.mark.parametrize(
    ("start", "stop", "told"),
    [
        (30.0, 10.0, "to (10 s) is not later than from (30 s)"),
        (10.0, 10.0, "not later"),
        (None, 0.0, "not later"),
        (-1.0, None, "from is -1 s: give seconds"),
        (float("nan"), 5.0, "from is nan s: give seconds"),
        (1.0, float("inf"), "to is inf s: give seconds"),
    ],
)
def test_parts_that_cannot_be(start: float | None, stop: float | None, told: str) -> None:
    assert told in part_problem(start, stop)


def test_the_command_refuses_it_as_wrong_use(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "none.mcap", "--vehicle", "iitb-mav", "--from", "30", "--to", "10"]) == 2
    said = capsys.readouterr().err
    assert "--from, --to: to (10 s) is not later than from (30 s)" in said
    assert said.count("\n") == 1
