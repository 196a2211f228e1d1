"""Arithmetic that fails in the live process: one line, and it goes on with what it knows."""

from __future__ import annotations

import json

import pytest
from traffic import SECOND, Vehicle, batch

from gcs.live.signals import Samples, SignalStream
from gcs.live.vehiclefile import WatchedVehicle
from gcs.live.worker import LiveProcess, run
from gcs.mavlink.dialect import Dialect


@pytest.mark.parametrize("error", [OverflowError("too large"), FloatingPointError("invalid"), ValueError("not\none")])
def test_a_turn_whose_arithmetic_fails_is_told_in_one_line_and_the_process_goes_on(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    live, vehicle = LiveProcess(Dialect.load(), WatchedVehicle("iitb-mav")), Vehicle()
    estimates, take = live._estimates, SignalStream.take
    turns = 0

    def failing(self: SignalStream, streams: list[object], autopilot: int) -> dict[str, Samples]:
        nonlocal turns
        turns += 1
        if turns in (2, 3):
            raise error
        return take(self, streams, autopilot)  # type: ignore[arg-type]

    def turn_by_turn(unpacker: object) -> list[object] | None:
        return None if turns >= 5 else [batch(vehicle.second(), (100 + turns) * SECOND)]

    monkeypatch.setattr(SignalStream, "take", failing)
    monkeypatch.setattr("gcs.live.worker._read", turn_by_turn)
    monkeypatch.setattr("gcs.live.worker.time.sleep", lambda seconds: None)
    run(live)
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["text"] for line in told if line["kind"] == "fault"] == [
        f"{type(error).__name__}: {' '.join(str(error).split())}"
    ]
    assert turns == 5
    assert live._newest["phi"][1] > 104 * SECOND  # of the last turn
    assert live._estimates is estimates
