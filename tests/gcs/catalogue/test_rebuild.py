"""A damaged catalogue is made anew from its backup, what can still be read, and the recordings."""

import os
import sqlite3
import threading
import time
from contextlib import closing
from pathlib import Path

import pytest
from traffic import SECOND, Vehicle, batch

from gcs.catalogue.backup import Backups, backups_in
from gcs.catalogue.retention import Retention, RetentionRule
from gcs.catalogue.store import Catalogue
from gcs.cli import main
from gcs.errors import CatalogueError
from gcs.mavlink.dialect import Dialect
from gcs.settings import Settings
from gcs.station.recorder import FlightRecorder

DAY = 86_400 * SECOND


def record(settings: Settings, catalogue: Catalogue, system: int, start: int) -> str:
    """Fly for a second; the flight's id."""
    recorder = FlightRecorder(settings.flights, Dialect.load(), catalogue)
    recorder.feed("test", batch(Vehicle(system).second(), start))
    recorder.close(start + SECOND)
    return catalogue.flights()[0].id


def result_of(catalogue: Catalogue, flight: str) -> str:
    job = catalogue.add_job(flight, "identify", {})
    catalogue.finish_job(job, {"schema": "identification/1", "model": {"name": "m" * 3000}})
    return job.id


def _results(settings: Settings) -> list[tuple[int]]:
    with closing(sqlite3.connect(settings.database)) as db:
        return db.execute("SELECT number FROM results").fetchall()


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data=tmp_path)


def test_what_was_in_the_backup_and_what_was_recorded_since_is_there_again(
    settings: Settings, capsys: pytest.CaptureFixture[str]
) -> None:
    with closing(Catalogue(settings.database)) as catalogue:
        first = record(settings, catalogue, 1, 1_800_000_000 * SECOND)
        job = result_of(catalogue, first)
        Backups(settings.backups, catalogue, time.time_ns).make_if_due()
        second = record(settings, catalogue, 1, 1_800_000_100 * SECOND)
    settings.database.write_bytes(b"not a database at all" * 500)
    with pytest.raises(CatalogueError, match="if it is damaged, stop the service and run `gcs repair"):
        Catalogue(settings.database)
    assert main(["repair", str(settings.data)]) == 0
    said = capsys.readouterr().out
    assert "the catalogue is damaged" in said
    assert "recordings that it did not know: 1" in said
    with closing(Catalogue(settings.database)) as catalogue:
        assert {flight.id for flight in catalogue.flights()} == {first, second}
        assert catalogue.job_and_result(first, "identify")[0] == job
    (kept,) = settings.data.glob("damaged-*/catalogue.sqlite")
    assert kept.read_bytes().startswith(b"not a database")
    assert main(["repair", str(settings.data)]) == 0
    assert "the catalogue is whole" in capsys.readouterr().out


def test_what_can_still_be_read_of_a_damaged_catalogue_is_taken_over(settings: Settings) -> None:
    with closing(Catalogue(settings.database)) as catalogue:
        flights = [record(settings, catalogue, 1, (1_800_000_000 + 100 * i) * SECOND) for i in range(3)]
        for flight in flights:
            for _ in range(20):
                result_of(catalogue, flight)
    whole = bytearray(settings.database.read_bytes())
    of_results = [at for at in range(4096, len(whole), 4096) if b"m" * 500 in whole[at : at + 4096]]
    middle = of_results[len(of_results) // 2]
    whole[middle : middle + 4096] = b"\xff" * 4096
    settings.database.write_bytes(whole)
    assert main(["repair", str(settings.data)]) == 0
    with closing(sqlite3.connect(settings.database)) as db:
        assert db.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    with closing(Catalogue(settings.database)) as catalogue:
        assert {flight.id for flight in catalogue.flights()} == set(flights)
        jobs = sum(len(catalogue.jobs_of(flight)) for flight in flights)
        assert jobs == 60
        results = [catalogue.result(flight, "identify") for flight in flights]
        assert [result["schema"] for result in results] == ["identification/1"] * 3
        assert 100 < len(catalogue.models()) + len(_results(settings)) < 120  # all but what stood in that page


def test_a_folder_that_is_none_of_the_service_is_not_made_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["repair", str(tmp_path / "elsewhere")]) == 1
    assert "is no data folder of gcs serve" in capsys.readouterr().err
    assert not (tmp_path / "elsewhere").exists()


