"""What every recording says of itself, in every part, from its first byte on; and its options as people write them."""

import importlib.metadata
import shutil
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from traffic import SECOND, Vehicle, batch, wait_until
from wire_streams import wire_streams

from gcs.analysis.postflight import read_flights
from gcs.catalogue.store import Catalogue
from gcs.cli import main
from gcs.errors import RecordingError, SettingsError
from gcs.mavlink.dialect import Dialect
from gcs.recording.reader import Recording
from gcs.recording.storage import StorageOptions
from gcs.station.capture import Capture
from gcs.station.provenance import clock_state, provenance
from gcs.station.recorder import FlightRecorder
from gcs.text.sizes import parse_size, size_text
from gcs.version import VERSION
from sim_vehicle.vehicle.vehicle_file import load_vehicle

START = 1_800_000_000 * SECOND
URL = "udpin:127.0.0.1:14550"


def vehicle_file(folder: Path) -> Path:
    """A copy of the built-in vehicle with the bench points that it names."""
    source = load_vehicle("iitb-mav").path
    for path in source.parent.glob(f"{source.stem}*.*"):
        shutil.copy(path, folder)
    return folder / source.name


def test_a_recording_says_what_wrote_it_and_holds_the_vehicle_file(tmp_path: Path) -> None:
    craft = vehicle_file(tmp_path)
    dialect = Dialect.load()
    path = tmp_path / "a.mcap"
    origin = provenance(dialect, [URL, "/dev/ttyUSB0,57600"], str(craft))
    capture = Capture(path, dialect, StorageOptions(), origin, START)
    capture.take(URL, batch(Vehicle().second(), START))
    capture.tick(START + 2 * SECOND)
    # As a crash at this moment would leave it.
    crashed = wait_until(lambda: opened(path))
    for recording in (crashed, closed(capture, path)):
        told = recording.metadata()
        assert told["recording"]["gcs"] == VERSION
        assert told["recording"]["numpy"] == np.__version__
        assert told["recording"]["dialect"] == "ardupilotmega"
        assert (told["recording"]["flight"], told["recording"]["part"]) == ("a", "1")
        assert clock_state() in told["recording"]["log_time"]
        assert told["links"] == {URL: "udpin", "/dev/ttyUSB0,57600": "serial"}
        files = {file.name: file.data for file in recording.attachments()}
        assert files["iitb-mav.toml"] == craft.read_bytes()
        named = {entry.points for entry in load_vehicle(craft).calibration.values() if isinstance(entry.points, Path)}
        assert named
        assert {files[points.name] for points in named} == {points.read_bytes() for points in named}
    assert Recording(path).metadata()["statistics"]["messages"] == str(len(Vehicle().second()))
    with open(path, "rb") as file:
        names = {attachment.name for attachment in make_reader(file, validate_crcs=True).iter_attachments()}
    assert names == set(files)


def opened(path: Path) -> Recording | None:
    try:
        return Recording(path)
    except RecordingError:
        return None


def closed(capture: Capture, path: Path) -> Recording:
    capture.close(START + 3 * SECOND)
    assert capture.problem is None
    return Recording(path)


def test_a_users_dialect_goes_into_the_recording(tmp_path: Path) -> None:
    xml = tmp_path / "own.xml"
    xml.write_text(
        '<mavlink><messages><message id="60000" name="OWN_THING">'
        '<field type="uint32_t" name="number">n</field></message></messages></mavlink>'
    )
    (file,) = provenance(Dialect.load(str(xml)), [], None, str(xml)).attachments
    assert (file.name, file.data) == ("own.xml", xml.read_bytes())


def test_what_a_users_dialect_includes_goes_in_too(tmp_path: Path) -> None:
    include = "<mavlink><include>{}</include><messages></messages></mavlink>"
    for name, other in (("top", "middle.xml"), ("middle", "low.xml"), ("low", "minimal.xml")):
        (tmp_path / f"{name}.xml").write_text(include.format(other))
    (tmp_path / "stranger.xml").write_text(include.format("minimal.xml"))
    top = str(tmp_path / "top.xml")
    made = provenance(Dialect.load(top), [], None, top)
    assert [file.name for file in made.attachments] == ["top.xml", "middle.xml", "low.xml"]
    assert made.metadata["recording"]["pymavlink"] == importlib.metadata.version("pymavlink")


