"""Tables become recordings that every reader of recordings knows, to the last digit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs.cli import main
from gcs.errors import ImportFileError
from gcs.flights.signals import extract
from gcs.formats.conversion import import_file
from gcs.importers.table import import_table
from gcs.inspection.info import describe_recording
from gcs.recording.reader import Recording
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle

T = 0.01 * np.arange(400)
ALPHA, Q = 3.0 + np.sin(T) / 3.0, 10.0 * np.cos(T) / 7.0


def written(path: Path, head: str = "time_s,alpha_deg,q_deg_s,de_deg,note", start: float = 0.0) -> Path:
    rows = [
        f"{start + t!r},{a!r},{q!r},{-a!r},x" for t, a, q in zip(T.tolist(), ALPHA.tolist(), Q.tolist(), strict=True)
    ]
    path.write_text(head + "\n" + "\n".join(rows) + "\n")
    return path


def test_signals_are_those_of_the_table_to_the_last_digit(tmp_path: Path) -> None:
    target = tmp_path / "a.mcap"
    import_file(written(tmp_path / "a.csv"), target)
    found = extract(Recording(target), Vehicle.unknown())
    assert set(found.signals) == {"alpha", "q", "de"}
    np.testing.assert_array_equal(found.signals["alpha"].time_s, T.round(6))
    np.testing.assert_allclose(found.signals["alpha"].values, np.radians(ALPHA), rtol=1e-14)
    np.testing.assert_allclose(found.signals["q"].values, np.radians(Q), rtol=1e-13, atol=1e-15)
    assert found.signals["de"].unit == "rad"


def test_the_recording_says_what_it_was_made_from(tmp_path: Path) -> None:
    target = tmp_path / "a.mcap"
    import_file(written(tmp_path / "a.csv"), target)
    notes = Recording(target).metadata()["import"]
    assert notes["format"] == "table"
    assert "alpha: column 'alpha_deg', deg" in notes["columns"]
    assert notes["unused"] == "note"
    (attached,) = Recording(target).attachments()
    assert attached.name == "a.csv.zst"
    described = describe_recording(target)
    assert any("DEBUG_FLOAT_ARRAY" in str(entry) for entry in described["topics"])


def test_a_time_in_utc_stays_one(tmp_path: Path) -> None:
    target = tmp_path / "a.mcap"
    import_file(written(tmp_path / "a.csv", start=1_790_000_000.0), target)
    assert Recording(target).start_ns == pytest.approx(1_790_000_000 * 10**9, abs=10**9)


def test_a_mapping_file_names_columns(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = written(tmp_path / "a.csv", "seconds,probe,rate,stick,note")
    columns, target = tmp_path / "map.toml", tmp_path / "a.mcap"
    columns.write_text(
        '[columns]\ntime = "seconds"\nalpha = "probe"\nq = "rate"\n[units]\nalpha = "deg"\nq = "deg/s"\n'
    )
    assert main(["import", str(source), "-o", str(target), "--columns", str(columns)]) == 0
    assert capsys.readouterr().out.strip() == str(target)
    assert set(extract(Recording(target), Vehicle.unknown()).signals) == {"alpha", "q"}


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("time_s,alpha,q,de,note", 'as they are: "q" = "deg/s", "alpha" = "deg", "de" = "deg"; or units = "SI"'),
        ("a,b,c,d,e", "no column is the time"),
        ("time_s,b,c,d,e", "none of its columns is a signal"),
    ],
)
def test_what_is_not_known_is_one_line_and_leaves_nothing(tmp_path: Path, head: str, words: str) -> None:
    source, target = written(tmp_path / "a.csv", head), tmp_path / "a.mcap"
    with pytest.raises(ImportFileError) as refused:
        import_file(source, target)
    text = str(refused.value)
    assert words in text
    assert text.startswith("a.csv: ")
    assert "--columns" in text
    assert "\n" not in text
    assert not target.exists()


def test_columns_of_what_is_no_table_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.tlog").write_bytes(b"")
    with pytest.raises(ImportFileError, match="is no table; leave the file of columns out"):
        import_file(tmp_path / "a.tlog", tmp_path / "a.mcap", columns=tmp_path / "map.toml")
    (tmp_path / "map.toml").write_text("=")
    source = written(tmp_path / "a.csv")
    with pytest.raises(ImportFileError, match="is no TOML file"):
        import_table(source, tmp_path / "a.mcap", columns=tmp_path / "map.toml")


def test_a_sensor_that_is_slower_than_the_table_is_said_where_the_flight_is_read(tmp_path: Path) -> None:
    path, target = tmp_path / "a.csv", tmp_path / "a.mcap"
    rows = [f"{t!r},{0.1 * (i // 20)},{q!r}" for i, (t, q) in enumerate(zip(T.tolist(), Q.tolist(), strict=True))]
    path.write_text("time_s,vn (m/s),q_deg_s\n" + "\n".join(rows))
    import_file(path, target)
    found = extract(Recording(target), Vehicle.unknown())
    assert found.signals["vn"].time_s.size == 20
    assert any("mostly repeats its last value" in warning for warning in found.warnings)


def test_a_true_airspeed_stands_where_nothing_of_the_calibrated_one_is_recorded(tmp_path: Path) -> None:
    """The bundled aircraft calibrates a pressure sensor that a table does not hold."""
    vehicle = load_vehicle("iitb-mav")
    assert "airspeed" in vehicle.calibration
    source, time = tmp_path / "hall.csv", np.arange(100) * 0.02
    rows = np.column_stack([time, 12.0 + np.sin(time), np.cos(time)])
    np.savetxt(source, rows, delimiter=",", header="time (s),tas (m/s),q (rad/s)", comments="")
    import_table(source, tmp_path / "hall.mcap")
    flight = extract(Recording(tmp_path / "hall.mcap"), vehicle)
    assert flight.signals["airspeed"].values == pytest.approx(rows[:, 1], rel=1e-6)
