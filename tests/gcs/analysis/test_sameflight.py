"""A flight that was fitted is no validation, whatever its file is called."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from gcs.analysis import postflight
from gcs.analysis.sameflight import repeated, same
from sim_vehicle.cli.main import main as sim_vehicle
from sim_vehicle.model.model_file import BUILT_IN
from sim_vehicle.vehicle.vehicle_file import load_vehicle

CRAFT = BUILT_IN / "iitb-mav.toml"
TOLD = "no validation on another flight"


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The same manoeuvre flown with two seeds; the first also under another name, as a log, and cut off."""
    folder = tmp_path_factory.mktemp("flights")
    found = {name: folder / f"{name}.mcap" for name in ("first", "second", "copy", "cut")}
    for seed, name in ((1, "first"), (2, "second")):
        fly = ["fly", "--manoeuvre", "elevator-pulse", "--seed", str(seed), "--duration", "6"]
        assert sim_vehicle([*fly, "--record", str(found[name])]) == 0
    shutil.copy(found["first"], found["copy"])
    found["cut"].write_bytes(found["first"].read_bytes()[: found["first"].stat().st_size // 2])
    return found


def test_a_fitted_flight_is_known_under_any_name(flights: dict[str, Path]) -> None:
    read = {name: postflight.read_flights([path], load_vehicle("iitb-mav"))[0] for name, path in flights.items()}
    assert {name for name in read if same(read["first"], read[name])} == {"first", "copy", "cut"}
    assert repeated([read["first"]], [read["second"]]) == []
    (own,) = repeated([read["first"]], [read["first"]])
    assert TOLD in own
    assert "called" not in own
    (renamed,) = repeated([read["first"]], [read["second"], read["copy"]])
    assert renamed.startswith("copy is a flight that the model was fitted to, there called first: ")
    (twice,) = repeated([read["first"], read["copy"]], [])
    assert "counts twice" in twice


@pytest.mark.parametrize("job", ["identify", "discrepancy"])
def test_the_result_begins_with_it(flights: dict[str, Path], monkeypatch: pytest.MonkeyPatch, job: str) -> None:
    def found(*given: Any, **settings: Any) -> dict[str, Any]:
        return {"warnings": ["rpm: slow"], "validation": {"reason": "every TIC at most 0.25"}}

    monkeypatch.setattr(f"sysid.{job}.{job}", found)
    monkeypatch.setattr("sysid.identification.result_file.result_json", lambda result: result)
    model = [BUILT_IN / "iitb-mav.model.json"] if job == "discrepancy" else []
    run = getattr(postflight, job)
    result = run([flights["first"]], CRAFT, *model, validate=[flights["copy"]])
    assert TOLD in result["warnings"][0]
    assert result["warnings"][-1] == "rpm: slow"
    if job == "identify":
        assert result["validation"]["reason"] == "every TIC at most 0.25, judged on a flight that was fitted"
    other = run([flights["first"]], CRAFT, *model, validate=[flights["second"]])
    assert other["warnings"] == ["rpm: slow"]
    assert other["validation"] == found()["validation"]