def test_a_long_flight_is_several_files_and_one_flight(tmp_path: Path) -> None:
    dialect = Dialect.load()
    with closing(Catalogue(tmp_path / "catalogue.sqlite")) as catalogue:
        recorder = FlightRecorder(
            tmp_path,
            dialect,
            catalogue,
            storage=StorageOptions(split_bytes=20_000),
            provenance=lambda: provenance(dialect, [URL], "iitb-mav"),
        )
        vehicle, sent, now = Vehicle(), b"", START
        for _ in range(60):
            frames = vehicle.second()
            recorder.feed(URL, batch(frames, now))
            sent += b"".join(frames)
            now += SECOND
            recorder.tick(now)
        recorder.close(now)
        (flight,) = catalogue.flights()
    assert flight.parts > 2
    assert flight.messages == 60 * 52
    paths = flight.kept_files(tmp_path)
    assert [path.name for path in paths[1:3]] == [f"{flight.id}.part2.mcap", f"{flight.id}.part3.mcap"]
    assert flight.bytes == sum(path.stat().st_size for path in paths)
    for number, path in enumerate(paths, 1):
        told = Recording(path).metadata()
        assert told["recording"]["part"] == str(number)
        assert told["recording"]["previous"] == ("" if number == 1 else paths[number - 2].name)
        assert told["links"] == {URL: "udpin"}
        assert next(file.name for file in Recording(path).attachments()) == "iitb-mav.toml"
        assert set(Recording(path).lost().values()) == {0}
    whole = Recording(paths)
    assert b"".join(data for _, data in wire_streams(whole)[URL]) == sent
    assert set(whole.lost().values()) == {0}
    assert whole.metadata()["statistics"]["parts"] == str(flight.parts)
    (signals,) = read_flights(paths, load_vehicle("iitb-mav"))
    assert signals.signals["phi"].values.size == 60 * 50


@pytest.mark.parametrize(
    ("text", "size"), [("512MB", 512_000_000), ("20 GB", 20 * 10**9), ("1.5GiB", 1_610_612_736), ("1000000", 10**6)]
)
def test_sizes_as_people_write_them(text: str, size: int) -> None:
    assert parse_size(text, "--split-size") == size


@pytest.mark.parametrize("text", ["", "much", "-1MB", "1XB", "1 MB MB", "nan"])
def test_what_is_no_size_is_refused(text: str) -> None:
    with pytest.raises(SettingsError, match="--keep-size"):
        parse_size(text, "--keep-size")


def test_sizes_are_told_in_the_unit_that_fits() -> None:
    assert [size_text(size) for size in (7, 12_345, 5_000_000, 20 * 10**9)] == ["7 bytes", "12.3 kB", "5 MB", "20 GB"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--split-size", "10kB"], "give at least 1 MB"),
        (["--split-size", "big"], "--split-size big"),
        (["--fsync", "sometimes"], "--fsync sometimes"),
        (["--reserve", "x"], "--reserve x"),
    ],
)
@pytest.mark.parametrize("command", ["serve", "record"])
def test_options_that_cannot_be_meant_are_one_line_and_exit_code_2(
    command: str, options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = ["-o", str(tmp_path / "a.mcap")] if command == "record" else ["--data", str(tmp_path)]
    assert main([command, "--connect", "udpin:127.0.0.1:0", *target, *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line


def test_a_vehicle_file_that_is_missing_stops_recording_before_it_begins(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.mcap"
    arguments = ["record", "--connect", "udpin:127.0.0.1:0", "-o", str(path), "--vehicle", str(tmp_path / "no.toml")]
    assert main(arguments) == 2
    assert "no such vehicle file" in capsys.readouterr().err
    assert not path.exists()
