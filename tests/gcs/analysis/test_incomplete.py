"""Recordings that were cut off say so, in one line that tells what to do, wherever they are used."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.analysis.incomplete import naming_cuts
from gcs.analysis.postflight import read_flights
from gcs.cli import main
from gcs.errors import RecordingError
from sim_vehicle.cli.main import main as sim_vehicle
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.errors import SegmentError, SignalError

VEHICLE = "sim_vehicle/vehicles/iitb-mav.toml"
COMMANDS = (
    ["identify", "{}", "--vehicle", VEHICLE],
    ["discrepancy", "{}", "--vehicle", VEHICLE, "--model", "iitb-mav"],
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "flight.mcap"
    fly = ["fly", "--manoeuvre", "elevator-pulse", "--seed", "3", "--duration", "6", "--record", str(path)]
    assert sim_vehicle(fly) == 0
    return path


def cut(whole: Path, size: int, folder: Path) -> Path:
    path = folder / "cut.mcap"
    path.write_bytes(whole.read_bytes()[:size])
    return path


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: str(command[0]))
def test_one_that_holds_no_flight_is_called_cut_off(
    whole: Path, command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = cut(whole, 20_000, tmp_path)
    assert main([word.format(path) for word in command]) == 1
    told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("gcs ")]
    assert len(told) == 1
    assert f"{path} is incomplete: still being written, or cut off 1.0 s after its first message" in told[0]
    assert "copy the whole file again" in told[0]
    assert "--from" not in told[0]


def test_one_cut_before_its_first_message_is_called_so_too(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = cut(whole, 3_000, tmp_path)
    for command in (["info", "{}"], *COMMANDS):
        assert main([word.format(path) for word in command]) == 1
        assert "was cut off before its first message" in capsys.readouterr().err


def test_the_info_of_a_whole_one_has_no_such_line(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(whole)]) == 0
    assert "incomplete" not in capsys.readouterr().out
    assert main(["info", str(cut(whole, 20_000, tmp_path))]) == 0
    (line,) = [one for one in capsys.readouterr().out.splitlines() if one.startswith("incomplete: ")]
    assert "1.0 s after its first message" in line
    assert "`gcs recover`" in line


def test_what_a_cut_flight_tells_comes_with_a_warning(whole: Path, tmp_path: Path) -> None:
    vehicle = load_vehicle("iitb-mav")
    path = cut(whole, whole.stat().st_size - 5_000, tmp_path)
    (shorter,), (full,) = read_flights([path], vehicle), read_flights([whole], vehicle)
    assert any("is incomplete: still being written, or cut off" in warning for warning in shorter.warnings)
    assert not any("incomplete" in warning for warning in full.warnings)


def test_other_errors_keep_their_words(whole: Path, tmp_path: Path) -> None:
    path = cut(whole, 20_000, tmp_path)
    told = r"vn looks like knots; .* is incomplete: .* if that is why, wait for its end, copy"
    with pytest.raises(RecordingError, match=told), naming_cuts([path]):
        raise SignalError("vn looks like knots")
    with pytest.raises(SegmentError, match=r"^flight: give the part by --from and --to$"), naming_cuts([whole]):
        raise SegmentError("flight: give the part by --from and --to")
