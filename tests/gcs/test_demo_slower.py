"""The demonstration on a machine that has other things to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.demo.run import Demo
from gcs.errors import GcsError


class Busy(Demo):
    """A demonstration whose flights come in two pieces at more than `bearable` times real time."""

    def __init__(self, folder: Path, bearable: float) -> None:
        super().__init__(folder, 10.0, 1, "stall")
        self.bearable = bearable
        self.listed: list[dict[str, object]] = []
        self.seeds: list[str] = []

    def _run(self, arguments: list[str]) -> None:
        self.seeds.append(arguments[arguments.index("--seed") + 1])
        for _ in range(2 if self.speed > self.bearable else 1):
            self.listed.append({"id": f"f{len(self.listed)}", "state": "complete"})

    def _flights(self) -> list[dict[str, object]]:
        return list(self.listed)

    def _check_complete(self, flight: str) -> str:
        return flight


def test_a_flight_in_pieces_is_flown_again_slower(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    busy = Busy(tmp_path, 3.0)
    assert busy._fly("flight-1", "multisine", []) == "f4"
    assert busy.speed == 2.5
    assert busy.seeds == ["2", "2", "2"]  # the same noise as in one piece
    assert "flight-1 came in 2 pieces" in capsys.readouterr().out


def test_a_machine_that_cannot_keep_up_with_real_time_is_told(tmp_path: Path) -> None:
    with pytest.raises(GcsError, match="when it has less to do"):
        Busy(tmp_path, 0.5)._fly("flight-1", "multisine", [])
