"""The catalogue keeps what it is told, in order, and over a restart."""

import sqlite3
from contextlib import closing
from dataclasses import replace
from itertools import count
from pathlib import Path

import pytest

from gcs.catalogue.flight_table import UNDO_NS, Flight
from gcs.catalogue.intake import leftovers
from gcs.catalogue.retention import Retention, RetentionRule
from gcs.catalogue.store import Catalogue
from gcs.errors import CatalogueError, CatalogueFileError
from gcs.settings import Settings


def flight(number: int, state: str = "complete") -> Flight:
    start = 1_000 * number
    return Flight(f"f{number}", f"f{number}.mcap", "name", "live", state, 1, start, start + 5, 10, 100)


@pytest.fixture
def catalogue(tmp_path: Path) -> Catalogue:
    ticks = count(1)
    return Catalogue(tmp_path / "c.sqlite", clock=lambda: next(ticks))


def test_pages_hold_every_flight_once_newest_first(catalogue: Catalogue) -> None:
    for number in (3, 1, 7, 5, 2, 6, 4):
        catalogue.put_flight(flight(number))
    seen: list[str] = []
    after = None
    while page := catalogue.flights(limit=3, after=after):
        seen += [entry.id for entry in page]
        after = page[-1].id
    assert seen == ["f7", "f6", "f5", "f4", "f3", "f2", "f1"]


@pytest.mark.parametrize(
    ("search", "found"),
    [
        ("", "cbad"),
        ("2027-01-15 08", "ba"),
        ("CALM", "b"),
        ("calm 2027", "b"),
        ("calm 2030", ""),
        ("%", ""),
        ("'", ""),
        ("Über", "d"),
        ("FLUG", "d"),
    ],
)
def test_flights_are_found_by_words_of_name_id_and_start(catalogue: Catalogue, search: str, found: str) -> None:
    for letter, name, start_s in (("a", "first.tlog", 1_800_000_000), ("b", "Calm.tlog", 1_800_000_060)):
        start = start_s * 1_000_000_000
        catalogue.put_flight(Flight(letter, "f.mcap", name, "upload", "complete", 1, start, start, 0, 0))
    catalogue.put_flight(Flight("d", "f.mcap", "Überflug.bin", "upload", "complete", 1, 10**18, 10**18, 0, 0))
    catalogue.put_flight(Flight("c", "f.mcap", "f.mcap", "live", "complete", 1, 2 * 10**18, 2 * 10**18, 0, 0))
    assert "".join(entry.id for entry in catalogue.flights(search=search)) == found


def test_flights_of_the_same_moment_are_all_listed(catalogue: Catalogue) -> None:
    for letter in "abcd":
        catalogue.put_flight(Flight(letter, f"{letter}.mcap", "", "live", "complete", 1, 5, 6, 0, 0))
    first = catalogue.flights(limit=2)
    rest = catalogue.flights(limit=9, after=first[-1].id)
    assert [entry.id for entry in (*first, *rest)] == ["d", "c", "b", "a"]


def test_what_is_not_there_is_named(catalogue: Catalogue) -> None:
    for ask in (catalogue.flight, catalogue.job, catalogue.model):
        with pytest.raises(CatalogueError, match="nope"):
            ask("nope")
    with pytest.raises(CatalogueError, match="identify"):
        catalogue.result("nope", "identify")


def test_jobs_run_in_the_order_in_which_they_were_queued(catalogue: Catalogue) -> None:
    queued = [catalogue.add_job("f1", "identify", {"n": n}).id for n in range(3)]
    taken = []
    while job := catalogue.take_job():
        assert job.state == "running"
        taken.append(job.id)
    assert taken == queued


def test_progress_never_goes_back_and_stays_within_0_and_1(catalogue: Catalogue) -> None:
    job = catalogue.add_job("f1", "identify", {})
    for value, expected in ((0.5, 0.5), (0.2, 0.5), (7.0, 1.0)):
        catalogue.report_progress(job.id, value, f"at {value}")
        assert catalogue.job(job.id).progress == expected
    assert catalogue.job(job.id).log == ["at 0.5", "at 0.2", "at 7.0"]


def test_the_newest_result_counts_and_its_model_is_listed(catalogue: Catalogue) -> None:
    for value in (1.0, 2.0):
        job = catalogue.add_job("f1", "identify", {})
        taken = catalogue.take_job()
        assert taken is not None
        model = {"name": f"m{value}", "coefficients": {"CL_0": {"value": value}}}
        catalogue.finish_job(taken, {"schema": "identification/1", "model": model, "bad": float("nan")})
    result = catalogue.result("f1", "identify")
    assert result["model"]["name"] == "m2.0"
    assert result["bad"] is None
    newest, oldest = catalogue.models()
    assert (newest["name"], oldest["name"]) == ("m2.0", "m1.0")
    assert catalogue.model(newest["id"])["coefficients"]["CL_0"]["value"] == 2.0
    assert catalogue.job(job.id).state == "done"


