"""A batch of flights: on processes and on a Dask cluster, ended and gone on with, and odd files among them."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import distributed
import pyarrow.parquet
import pytest
from dask_cluster import cluster
from deadly_job import deadly
from fsspec.implementations.local import LocalFileSystem  # type: ignore[import-untyped]
from patience import PATIENCE_S
from traffic import wait_until

from gcs.cli import main
from gcs.errors import SettingsError
from gcs.fleet import batch as batches
from gcs.fleet.orders import Order, orders
from sim_vehicle.cli.main import main as sim_vehicle

pytestmark = pytest.mark.whole_flight

# What differs from run to run of the same job.
BESIDE = ("cost_s", "made")
CLIENT = distributed.Client


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flights")
    for seed in (1, 2, 3, 4):
        sim_vehicle(["fly", "--manoeuvre", "multisine", "--duration", "12", "--seed", str(seed), "--record",
                     str(folder / f"flight{seed}.tlog")])  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def local(flights: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The batch on a process of this machine."""
    folder = tmp_path_factory.mktemp("local")
    assert batch(flights, folder, "--workers", "1") == 0
    return folder


def batch(flights: Path, folder: Path, *options: str) -> int:
    return main(["batch", str(flights), "--vehicle", "iitb-mav", "-o", str(folder), *options])


def results(folder: Path) -> dict[str, dict[str, Any]]:
    found = {path.name: json.loads(path.read_text()) for path in sorted((folder / "results").glob("*.json"))}
    return {name: {key: value for key, value in one.items() if key not in BESIDE} for name, one in found.items()}


def test_a_table_of_flights_and_what_was_done_is_not_done_again_beside_what_comes_from_an_address(
    local: Path, flights: Path, tmp_path: Path
) -> None:
    """The address is of a store that is no folder of ours; fsspec's memory would be another one in a worker."""
    table = pyarrow.parquet.read_table(local / "flights.parquet").to_pydict()
    assert table["flight"] == ["flight1", "flight2", "flight3", "flight4"]
    assert table["aircraft"] == ["iitb-mav"] * 4
    assert set(table["error"]) == {""}
    assert all(abs(value - 1.59) < 0.05 for value in table["Cm_de"])
    assert "<h2" in (local / "fleet.html").read_text()
    folder = shutil.copytree(local, tmp_path / "again")
    stamps = {path: path.stat().st_mtime_ns for path in (folder / "results").iterdir()}
    one = sorted(stamps)[0]
    one.unlink()
    address = f"file://{flights}/flight1.tlog"
    assert main(["batch", str(flights), address, "--vehicle", "iitb-mav", "-o", str(folder), "--workers", "1"]) == 0
    again = {path: path.stat().st_mtime_ns for path in (folder / "results").iterdir()}
    (came,) = again.keys() - stamps.keys()
    assert [path for path in stamps if again[path] != stamps[path]] == [one]
    same = next(found for name, found in results(local).items() if name.startswith("flight1-"))
    assert json.loads(came.read_text())["model"]["coefficients"] == same["model"]["coefficients"]


