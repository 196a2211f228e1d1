"""Files that are written whole or not at all."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from gcs.errors import SettingsError
from gcs.text.files import write_whole


def test_what_is_written_is_there_and_nothing_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_text("what stood here before", encoding="utf-8")
    write_whole(path, "x" * 100_000)
    assert path.read_text(encoding="utf-8") == "x" * 100_000
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_leaves_what_was_there_and_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "result.json"
    path.write_text("what stood here before", encoding="utf-8")

    def full(source: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(SettingsError, match=r"result\.json could not be written: No space left on device"):
        write_whole(path, "new")
    assert path.read_text(encoding="utf-8") == "what stood here before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_device_is_written_in_place_and_named_when_it_is_full() -> None:
    with pytest.raises(SettingsError, match="/dev/full could not be written"):
        write_whole(Path("/dev/full"), "x" * 100_000)
