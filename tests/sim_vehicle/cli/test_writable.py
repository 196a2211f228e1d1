"""Files that cannot be written are known before anything is flown or estimated."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim_vehicle.cli.main import main
from sim_vehicle.cli.writable import unwritable


def test_the_attempt_leaves_nothing_behind(tmp_path: Path) -> None:
    assert unwritable(tmp_path / "new.json") is None
    assert list(tmp_path.iterdir()) == []
    there = tmp_path / "there.json"
    there.write_text("kept", encoding="utf-8")
    assert unwritable(there) is None
    assert there.read_text(encoding="utf-8") == "kept"


def test_what_cannot_be_written_says_why(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert unwritable(tmp_path) == "is a folder"
    assert unwritable(tmp_path / "no" / "x.json") == "is in no existing folder"
    assert unwritable(tmp_path / "file" / "x.json") == "is in no existing folder"
    assert unwritable(Path("/dev/null")) is None


def test_a_folder_that_takes_no_files_is_found_by_trying() -> None:
    assert (unwritable(Path("/proc/x.json")) or "").startswith("is not to be written (")


def test_a_truth_that_cannot_be_written_is_told_before_the_flight(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = tmp_path / "flight.tlog"
    assert main(["fly", "--record", str(record), "--truth", str(tmp_path / "no" / "truth.json")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("sim-vehicle: --truth")
    assert "in no existing folder" in line
    assert not record.exists()