def test_without_parquet_s_library_the_table_is_a_csv_and_that_is_said(
    local: Path, flights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shutil.copytree(local, tmp_path / "plain")
    rows = (folder / "flights.csv").read_bytes()
    for table in folder.glob("flights.*"):
        table.unlink()
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert batch(flights, folder, "--workers", "1") == 0
    assert [table.name for table in folder.glob("flights.*")] == ["flights.csv"]
    assert (folder / "flights.csv").read_bytes() == rows
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.endswith("flights.csv (no Parquet: pip install 'flight-model-ground-station[parquet]')")


def test_workers_of_a_cluster_give_the_same_and_one_that_is_killed_loses_nothing(
    local: Path, flights: Path, tmp_path: Path
) -> None:
    with cluster(2) as (address, workers), ThreadPoolExecutor(1) as beside:

        def kill_one() -> None:
            wait_until(lambda: any((tmp_path / "results").glob("*.json")), 120.0)
            workers[0].kill()

        killed = beside.submit(kill_one)
        assert batch(flights, tmp_path, "--scheduler", address, "--quiet") == 0
        killed.result()
        assert workers[0].wait(PATIENCE_S) == -signal.SIGKILL
    assert results(tmp_path) == results(local)


def test_a_model_is_held_against_every_flight(
    flights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "damped").mkdir()
    for seed in (5, 6):
        sim_vehicle(["fly", "--manoeuvre", "multisine", "--duration", "8", "--effect", "pitch_damping:Cm_q=-9",
                     "--seed", str(seed), "--record", str(tmp_path / "damped" / f"flight{seed}.mcap")])  # fmt: skip
    against = ("--discrepancy", "iitb-mav", "--method", "map")  # the quickest
    assert batch(tmp_path / "damped", tmp_path / "out", *against, "--workers", "2") == 0
    said = capsys.readouterr().out
    assert "iitb-mav: missing effect by pitch_damping: 2 of 2 flights" in said
    assert "2 of 2 flights compared" in said
    table = pyarrow.parquet.read_table(tmp_path / "out" / "findings.parquet").to_pydict()
    assert table["effect"] == ["pitch_damping"] * 2
    size, std = (table[f"pitch_damping.Cm_q{end}"] for end in ("", "_std"))
    assert all(abs(value + 9.0) < 4.0 * bar for value, bar in zip(size, std, strict=True))
    assert all(left < 0.5 * gap for gap, left in zip(table["gap_q"], table["left_q"], strict=True))
    assert batch(flights, tmp_path / "other", "--discrepancy", "iitb-mav", "--method", "oe") == 2
    assert "held against a model by auto, map, fe" in capsys.readouterr().err


def test_the_flights_of_a_folder_are_estimated_together_as_a_campaign(
    local: Path, flights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for day, seeds in (("monday", (1, 2)), ("tuesday", (3, 4))):
        (tmp_path / "days" / day).mkdir(parents=True)
        for seed in seeds:
            shutil.copy(flights / f"flight{seed}.tlog", tmp_path / "days" / day)
    (tmp_path / "days" / "tuesday" / "cut.tlog").write_bytes((flights / "flight1.tlog").read_bytes()[:3000])
    assert batch(tmp_path / "days", tmp_path / "out", "--campaigns", "--workers", "1") == 0
    said = capsys.readouterr().out
    assert "2 of 2 campaigns identified" in said
    assert "left out of tuesday: cut: " in said
    assert "<p>2 campaigns, of which 0" in (tmp_path / "out" / "fleet.html").read_text()
    table = pyarrow.parquet.read_table(tmp_path / "out" / "flights.parquet").to_pydict()
    assert table["flight"] == ["monday", "tuesday"]
    assert table["flights"] == [2, 2]
    assert ["cut" in one for one in table["left_out"]] == [False, True]
    alone = pyarrow.parquet.read_table(local / "flights.parquet").to_pydict()["Cm_de_std"]
    # Two flights of much the same quality know as much as each of them, twice.
    assert table["Cm_de_std"][0] < 0.85 * min(alone)
    assert all(abs(value - 1.59) < 3.0 * std for value, std in zip(table["Cm_de"], table["Cm_de_std"], strict=True))
    monday, tuesday = results(tmp_path / "out").values()
    assert not any("left out" in one for one in monday["warnings"])
    assert any(one.startswith("left out: cut: ") for one in tuesday["warnings"])


def test_a_store_that_cannot_be_read_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class DeniedError(Exception):
        """As a store's library has them, of no kind that Python knows."""

    def refuse(self: LocalFileSystem, path: str, **options: object) -> None:
        raise DeniedError("no credentials were found")

    monkeypatch.setattr(LocalFileSystem, "find", refuse)
    command = ["batch", f"file://{tmp_path}", "--vehicle", "iitb-mav", "-o", str(tmp_path / "out")]
    assert main(command) == 2
    said = capsys.readouterr().err
    assert "no credentials were found" in said
    assert said.count("\n") == 1


def test_odd_files_are_rows_that_say_why(flights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cut.tlog").write_bytes((flights / "flight1.tlog").read_bytes()[:3000])
    (tmp_path / "notes.txt").write_text("no flight")
    assert batch(tmp_path, tmp_path / "out", "--workers", "1") == 1
    said = capsys.readouterr().out
    assert "no result: cut: " in said
    assert "notes" not in said
    assert "0 of 1 flights identified" in said


def test_folders_of_aircraft_have_their_own_vehicle_and_name(tmp_path: Path) -> None:
    for name in ("anna", "bert"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "vehicle.toml").write_text("name = 'x'\n")
        (tmp_path / name / "one.tlog").write_bytes(b"")
    (tmp_path / "two.tlog").write_bytes(b"")
    with pytest.raises(SettingsError, match=r"two\.tlog: no vehicle"):
        orders([str(tmp_path)], None, {})
    found = orders([str(tmp_path)], "ultrastick25e", {})
    assert [one.aircraft for one in found] == ["anna", "bert", "ultrastick25e"]
    of_folders = orders([str(tmp_path / "anna"), str(tmp_path / "bert")], None, {})
    assert orders([str(tmp_path / "*" / "*.tlog")], None, {}) == of_folders
    before = found[0].key
    time.sleep(0.01)
    (tmp_path / "anna" / "one.tlog").write_bytes(b"longer")
    assert orders([str(tmp_path)], "ultrastick25e", {})[0].key != before
    with pytest.raises(SettingsError, match="no recording or log there"):
        orders([str(tmp_path / "nothing")], "iitb-mav", {})


@pytest.mark.parametrize(
    ("options", "words"),
    [(("--workers", "0"), "1 or more"), (("--scheduler", "tcp://127.0.0.1:9"), "no scheduler answers there")],
)
def test_what_cannot_work_is_said_in_one_line(
    options: tuple[str, ...],
    words: str,
    flights: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Who does not listen is asked for a second instead of ten.
    monkeypatch.setattr(distributed, "Client", lambda address, timeout: CLIENT(address, timeout="1s"))
    assert batch(flights, tmp_path, *options) == 2
    said = capsys.readouterr().err
    assert words in said
    assert "Traceback" not in said


def test_a_flight_that_ends_its_worker_is_without_a_result_and_the_others_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batches, "worked", deadly)
    sources = ["one", "deadly", "two", "away", *(f"more{k}" for k in range(8))]
    wanted = [Order(source, (source,), "iitb-mav", "x", {}, "") for source in sources]
    for _ in range(2):
        with batches.places(2, None) as where:
            found = batches.run(wanted, tmp_path, where, lambda share, text: None)
        assert [one.get("error", "")[:20] for one in found] == [
            "", "its worker ended wit", "", "the store does not a", *[""] * 8
        ]  # fmt: skip
    # What another run may find otherwise is not kept.
    assert len(list(tmp_path.iterdir())) == len(sources) - 2


def test_an_interrupted_batch_ends_at_once(flights: Path, tmp_path: Path) -> None:
    running = subprocess.Popen(
        [sys.executable, "-m", "gcs", "batch", str(flights), "--vehicle", "iitb-mav", "-o", str(tmp_path), "--workers",
         "1", "--quiet"],
    )  # fmt: skip
    try:
        wait_until(lambda: any((tmp_path / "results").glob("*.json")), 60.0)
        begun = time.monotonic()
        running.send_signal(signal.SIGINT)
        assert running.wait(timeout=30.0) == 130
        assert time.monotonic() - begun < 20.0
    finally:
        running.kill()
    assert len(list((tmp_path / "results").glob("*.json"))) < 4