def test_backups_are_made_once_a_day_and_the_last_three_are_kept(settings: Settings) -> None:
    with closing(Catalogue(settings.database)) as catalogue:
        flight = record(settings, catalogue, 1, 1_800_000_000 * SECOND)
        now = [time.time_ns()]
        backups = Backups(settings.backups, catalogue, lambda: now[0])
        backups.make_if_due()
        backups.make_if_due()
        assert len(backups_in(settings.backups)) == 1
        for day in range(1, 6):
            now[0] = time.time_ns() + day * DAY + SECOND
            backups.make_if_due()
        assert len(backups_in(settings.backups)) == 3
    with closing(sqlite3.connect(backups_in(settings.backups)[0])) as db:
        assert db.execute("SELECT id FROM flights").fetchall() == [(flight,)]
    assert not list(settings.backups.glob("*.unfinished"))


def test_a_deletion_that_was_taken_back_since_the_backup_is_not_carried_out(settings: Settings) -> None:
    now = [time.time_ns()]
    with closing(Catalogue(settings.database, clock=lambda: now[0] - 3 * DAY)) as catalogue:
        flight = record(settings, catalogue, 1, 1_800_000_000 * SECOND)
        assert catalogue.discard_flight(flight)
        settings.backups.mkdir()
        catalogue.back_up(settings.backups / "catalogue-20270115T080000Z.sqlite")
        catalogue.restore_flight(flight)
    settings.database.write_bytes(b"damaged" * 1000)
    assert main(["repair", str(settings.data)]) == 0
    with closing(Catalogue(settings.database)) as catalogue:
        Retention(settings.flights, catalogue, RetentionRule()).erase()
        assert (settings.flights / f"{flight}.mcap").exists()
        assert catalogue.restore_flight(flight).id == flight


@pytest.mark.parametrize("left", [None, b""])
def test_a_catalogue_that_is_gone_or_empty_comes_from_its_backup(settings: Settings, left: bytes | None) -> None:
    with closing(Catalogue(settings.database)) as catalogue:
        flight = record(settings, catalogue, 1, 1_800_000_000 * SECOND)
        job = result_of(catalogue, flight)
        Backups(settings.backups, catalogue, time.time_ns).make_if_due()
    settings.database.unlink()
    if left is not None:
        settings.database.write_bytes(left)
    assert main(["repair", str(settings.data)]) == 0
    with closing(Catalogue(settings.database)) as catalogue:
        assert catalogue.job_and_result(flight, "identify")[0] == job


def test_recordings_that_nobody_knows_any_more_are_never_deleted_by_a_rule(settings: Settings) -> None:
    with closing(Catalogue(settings.database)) as catalogue:
        flight = record(settings, catalogue, 1, 1_800_000_000 * SECOND)
    settings.database.unlink()
    assert main(["repair", str(settings.data)]) == 0
    with closing(Catalogue(settings.database)) as catalogue:
        assert catalogue.flight(flight).source == "upload"
        assert Retention(settings.flights, catalogue, RetentionRule(keep_bytes=0)).apply() == []


def test_a_backup_of_the_future_is_no_reason_for_one_each_minute(settings: Settings) -> None:
    with closing(Catalogue(settings.database)) as catalogue:
        record(settings, catalogue, 1, 1_800_000_000 * SECOND)
        backups = Backups(settings.backups, catalogue, time.time_ns)
        settings.backups.mkdir()
        future = settings.backups / "catalogue-20300101T000000Z.sqlite"
        future.write_bytes(b"x")
        os.utime(future, (2_000_000_000, 2_000_000_000))
        for _ in range(3):
            backups.make_if_due()
        assert len(backups_in(settings.backups)) == 2


def test_a_backup_ends_while_the_catalogue_is_written(settings: Settings) -> None:
    with closing(Catalogue(settings.database)) as catalogue:
        flight = record(settings, catalogue, 1, 1_800_000_000 * SECOND)
        for _ in range(300):
            result_of(catalogue, flight)
        job, stopping = catalogue.add_job(flight, "identify", {}), threading.Event()

        def write() -> None:
            while not stopping.is_set():
                catalogue.report_progress(job.id, 0.5, "x" * 500)

        writer = threading.Thread(target=write)
        writer.start()
        try:
            catalogue.back_up(settings.data / "copy.sqlite")
        finally:
            stopping.set()
            writer.join()
    with closing(sqlite3.connect(settings.data / "copy.sqlite")) as db:
        assert db.execute("PRAGMA integrity_check").fetchone() == ("ok",)
