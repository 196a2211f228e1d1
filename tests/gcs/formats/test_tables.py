"""Tables read back with pandas and pyarrow hold the values of the recording."""

import sys
from pathlib import Path

import numpy as np
import pandas
import pyarrow.parquet as parquet
import pytest
from mavlink_frames import Sender

from gcs.cli import main
from gcs.formats.tables import export_messages
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import scan
from gcs.recording.reader import Recording
from gcs.recording.writer import McapWriter

START = 1_790_000_000_000_000_000
NAMES = ("ATTITUDE", "GPS_RAW_INT", "STATUSTEXT", "SERVO_OUTPUT_RAW", "DEBUG_FLOAT_ARRAY", "SYSTEM_TIME")


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """Messages with floats, 64-bit integers, arrays and texts, of two components."""
    dialect = Dialect.load()
    path = tmp_path / "flight.mcap"
    senders = (Sender(seed=1), Sender(component=2, seed=2))
    with McapWriter(path, dialect) as writer:
        for i in range(60):
            frame = senders[i % 2].send(NAMES[i % len(NAMES)]).frame
            buffer = np.frombuffer(frame, np.uint8)
            writer.write("udp", buffer, scan(buffer, dialect, final=True), START + i * 10_000_000)
    return path


def expected(recording: Recording, name: str, label: str) -> list[object]:
    field, _, index = label.partition("[")
    values: list[object] = []
    for columns in recording.columns(name):
        if field in columns.text_fields:
            values += columns.text(field).tolist()
        elif index:
            values += columns[field][:, int(index.rstrip("]"))].tolist()
        else:
            values += columns[field].tolist()
    return values


def labels(recording: Recording, name: str) -> list[str]:
    (columns, *_) = recording.columns(name)
    found = []
    for field in columns.fields.dtype.names:
        shape = columns.fields.dtype[field].shape
        wide = shape and field not in columns.text_fields
        found += [f"{field}[{i}]" for i in range(shape[0])] if wide else [field]
    return found


def test_one_parquet_file_holds_every_value_with_its_type(flight: Path, tmp_path: Path) -> None:
    target = tmp_path / "flight.parquet"
    assert main(["export", str(flight), "-o", str(target)]) == 0
    recording = Recording(flight)
    table = parquet.read_table(target)
    assert table.num_rows == sum(recording.counts().values())
    for name in NAMES:
        rows = np.flatnonzero(np.array(table.column("message").to_pylist()) == name)
        for label in labels(recording, name):
            column = table.column(f"{name}.{label}")
            assert column.take(rows).to_pylist() == expected(recording, name, label)
            assert column.null_count == table.num_rows - rows.size
        times = np.concatenate([columns.log_time for columns in recording.columns(name)])
        assert table.column("log_time_ns").take(rows).to_pylist() == times.tolist()
    assert table.schema.field("ATTITUDE.roll").metadata == {b"unit": b"rad"}
    assert str(table.schema.field("SYSTEM_TIME.time_unix_usec").type) == "uint64"
    read = pandas.read_parquet(target, columns=["log_time_ns", "ATTITUDE.roll"]).dropna()
    assert read["ATTITUDE.roll"].tolist() == expected(recording, "ATTITUDE", "roll")


def test_a_folder_of_parquet_has_a_table_for_each_message(flight: Path, tmp_path: Path) -> None:
    assert main(["export", str(flight), "--messages", "parquet", "-o", str(tmp_path / "tables")]) == 0
    recording = Recording(flight)
    assert sorted(path.name for path in (tmp_path / "tables").iterdir()) == sorted(f"{name}.parquet" for name in NAMES)
    for name in NAMES:
        table = parquet.read_table(tmp_path / "tables" / f"{name}.parquet")
        assert table.column_names[5:] == labels(recording, name)
        for label in labels(recording, name):
            assert table.column(label).to_pylist() == expected(recording, name, label)


def test_a_folder_of_csv_has_the_same_values(flight: Path, tmp_path: Path) -> None:
    export_messages(flight, tmp_path / "tables", "csv")
    recording = Recording(flight)
    for name in NAMES:
        table = pandas.read_csv(tmp_path / "tables" / f"{name}.csv", keep_default_na=False)
        assert table.columns.tolist()[:5] == ["log_time_ns", "publish_time_ns", "system", "component", "sequence"]
        for label in labels(recording, name):
            values = expected(recording, name, label)
            if isinstance(values[0], float):
                # A 32-bit float has fewer digits than what Python prints of it.
                assert np.array_equal(table[label].astype(np.float32), np.array(values, np.float32))
            else:
                assert table[label].tolist() == values


def test_the_long_table_holds_every_value(flight: Path, tmp_path: Path) -> None:
    target = tmp_path / "flight.csv"
    assert main(["export", str(flight), "-o", str(target)]) == 0
    table = pandas.read_csv(target, dtype=str, keep_default_na=False)
    recording = Recording(flight)
    for name in NAMES:
        for label in labels(recording, name):
            found = table[(table["message"] == name) & (table["field"] == label)]["value"]
            assert found.tolist() == [str(value) for value in expected(recording, name, label)]


def test_without_parquet_s_library_one_line_says_what_to_install_and_csv_is_written(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    for more in (["-o", str(tmp_path / "a.parquet")], ["--messages", "parquet", "-o", str(tmp_path / "tables")]):
        assert main(["export", str(flight), *more]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert line.endswith("pip install 'flight-model-ground-station[parquet]'); a CSV needs nothing")
    assert not (tmp_path / "a.parquet").exists()
    assert not (tmp_path / "tables").exists()
    assert main(["export", str(flight), "-o", str(tmp_path / "a.csv")]) == 0
    assert main(["export", str(flight), "--messages", "csv", "-o", str(tmp_path / "tables")]) == 0
