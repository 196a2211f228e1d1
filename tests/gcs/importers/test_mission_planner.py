"""ArduPilot's logs as Mission Planner saves them for MATLAB, built as its MatLab.cs does from a log's lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dataflash import a_log, as_text
from scipy.io import savemat

from flightmodel.flight import Flight
from gcs.errors import ImportFileError
from gcs.flights.signals import extract
from gcs.formats.conversion import import_file
from gcs.recording.reader import Recording
from sim_vehicle.vehicle.vehicle_file import Vehicle


def number(word: str) -> float:
    """As double.TryParse: 0 for what is none."""
    try:
        return float(word)
    except ValueError:
        return 0.0


def cell(rows: list[Any], shape: tuple[int, ...]) -> np.ndarray:
    made = np.empty(len(rows), object)
    made[:] = rows
    return made.reshape(shape)


def matlab(text: str) -> dict[str, Any]:
    """Variables that Mission Planner writes of a log's lines."""
    labels: dict[str, list[str]] = {}
    data: dict[str, list[list[float]]] = {}
    messages, parameters = [], {}
    for count, line in enumerate(text.splitlines(), 1):
        items = line.replace(", ", ",").replace(": ", ":").replace(":", ",").split(",")
        if items[0] == "FMT":
            labels[items[3].strip()] = ["LineNo", *items[5:]]
        elif items[0] == "PARM":
            parameters[items[2]] = float(items[3])
        elif items[0] in labels and len(items) == len(labels[items[0]]):
            if items[0] == "MSG":
                words = [items[0], float(items[1]), *items[2:]]
                messages.append(cell(words, (len(words), 1)))
            data.setdefault(items[0], []).append([count, *map(number, items[1:])])
    made: dict[str, Any] = {f"{name}_label": cell(each, (-1, 1)) for name, each in labels.items() if name != "PARM"}
    made |= {name: np.array(rows) for name, rows in data.items()}
    pairs = [one for name in sorted(parameters) for one in (name, parameters[name])]
    made |= {"PARM": cell(pairs, (-1, 2)), "Seen": cell(list(data), (-1, 1))}
    return {**made, "MSG1": cell(messages, (1, -1))} if messages else made


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("matlab")
    (folder / "log.bin").write_bytes(a_log().data)
    savemat(folder / "log.bin-1234.mat", matlab(as_text(folder / "log.bin")))
    return folder


def test_signals_parameters_and_texts_are_those_of_the_bin(logs: Path, tmp_path: Path) -> None:
    import_file(logs / "log.bin", tmp_path / "bin.mcap")
    import_file(logs / "log.bin-1234.mat", tmp_path / "mat.mcap")
    expected, found = (extract(Recording(tmp_path / f"{one}.mcap"), Vehicle.unknown()) for one in ("bin", "mat"))
    assert found.signals.keys() == expected.signals.keys() >= {"p", "az", "phi", "airspeed", "servo1"}
    for name, one in expected.signals.items():
        assert found.signals[name].time_s == pytest.approx(one.time_s, abs=1e-6), name
        assert found.signals[name].values == pytest.approx(one.values, rel=1e-5, abs=1e-6, nan_ok=True), name
    parameters = {}
    for kind in ("bin", "mat"):
        (columns,) = Recording(tmp_path / f"{kind}.mcap").columns("PARAM_VALUE")
        parameters[kind] = dict(zip(columns.text("param_id"), columns["param_value"].tolist(), strict=True))
    assert parameters["mat"] == parameters["bin"]
    (heartbeats,) = Recording(tmp_path / "mat.mcap").columns("HEARTBEAT")
    assert set(heartbeats["type"].tolist()) == {1}  # ArduPlane, by its message
    assert Recording(tmp_path / "mat.mcap").metadata()["import"]["format"] == "dataflash matlab"


def test_python_reads_it_as_the_log_that_it_is(logs: Path) -> None:
    assert Flight.read(logs / "log.bin-1234.mat").signals.signals["phi"].source.startswith("ATTITUDE")


def test_a_file_of_columns_is_refused(logs: Path, tmp_path: Path) -> None:
    columns = tmp_path / "map.toml"
    columns.write_text('[units]\np = "rad/s"\n')
    with pytest.raises(ImportFileError, match="labels say what its columns are; leave the file of columns out"):
        import_file(logs / "log.bin-1234.mat", tmp_path / "a.mcap", columns=columns)


def test_a_message_that_came_once_and_one_without_rows_do_no_harm(logs: Path, tmp_path: Path) -> None:
    made = matlab(as_text(logs / "log.bin"))
    made["MODE"], made["ODD"] = made["MODE"][:1], np.zeros((0, 3))
    made["T_label"], made["T"] = cell(["LineNo", "TimeUS"], (-1, 1)), np.array([[1.0, np.nan, 3.0]])
    savemat(tmp_path / "a.mat", made)
    import_file(tmp_path / "a.mat", tmp_path / "a.mcap")
    assert "phi" in extract(Recording(tmp_path / "a.mcap"), Vehicle.unknown()).signals


def test_a_damaged_one_and_one_without_messages_are_one_line(logs: Path, tmp_path: Path) -> None:
    whole = (logs / "log.bin-1234.mat").read_bytes()
    labels = {key: one for key, one in matlab(as_text(logs / "log.bin")).items() if key.endswith("_label")}
    savemat(tmp_path / "b.mat", {**labels, "Seen": cell(["ATT"], (1, 1))})
    (tmp_path / "a.mat").write_bytes(whole[: len(whole) // 2])
    for name in ("a", "b"):
        with pytest.raises(ImportFileError) as caught:
            import_file(tmp_path / f"{name}.mat", tmp_path / f"{name}.mcap")
        assert "\n" not in str(caught.value)
        assert not (tmp_path / f"{name}.mcap").exists()


def test_other_mats_are_tables_as_before(tmp_path: Path) -> None:
    t = 0.02 * np.arange(100)
    savemat(tmp_path / "a.mat", {"time": t, "alpha_deg": np.sin(t)})
    import_file(tmp_path / "a.mat", tmp_path / "a.mcap")
    assert set(extract(Recording(tmp_path / "a.mcap"), Vehicle.unknown()).signals) == {"alpha"}
