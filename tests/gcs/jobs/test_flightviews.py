"""What is shown of flights: read by a worker, once as long as the files stay as they are."""

import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from recorded_stream import DIALECT, Stream
from traffic import wait_until

from gcs.catalogue.flight_table import Flight
from gcs.errors import CatalogueError, ServiceError, SignalMapError
from gcs.jobs.flightviews import FlightViews
from gcs.jobs.viewworker import outline
from gcs.recording.storage import StorageOptions
from gcs.recording.writer import McapWriter
from gcs.settings import Settings
from sysid.signals.flight import Signal

pytestmark = pytest.mark.whole_flight

# The usual worker, which notes that it was started.
COUNTING = "import sys; open({path!r}, 'a').write('x'); import gcs.jobs.viewworker as worker; sys.exit(worker.main())"
GREEDY = """
import numpy, sys
import gcs.jobs.viewworker as worker
def greedy(*given):
    kept = [numpy.empty(1 << 24) for _ in range(1 << 12)]
worker.summary = greedy
sys.exit(worker.main())
"""
SLEEPY = "import time; time.sleep(600)"


def flight(name: str = "a", state: str = "complete") -> Flight:
    return Flight(name, f"{name}.mcap", name, "live", state, 1, 1, 2, 0, 0)


class Folder:
    """A data folder, its views, and how often their worker was started."""

    def __init__(self, path: Path) -> None:
        self.settings = Settings(data=path, vehicle="iitb-mav")
        self.settings.flights.mkdir()
        self._starts = path / "starts"
        self.views = self.anew()

    def anew(self, **changes: object) -> FlightViews:
        program = COUNTING.format(path=str(self._starts))
        return FlightViews(Settings(**{**vars(self.settings), **changes}), (sys.executable, "-c", program))

    def write(self, name: str = "a", messages: int = 200) -> None:
        path = self.settings.flights / f"{name}.mcap"
        path.unlink(missing_ok=True)
        with McapWriter(path, DIALECT) as writer:
            Stream().feed(writer, messages)

    @property
    def starts(self) -> int:
        return self._starts.stat().st_size if self._starts.exists() else 0


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Folder]:
    made = Folder(tmp_path)
    yield made
    made.views.close()


def test_a_flight_that_is_recorded_is_read_again_only_when_its_file_has_changed(folder: Folder) -> None:
    stream, live = Stream(), flight(state="recording")
    with McapWriter(folder.settings.flights / "a.mcap", DIALECT, chunk_seconds=0.1) as writer:
        stream.feed(writer, 100)
        writer.flush()
        first = folder.views.summary(live)
        assert (sum(first["topics"].values()), folder.starts) == (100, 1)
        assert folder.views.summary(live) == first
        assert folder.starts == 1
        stream.feed(writer, 100)
        writer.flush()
        assert sum(folder.views.summary(live)["topics"].values()) == 200
        assert folder.starts == 2
    assert list(folder.settings.views.iterdir()) == []


def test_a_flight_that_is_over_is_read_once_for_all_who_ask_and_by_the_next_service_too(folder: Folder) -> None:
    folder.write()
    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(lambda _: folder.views.summary(flight()), range(6)))
    assert found == [found[0]] * 6
    name = found[0]["signals"][0]
    shown = folder.views.series(flight(), [name], None, None, 50)[name]
    with closing(folder.anew()) as later:
        assert later.summary(flight()) == found[0]
        assert later.series(flight(), [name], None, None, 50)[name] == shown
    assert folder.starts == 1


def test_what_is_shown_is_what_the_recording_holds(folder: Folder) -> None:
    from gcs.flights.signals import extract
    from gcs.recording.reader import Recording
    from sim_vehicle.vehicle.vehicle_file import load_vehicle

    folder.write()
    held = extract(Recording([folder.settings.flights / "a.mcap"]), load_vehicle("iitb-mav"), 1).signals
    assert folder.views.summary(flight())["signals"] == list(held)
    for name, signal in held.items():
        shown = folder.views.series(flight(), [name], None, None, 100_000)[name]
        assert (shown["unit"], shown["source"]) == (signal.unit, signal.source)
        np.testing.assert_array_equal(shown["time"], signal.time_s)
        np.testing.assert_array_equal(np.array(shown["value"], float), signal.values)


def test_another_vehicle_file_or_a_longer_recording_is_read_anew_and_the_old_folder_goes(folder: Folder) -> None:
    folder.write()
    folder.views.summary(flight())
    folder.write(messages=300)
    assert sum(folder.views.summary(flight())["topics"].values()) == 300
    assert len(list(folder.settings.views.iterdir())) == 1
    with closing(folder.anew(vehicle="su27-wind-tunnel")) as other:
        other.summary(flight())
    assert folder.starts == 3
    assert len(list(folder.settings.views.iterdir())) == 1


def test_a_vehicle_file_that_cannot_be_used_is_a_warning_of_the_flight(folder: Folder, tmp_path: Path) -> None:
    folder.write()
    broken = tmp_path / "broken.toml"
    broken.write_text("mass = [")
    with closing(folder.anew(vehicle=str(broken))) as views:
        found = views.summary(flight())
        assert sum(found["topics"].values()) == 200
        assert "broken.toml" in found["warnings"][0]
        with pytest.raises(SignalMapError, match=r"broken\.toml"):
            views.series(flight(), ["phi"], None, None, 10)