def stored(catalogue: Catalogue, flight_id: str, kind: str, **result: object) -> None:
    job = catalogue.add_job(flight_id, kind, {})
    catalogue.finish_job(job, {"model": {"name": "m", "coefficients": {}}, **result})


def test_models_are_listed_with_flight_verdict_and_effects(tmp_path: Path) -> None:
    path = tmp_path / "c.sqlite"
    with closing(Catalogue(path)) as catalogue:
        catalogue.put_flight(replace(flight(1), name="calm morning.tlog", source="upload"))
        catalogue.put_flight(flight(2))
        stored(catalogue, "f1", "identify")
        stored(catalogue, "f1", "discrepancy", verdict="missing_effect", effects=[{"name": "stall"}, {"name": "wind"}])
        stored(catalogue, "f2", "discrepancy", verdict="none", effects=[])
        listed = catalogue.models()
    assert [(m["flight_name"], m["verdict"], m["effects"]) for m in listed] == [
        ("f2", "none", []),
        ("calm morning.tlog", "missing_effect", ["stall", "wind"]),
        ("calm morning.tlog", None, []),
    ]
    # A file of a version that did not keep them.
    with closing(sqlite3.connect(path)) as db:
        db.executescript("ALTER TABLE models DROP COLUMN verdict; ALTER TABLE models DROP COLUMN found")
    with closing(Catalogue(path)) as catalogue:
        assert catalogue.models() == listed


def test_a_job_that_stops_the_service_twice_is_not_tried_a_third_time(tmp_path: Path) -> None:
    path = tmp_path / "c.sqlite"
    first = Catalogue(path)
    job = first.add_job("f1", "identify", {})
    first.take_job()
    first.close()
    second = Catalogue(path)
    second.requeue_interrupted_jobs()
    assert second.job(job.id).state == "queued"
    second.take_job()
    second.close()
    third = Catalogue(path)
    third.requeue_interrupted_jobs()
    assert third.job(job.id).state == "failed"
    assert "for the second time; start it anew" in (third.job(job.id).error or "")


def test_a_catalogue_that_cannot_be_opened_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "c.sqlite").write_bytes(b"this is no database" * 100)
    with pytest.raises(CatalogueError, match="cannot be opened"):
        Catalogue(tmp_path / "c.sqlite")


def test_a_catalogue_of_an_older_version_is_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "catalogue.sqlite"
    with closing(sqlite3.connect(path)) as old:
        old.execute(
            "CREATE TABLE flights (id TEXT PRIMARY KEY, file TEXT NOT NULL, name TEXT NOT NULL, source TEXT NOT NULL,"
            " state TEXT NOT NULL, system INTEGER, start_ns INTEGER NOT NULL, end_ns INTEGER NOT NULL,"
            " messages INTEGER NOT NULL, bytes INTEGER NOT NULL, end_reason TEXT NOT NULL)"
        )
        old.execute(
            "INSERT INTO flights VALUES ('a', 'a.mcap', 'a.mcap', 'live', 'complete', 1, 1, 2, 3, 4, 'silence')"
        )
        old.commit()
    with closing(Catalogue(path)) as catalogue:
        flight = catalogue.flight("a")
        assert (flight.parts, flight.deleted_ns) == (1, None)
        assert flight.files(tmp_path) == [tmp_path / "a.mcap"]
        catalogue.put_flight(replace(flight, parts=2))
        assert catalogue.flight("a").files(tmp_path) == [tmp_path / "a.mcap", tmp_path / "a.part2.mcap"]


def test_a_damaged_file_is_an_error_with_a_name(tmp_path: Path) -> None:
    path = tmp_path / "c.sqlite"
    with closing(Catalogue(path)) as catalogue:
        for number in range(500):
            catalogue.put_flight(flight(number))
    pages = path.read_bytes()
    path.write_bytes(pages[:4096] + b"\xa5" * (len(pages) - 4096))
    with closing(sqlite3.connect(path)) as raw, pytest.raises(sqlite3.DatabaseError):
        raw.execute("SELECT * FROM flights").fetchall()
    with pytest.raises((CatalogueError, CatalogueFileError), match="catalogue"), closing(Catalogue(path)) as catalogue:
        catalogue.flights()


def test_flights_without_any_identification_are_found(catalogue: Catalogue) -> None:
    for number in range(1, 7):
        catalogue.put_flight(flight(number, "recording" if number == 6 else "complete"))
    catalogue.put_flight(replace(flight(2), system=None))
    catalogue.put_flight(replace(flight(3), source="upload"))
    catalogue.put_flight(replace(flight(4), state="recovered"))
    assert catalogue.mark_deleted("f5")
    assert [entry.id for entry in catalogue.unidentified_flights()] == ["f1", "f4"]
    catalogue.fail_job(catalogue.add_job("f1", "identify", {"kind": "identify"}).id, "no")
    catalogue.add_job("f4", "discrepancy", {"kind": "discrepancy"})
    assert [entry.id for entry in catalogue.unidentified_flights()] == ["f4"]


