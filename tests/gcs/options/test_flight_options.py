"""The flights that a command is given: logs of frames are read by the dialect that its user names."""

from pathlib import Path

import pytest
from mavlink_frames import Sender

from gcs.cli import build_parser, main
from gcs.options.flights import open_flights
from gcs.recording.reader import Recording


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """ATTITUDE, which `minimal` does not know, and HEARTBEAT, which it does."""
    sender, path = Sender(), tmp_path / "flight.tlog"
    frames = [sender.send(name).frame for name in ("HEARTBEAT", "ATTITUDE", "ATTITUDE")]
    path.write_bytes(b"".join((10**15 + i).to_bytes(8, "big") + frame for i, frame in enumerate(frames)))
    return path


@pytest.mark.parametrize("command", [["identify"], ["discrepancy", "--model", "model.json"]], ids=lambda c: c[0])
def test_the_dialect_decides_which_frames_of_a_log_are_messages(log: Path, command: list[str]) -> None:
    arguments = [*command, str(log), "--vehicle", "iitb-mav", "--validate", str(log)]
    for options, known in (([], {"HEARTBEAT": 1, "ATTITUDE": 2}), (["--dialect", "minimal"], {"HEARTBEAT": 1})):
        with open_flights(build_parser().parse_args([*arguments, *options])) as flights:
            for (path,) in (flights.recordings, flights.validate):
                counts = {topic.rsplit("/", 1)[1]: count for topic, count in Recording(path).counts().items()}
                assert {name: count for name, count in counts.items() if name in ("HEARTBEAT", "ATTITUDE")} == known


@pytest.mark.parametrize("command", [["identify"], ["discrepancy", "--model", "model.json"], ["noise"]])
def test_a_dialect_that_is_not_there_is_one_line(
    log: Path, command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [*command, str(log), "--vehicle", "iitb-mav", "--dialect", str(log.with_name("missing.xml"))]
    assert main(arguments) == 1
    assert "missing.xml" in capsys.readouterr().err


def test_it_is_one_line_beside_a_recording_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = tmp_path / "flight.mcap"
    recording.write_bytes(b"")
    assert main(["identify", str(recording), "--vehicle", "iitb-mav", "--dialect", "nowhere"]) == 1
    assert "unknown MAVLink dialect 'nowhere'" in capsys.readouterr().err


def test_doubts_about_the_vehicle_are_told_before_the_job(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    vehicle = log.with_name("grams.toml")
    vehicle.write_text(
        "[mass]\nmass = 1200\nIxx = 0.02\nIyy = 0.03\nIzz = 0.045\n[geometry]\nS = 0.2\nb = 1\nc = 0.2\n",
        encoding="utf-8",
    )
    with open_flights(build_parser().parse_args(["identify", str(log), "--vehicle", str(vehicle)])):
        told = capsys.readouterr().err.splitlines()
    assert [line for line in told if line.startswith("gcs identify: warning: mass.mass: 1200 kg")] == told
