"""Which recordings are deleted to make room, with real files and a clock that the test holds."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import httpx
import pytest
from patience import PATIENCE_S
from processes import service
from traffic import Vehicle, batch, ground_station_heartbeat, wait_until

from gcs.catalogue.flight_table import Flight
from gcs.catalogue.retention import Retention, RetentionRule
from gcs.catalogue.store import Catalogue
from gcs.cli import main
from gcs.errors import JobError, RecordingDeletedError
from gcs.jobs.runner import JobRunner
from gcs.mavlink.dialect import Dialect
from gcs.recording.parts import part_path
from gcs.settings import Settings
from gcs.station.capture import Capture

DAY = 86_400_000_000_000
NOW = 20_000 * DAY
SIZE = 1000


class Store:
    """A folder of recordings with a catalogue."""

    def __init__(self, folder: Path) -> None:
        self.settings = Settings(data=folder, vehicle="iitb-mav")
        self.settings.flights.mkdir()
        self.catalogue = Catalogue(self.settings.database, clock=lambda: NOW)

    def add(self, name: str, age_days: float, identification: str | None = "done", **changes: object) -> Path:
        """A flight that ended so long ago, and the state of its identification."""
        path = self.settings.flights / f"{name}.mcap"
        parts = int(str(changes.get("parts", 1)))
        for number in range(1, parts + 1):
            part_path(path, number).write_bytes(bytes(SIZE // parts))
        end = NOW - round(age_days * DAY)
        known: dict[str, object] = {"source": "live", "state": "complete", "system": 1, **changes}
        flight = Flight(
            id=name, file=path.name, name=name, start_ns=end - 60, end_ns=end, messages=5, bytes=SIZE, **known
        )
        self.catalogue.put_flight(flight)
        if identification is not None:
            job = self.catalogue.add_job(name, "identify", {"kind": "identify"})
            if identification != "queued":
                self.catalogue.take_job()
            if identification == "done":
                self.catalogue.finish_job(job, {"model": {"name": name}})
            elif identification == "skipped":
                self.catalogue.skip_job(job.id, "nothing airborne")
            elif identification == "failed":
                self.catalogue.fail_job(job.id, "no")
        return path

    def apply(self, **rule: float) -> list[str]:
        return Retention(self.settings.flights, self.catalogue, RetentionRule(**rule), clock=lambda: NOW).apply()

    @property
    def files(self) -> list[str]:
        return sorted(path.stem for path in self.settings.flights.iterdir())


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    made = Store(tmp_path)
    with closing(made.catalogue):
        yield made


def test_the_oldest_go_until_the_rest_has_the_size(store: Store) -> None:
    for name, age in (("c", 1.0), ("a", 3.0), ("d", 0.5), ("b", 2.0)):
        store.add(name, age)
    assert store.apply(keep_bytes=2.5 * SIZE) == ["a", "b"]
    assert store.files == ["c", "d"]
    assert store.apply(keep_bytes=2.5 * SIZE) == []


def test_old_ones_go_with_all_their_parts(store: Store) -> None:
    store.add("old", 8.0, parts=3)
    store.add("older", 9.0, "skipped")
    store.add("young", 6.9)
    assert store.apply(keep_days=7.0) == ["older", "old"]
    assert store.files == ["young"]


def test_what_was_not_worked_on_or_is_needed_is_never_deleted(store: Store) -> None:
    for identification in (None, "queued", "running", "failed"):
        store.add(f"is {identification}", 100.0, identification)
    store.add("being recorded", 100.0, state="recording")
    store.add("uploaded", 100.0, source="upload")
    store.add("recovered without a heartbeat", 100.0, None, system=None, state="recovered")
    store.add("to validate", 100.0)
    store.catalogue.add_job("is None", "identify", {"kind": "identify", "validate": ["to validate"]})
    before = store.files
    assert store.apply(keep_days=1.0, keep_bytes=1) == []
    assert store.files == before


def test_a_recording_goes_without_identification_only_if_no_autopilot_speaks_in_it(store: Store) -> None:
    for name, frame in (
        ("a ground station alone", ground_station_heartbeat()),
        ("a radio alone", Vehicle(51, 68).heartbeat()),
        ("an autopilot without a heartbeat", Vehicle(1, 1).attitude()),
    ):
        path = store.add(name, 100.0, None, system=None)
        path.unlink()
        capture = Capture(path, Dialect.load())
        capture.take("udp", batch([frame], NOW - 200 * DAY))
        capture.close(NOW - 200 * DAY)
    store.add("nobody can read it", 100.0, None, system=None)
    assert store.apply(keep_days=1.0) == ["a ground station alone", "a radio alone"]
    assert store.files == ["an autopilot without a heartbeat", "nobody can read it"]


def test_what_is_left_of_a_deleted_flight(store: Store) -> None:
    store.add("a", 3.0)
    store.add("b", 0.1)
    assert store.apply(keep_days=1.0) == ["a"]
    flight = store.catalogue.flight("a")
    assert flight.deleted_ns == NOW
    assert store.catalogue.result("a", "identify") == {"model": {"name": "a"}}
    assert len(store.catalogue.models()) == 2
    with pytest.raises(RecordingDeletedError, match="deleted on 2024-10-04"):
        flight.kept_files(store.settings.flights)
    with pytest.raises(RecordingDeletedError):
        JobRunner(store.settings, store.catalogue).submit("a", {"kind": "identify"})
    with pytest.raises(JobError, match="kind"):
        JobRunner(store.settings, store.catalogue).submit("b", {"kind": "x"})


@pytest.mark.whole_flight
def test_the_service_deletes_and_says_so(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.add("20240101T000000.000Z-1", 400.0)
    left_over = store.add("20230101T000000.000Z-1", 500.0)
    assert store.catalogue.mark_deleted(left_over.stem)  # as if the service had been killed just then
    store.catalogue.close()
    rule = ("--keep-days", "30", "--vehicle", "iitb-mav")
    with service("--data", tmp_path, *rule) as url, httpx.Client(base_url=url, timeout=PATIENCE_S) as client:
        wait_until(lambda: not store.files)
        answer = client.get("/api/flights/20240101T000000.000Z-1/recording")
        assert answer.status_code == 410
        assert answer.headers["content-type"] == "application/problem+json"
        assert "deleted" in answer.json()["detail"]
        flights = client.get("/api/flights").json()["flights"]
        assert [bool(flight["recording_deleted"]) for flight in flights] == [True, True]
        assert client.get("/api/flights/20240101T000000.000Z-1/identification").status_code == 200
        (told,) = client.get("/api/flights/20240101T000000.000Z-1").json()["damage"]
        assert "deleted" in told


def test_a_rule_without_a_vehicle_to_identify_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["serve", "--data", str(tmp_path), "--keep-size", "20GB"]) == 2
    assert "--vehicle" in capsys.readouterr().err