def test_a_deleted_flight_is_hidden_and_can_be_taken_back(catalogue: Catalogue) -> None:
    catalogue.put_flight(flight(1))
    catalogue.put_flight(flight(2))
    job = catalogue.add_job("f1", "identify", {})
    assert not catalogue.discard_flight("f1")  # a job needs it
    catalogue.take_job()
    catalogue.finish_job(job, {"model": {"name": "m"}})
    assert catalogue.discard_flight("f1")
    assert [entry.id for entry in catalogue.flights()] == ["f2"]
    assert [entry.id for entry in catalogue.flights(discarded=True)] == ["f1"]
    assert catalogue.models() == []
    assert catalogue.has_flight("f1")  # so that no other takes its id, nor a restart its recording for an unknown one
    with pytest.raises(CatalogueError, match=r"flight f1 was deleted; POST /api/flights/f1/restore takes that back"):
        catalogue.flight("f1")
    assert catalogue.restore_flight("f1").id == "f1"
    assert [model["id"] for model in catalogue.models()] == [job.id]


def test_a_deleted_flight_is_erased_after_a_day_with_all_that_came_of_it(tmp_path: Path) -> None:
    now = [1_000]
    catalogue = Catalogue(tmp_path / "c.sqlite", clock=lambda: now[0])
    catalogue.put_flight(flight(1))
    catalogue.put_flight(flight(2))
    jobs = [catalogue.add_job(name, "identify", {}) for name in ("f1", "f2")]
    for job in jobs:
        catalogue.report_progress(job.id, 0.5, "line")
        catalogue.finish_job(job, {"model": {"name": "m"}})
    for name in ("f1.mcap", "f2.mcap"):
        (tmp_path / name).write_bytes(b"x")
    assert catalogue.discard_flight("f1")
    upkeep = Retention(tmp_path, catalogue, RetentionRule())
    now[0] += UNDO_NS - 1
    upkeep.erase()
    assert (tmp_path / "f1.mcap").exists()
    now[0] += 1
    upkeep.erase()
    assert not (tmp_path / "f1.mcap").exists()
    assert not catalogue.has_flight("f1")
    assert [model["id"] for model in catalogue.models()] == [jobs[1].id]
    with pytest.raises(CatalogueError):
        catalogue.job(jobs[0].id)
    assert catalogue.job(jobs[1].id).log == ["line"]
    assert (tmp_path / "f2.mcap").exists()


def test_a_symbolic_link_among_the_recordings_is_not_followed(tmp_path: Path, catalogue: Catalogue) -> None:
    secret, flights = tmp_path / "secret", tmp_path / "data" / "flights"
    secret.write_bytes(b"not for everybody")
    flights.mkdir(parents=True)
    (flights / "f1.mcap").symlink_to(secret)
    with pytest.raises(CatalogueError, match=r"f1\.mcap in the data folder is a symbolic link, which is not followed"):
        flight(1).kept_files(flights)
    assert leftovers(Settings(data=tmp_path / "data"), catalogue) == []


def test_ground_data_goes_and_comes_with_its_flight_but_not_what_was_deleted_by_itself(tmp_path: Path) -> None:
    now = [0]
    catalogue = Catalogue(tmp_path / "c.sqlite", clock=lambda: now[0])
    catalogue.put_flight(flight(1))
    for number in (2, 3):
        catalogue.put_flight(replace(flight(number), follows="f1"))
    assert catalogue.discard_flight("f2")
    assert [one.id for one in catalogue.flights(discarded=True)] == ["f2"]
    now[0] = 5
    waiting = catalogue.add_job("f3", "identify", {})
    assert not catalogue.discard_flight("f1")  # a job needs what would go with it
    assert catalogue.cancel_job(waiting.id)
    assert catalogue.discard_flight("f1")
    assert [one.id for one in catalogue.flights(discarded=True)] == ["f1"]
    catalogue.restore_flight("f1")
    assert [one.id for one in catalogue.ground_after("f1")] == ["f3"]


def test_a_flight_that_is_restored_at_the_last_moment_is_not_erased(tmp_path: Path) -> None:
    now = [0]
    catalogue = Catalogue(tmp_path / "c.sqlite", clock=lambda: now[0])
    catalogue.put_flight(flight(1))
    assert catalogue.discard_flight("f1")
    now[0] = UNDO_NS
    assert [one.id for one in catalogue.flights_to_erase()] == ["f1"]
    catalogue.restore_flight("f1")
    assert not catalogue.erase_flight("f1")
    assert catalogue.flight("f1").id == "f1"
