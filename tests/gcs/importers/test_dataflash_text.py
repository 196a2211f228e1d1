"""ArduPilot's logs as text, against the same log as bytes, read by pymavlink."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from dataflash import a_log, as_text, closed
from processes import run
from pymavlink.DFReader import DFReader_text

from gcs.errors import ImportFileError
from gcs.flights.signals import extract
from gcs.formats.conversion import export_file, import_file
from gcs.recording.reader import Recording
from sim_vehicle.vehicle.vehicle_file import Vehicle


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """log.bin, and log.log with what pymavlink reads of it, a line for each message."""
    folder = tmp_path_factory.mktemp("text")
    (folder / "log.bin").write_bytes(a_log().data)
    (folder / "log.log").write_text(as_text(folder / "log.bin"), encoding="utf-8")
    return folder


def test_signals_and_parameters_are_those_of_the_bytes(logs: Path, tmp_path: Path) -> None:
    for ending in ("bin", "log"):
        import_file(logs / f"log.{ending}", tmp_path / f"{ending}.mcap")
    of_bytes, of_text = (extract(Recording(tmp_path / f"{one}.mcap"), Vehicle.unknown()) for one in ("bin", "log"))
    assert of_text.signals.keys() == of_bytes.signals.keys()
    for name, one in of_bytes.signals.items():
        assert of_text.signals[name].time_s == pytest.approx(one.time_s, abs=1e-6), name
        assert of_text.signals[name].values == pytest.approx(one.values, rel=1e-5, abs=1e-6, nan_ok=True), name
    rows = [Recording(tmp_path / f"{one}.mcap").columns("PARAM_VALUE")[0].fields for one in ("bin", "log")]
    assert rows[0]["param_value"].tolist() == rows[1]["param_value"].tolist()
    # What pymavlink reads of the text itself is as much.
    reader, count = DFReader_text(str(logs / "log.log")), 0
    while (message := reader.recv_msg()) is not None:
        count += message.get_type() == "IMU"
    closed(reader)
    assert count == 2 * 200


def test_the_ending_txt_is_the_same_and_the_log_comes_back_whole(logs: Path, tmp_path: Path) -> None:
    text = (logs / "log.log").read_bytes()
    (tmp_path / "log.txt").write_bytes(text.replace(b"\n", b"\r\n"))
    import_file(tmp_path / "log.txt", tmp_path / "txt.mcap")
    found = extract(Recording(tmp_path / "txt.mcap"), Vehicle.unknown())
    assert found.signals["q"].time_s.size == 200
    import_file(logs / "log.log", tmp_path / "log.mcap")
    export_file(tmp_path / "log.mcap", tmp_path / "again.log")
    assert (tmp_path / "again.log").read_bytes() == text


def test_lines_that_are_none_are_left_out_and_counted(logs: Path, tmp_path: Path) -> None:
    lines = (logs / "log.log").read_text().splitlines()
    lines[60:60] = [
        "IMU, 80x0000, 0, 1, 1, 1, 1, 1, 1",
        "IMU, , 0, 1, 1, 1, 1, 1, 1",
        "IMU, 80000000, 0, 1.0",
        "gibberish",
        "WHAT, 1, 2",
        "MSG, 80000000, a text, with commas, in it",
    ]
    (tmp_path / "odd.log").write_text("\n".join(lines[:-3]) + "\nIMU, 8000")
    import_file(tmp_path / "odd.log", tmp_path / "odd.mcap")
    found = Recording(tmp_path / "odd.mcap")
    texts = [bytes(one).split(b"\0")[0] for one in found.columns("STATUSTEXT")[0].fields["text"]]
    assert b"a text, with commas, in it" in texts
    assert extract(found, Vehicle.unknown()).signals["ax"].time_s.size >= 198


def test_times_may_be_written_with_a_point(logs: Path, tmp_path: Path) -> None:
    of_imu = [line.split(", ") for line in (logs / "log.log").read_text().splitlines()]
    written = [", ".join([w[0], f"{w[1]}.0", *w[2:]]) if w[0] == "IMU" else ", ".join(w) for w in of_imu]
    (tmp_path / "point.log").write_text("\n".join(["", "a word before", *written]))
    import_file(tmp_path / "point.log", tmp_path / "point.mcap")
    assert extract(Recording(tmp_path / "point.mcap"), Vehicle.unknown()).signals["ax"].time_s.size == 200


def test_what_is_no_log_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "service.log").write_text("INFO started\nINFO stopped\n" * 50)
    done = run("gcs", "import", tmp_path / "service.log", "-o", tmp_path / "x.mcap")
    assert done.returncode == 1
    assert "holds no message of a dataflash log" in done.stderr
    assert done.stderr.count("\n") == 1
    (tmp_path / "formats.log").write_text("FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n")
    with pytest.raises(ImportFileError, match="give the whole log"):
        import_file(tmp_path / "formats.log", tmp_path / "y.mcap")
    assert np.all([not (tmp_path / f"{one}.mcap").exists() for one in "xy"])
