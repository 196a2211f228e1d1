"""Where a result is to go is settled before the job runs."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.cli import main

COMMANDS = (["identify"], ["discrepancy", "--model", "model.json"])


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    path = tmp_path / "flight.mcap"
    path.write_bytes(b"never read")
    (tmp_path / "file").touch()
    return path


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
@pytest.mark.parametrize("option", ["-o", "--write-model"])
@pytest.mark.parametrize(
    ("place", "why"),
    [
        ("no/x.json", "is in no existing folder"),
        ("file/x.json", "is in no existing folder"),
        ("", "is a folder"),
        ("flight.mcap", "is one of the files to be read"),
    ],
)
def test_an_impossible_place_is_one_line_before_the_job(
    flight: Path, command: list[str], option: str, place: str, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [*command, str(flight), "--vehicle", "iitb-mav", option, str(flight.parent / place)]
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert why in line
    assert "give another file" in line
    assert flight.read_bytes() == b"never read"


def test_result_and_model_are_two_files(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    same = str(flight.with_name("x.json"))
    assert main(["identify", str(flight), "--vehicle", "iitb-mav", "-o", same, "--write-model", same]) == 2
    assert "is named for two results" in capsys.readouterr().err
