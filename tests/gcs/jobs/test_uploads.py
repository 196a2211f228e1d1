"""Uploads are read in a process of their own: what such a process may do to itself, and whose id a flight gets."""

import errno
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from traffic import Vehicle, wait_until

from gcs.catalogue.flight_table import Flight
from gcs.catalogue.intake import recover
from gcs.catalogue.store import Catalogue
from gcs.errors import ImportFileError, ServiceError
from gcs.jobs.uploads import Uploads
from gcs.recording.reader import Recording
from gcs.settings import Settings

GREEDY = """
import numpy, sys
import gcs.jobs.intakeworker as worker
def greedy(*given, **named):
    kept = [numpy.empty(1 << 24) for _ in range(1 << 12)]
worker.import_file = greedy
sys.exit(worker.main())
"""


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    made = Settings(data=tmp_path / "data")
    made.flights.mkdir(parents=True)
    return made


@pytest.fixture
def catalogue(settings: Settings) -> Iterator[Catalogue]:
    with closing(Catalogue(settings.database)) as made:
        yield made


def log_without_time(folder: Path) -> Path:
    """A telemetry log whose stamps are all 0."""
    folder.mkdir()
    path = folder / "upload"
    path.write_bytes(b"".join(bytes(8) + frame for frame in Vehicle().second()))
    return path


def one_line(error: pytest.ExceptionInfo[Exception]) -> str:
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.whole_flight
def test_uploads_of_the_same_moment_get_different_ids_and_lose_nothing(
    settings: Settings, catalogue: Catalogue, tmp_path: Path
) -> None:
    both = Uploads(settings, catalogue), Uploads(settings, catalogue)
    paths = [log_without_time(tmp_path / str(i)) for i in range(2)]
    with ThreadPoolExecutor(2) as pool:
        made = list(pool.map(lambda i: both[i].take_in(paths[i], f"{i}.tlog"), range(2)))
    assert len({flight.id for flight in made}) == 2
    for i, flight in enumerate(made):
        assert catalogue.flight(flight.id) == flight
        assert (flight.name, flight.state, flight.source) == (f"{i}.tlog", "complete", "upload")
        assert sum(Recording(settings.flights / flight.file).counts().values()) == 52


@pytest.mark.whole_flight
@pytest.mark.parametrize("links", [True, False], ids=["hard-links", "one-name-a-file"])
def test_an_upload_never_takes_the_place_of_a_recording_begun_at_the_same_instant(
    settings: Settings, catalogue: Catalogue, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: bool
) -> None:
    def refused(source: Path, target: Path) -> None:
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    if not links:
        monkeypatch.setattr(os, "link", refused)
    begun: list[Path] = []
    add = catalogue.add_flight

    def recorder_is_quicker(flight: Flight) -> bool:
        if not begun:
            begun.append(settings.flights / flight.file)
            begun[0].write_bytes(b"being recorded")
        return add(flight)

    monkeypatch.setattr(catalogue, "add_flight", recorder_is_quicker)
    made = Uploads(settings, catalogue).take_in(log_without_time(tmp_path / "in"), "mine.tlog")
    assert begun[0].read_bytes() == b"being recorded"
    assert made.id == f"{begun[0].stem}-2"
    assert catalogue.flights() == [made]
    assert sum(Recording(settings.flights / made.file).counts().values()) == 52
    assert not (tmp_path / "in" / "converted.mcap").exists()


def test_an_id_is_given_once(catalogue: Catalogue) -> None:
    flight = Flight("a", "a.mcap", "first", "upload", "recording", 1, 1, 2, 3, 4)
    assert catalogue.add_flight(flight)
    assert not catalogue.add_flight(replace(flight, name="second"))
    assert catalogue.flight("a").name == "first"


@pytest.mark.whole_flight
@pytest.mark.parametrize(
    ("worker", "words"),
    [
        ((sys.executable, "-c", "import os; os.abort()"), "signal 6"),
        ((sys.executable, "-c", "raise ValueError('odd log')"), "odd log"),
        ((sys.executable, "-c", "print('no answer')"), "cannot be read"),
        ((sys.executable, "-c", "import time; time.sleep(600)"), "within 0.5 s"),
        ((sys.executable, "-c", GREEDY), "more memory to read than 1 GB"),
    ],
)
def test_a_file_that_breaks_its_reader_breaks_nothing_else(
    settings: Settings, catalogue: Catalogue, tmp_path: Path, worker: tuple[str, ...], words: str
) -> None:
    longest = 0.5 if "0.5 s" in words else 60.0
    uploads = Uploads(settings, catalogue, worker, longest, 1_000_000_000)
    with pytest.raises(ImportFileError) as error:
        uploads.take_in(log_without_time(tmp_path / "in"), "a.tlog")
    assert words in one_line(error)
    assert catalogue.flights() == []
    assert list(settings.flights.iterdir()) == []


def test_stopping_the_service_ends_what_is_being_read(settings: Settings, catalogue: Catalogue, tmp_path: Path) -> None:
    begun = tmp_path / "begun"
    sleeper = f"import os, pathlib, time; pathlib.Path({str(begun)!r}).write_text(str(os.getpid())); time.sleep(600)"
    uploads = Uploads(settings, catalogue, (sys.executable, "-c", sleeper))
    caught: list[Exception] = []

    def take_in() -> None:
        try:
            uploads.take_in(log_without_time(tmp_path / "in"), "a.tlog")
        except ServiceError as error:
            caught.append(error)

    thread = threading.Thread(target=take_in)
    thread.start()
    number = wait_until(lambda: begun.exists() and begun.read_text())
    uploads.close()
    thread.join()
    assert "being stopped" in str(caught[0])
    assert subprocess.run(["/bin/kill", "-0", number], capture_output=True, check=False).returncode != 0


@pytest.mark.whole_flight
def test_a_crash_before_an_upload_has_its_place_leaves_no_flight_and_one_behind_it_leaves_an_upload(
    settings: Settings, catalogue: Catalogue, tmp_path: Path
) -> None:
    made = Uploads(settings, catalogue).take_in(log_without_time(tmp_path / "in"), "mine.tlog")
    catalogue.put_flight(replace(made, state="recording"))
    catalogue.put_flight(replace(made, id="b", file="b.mcap", state="recording"))
    recover(settings, catalogue)
    assert catalogue.flights() == [made]