def test_what_is_prepared_needs_no_reading_later(folder: Folder) -> None:
    folder.write()
    folder.views.prepare(flight())
    wait_until(lambda: list(folder.settings.views.glob("a-*/summary.json")))
    assert folder.views.summary(flight())["signals"]
    assert folder.starts == 1


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("import os; os.abort()", "signal 6"),
        ("raise ValueError('odd log')", "odd log"),
        ("print('no answer')", "cannot be read"),
        (SLEEPY, "not read within 0.5 s"),
        (GREEDY, "more memory to read than 1 GB"),
    ],
)
def test_a_recording_that_breaks_its_reader_breaks_nothing_else(folder: Folder, program: str, words: str) -> None:
    folder.write()
    longest = 0.5 if "0.5 s" in words else 60.0
    with closing(FlightViews(folder.settings, (sys.executable, "-c", program), longest, 1_000_000_000)) as views:
        found = views.summary(flight())
    assert words in found["damage"][0]
    assert list(folder.settings.views.iterdir()) == []


def test_only_some_wait_for_a_flight_to_be_read(folder: Folder) -> None:
    for number in range(9):
        folder.write(f"f{number}", 10)
    with closing(FlightViews(folder.settings, (sys.executable, "-c", SLEEPY))) as views:
        threads = [threading.Thread(target=views.summary, args=(flight(f"f{i}"),)) for i in range(8)]
        for thread in threads:
            thread.start()
        wait_until(lambda: not views._places._value)
        assert "other flights are being read" in views.summary(flight("f8"))["warnings"][0]
        with pytest.raises(ServiceError, match="other flights are being read; ask again"):
            views.series(flight("f8"), ["phi"], None, None, 10)
        views.close()
        for thread in threads:
            thread.join()


def test_a_recording_that_cannot_be_read_is_tried_once_while_it_stays_as_it_is(folder: Folder) -> None:
    starts = folder.settings.data / "tried"
    program = f"open({str(starts)!r}, 'a').write('x'); import os; os.abort()"
    folder.write()
    with closing(FlightViews(folder.settings, (sys.executable, "-c", program))) as views:
        assert views.summary(flight()) == views.summary(flight())
        assert starts.read_text() == "x"
        folder.write(messages=300)
        views.summary(flight())
        assert starts.read_text() == "xx"


def test_an_answer_that_is_far_too_long_is_refused(folder: Folder) -> None:
    folder.write()
    with closing(FlightViews(folder.settings, (sys.executable, "-c", "print('x' * 5_000_000)"))) as views:
        assert "says more of itself than anybody can read" in views.summary(flight())["damage"][0]


def test_more_samples_than_an_answer_may_have_are_refused(folder: Folder) -> None:
    folder.write()
    with pytest.raises(SignalMapError, match="6 signals of 100000 points are too many for one answer"):
        folder.views.series(flight(), [f"s{i}" for i in range(6)], None, None, 100_000)


def test_recordings_keep_their_reserve(folder: Folder) -> None:
    folder.write()
    with closing(folder.anew(storage=StorageOptions(reserve_bytes=10**18))) as views:
        assert "too little room to show a flight beside what is recorded" in views.summary(flight())["warnings"][0]
        with pytest.raises(ServiceError, match="too little room"):
            views.series(flight(), ["phi"], None, None, 10)


def test_a_summary_that_a_power_failure_cut_off_is_made_anew(folder: Folder) -> None:
    folder.write()
    first = folder.views.summary(flight())
    for starts, content in enumerate((b"", b"{", b"[]", b'{"topics": {}}'), 2):
        (summary,) = folder.settings.views.glob("*/summary.json")
        summary.write_bytes(content)
        with closing(folder.anew()) as later:
            assert later.summary(flight()) == first, content
        assert folder.starts == starts, content


def test_samples_that_are_gone_or_cut_off_are_made_anew(folder: Folder) -> None:
    folder.write()
    name = folder.views.summary(flight())["signals"][0]
    for starts, content in enumerate((None, b"", bytes(500)), 2):
        (view,) = folder.settings.views.iterdir()
        for file in view.glob("*.npy"):
            file.unlink() if content is None else file.write_bytes(content)
        with pytest.raises(CatalogueError, match="ask again"):
            folder.views.series(flight(), [name], None, None, 10)
        assert folder.views.series(flight(), [name], None, None, 10)[name]["time"], content
        assert folder.starts == starts, content


def test_the_outline_of_a_flight_is_its_height_in_few_points() -> None:
    time = np.arange(6000) / 50.0
    height = Signal(time, np.where(time < 60.0, 2.0 * time, np.nan), "m", "GLOBAL_POSITION_INT")
    airspeed = Signal(time, np.full(time.size, 15.0), "m/s", "VFR_HUD")
    found = outline({"airspeed": airspeed, "height": height})
    assert found is not None
    assert (found["name"], found["unit"], len(found["values"])) == ("height", "m", 60)
    assert found["values"][0] == pytest.approx(1.0, abs=0.1)  # mean of the first second
    assert found["values"] == sorted(found["values"])
    other = outline({"airspeed": airspeed, "height": Signal(time, np.full(time.size, np.nan), "m", "")})
    assert other is not None
    assert other == {"name": "airspeed", "unit": "m/s", "values": [15.0] * 60}
    assert outline({}) is None
