"""Files onto a board's card, over a real socket, to a board that is not pymavlink's."""

import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import pytest
from board_card import BoardCard
from traffic import wait_until

from gcs.catalogue.store import Catalogue
from gcs.errors import JobError
from gcs.links.opening import UdpLink, open_link
from gcs.mavlink.dialect import Dialect
from gcs.station import boardfiles
from gcs.station.recorder import FlightRecorder
from gcs.station.station import RecordingStation

pytestmark = pytest.mark.whole_flight

PATH = "APM/scripts/flight_test.lua"
SCRIPT = b"-- a plan\n" + bytes(range(256)) * 12  # not a multiple of what one message holds


@contextmanager
def station_and_board(folder: Path, **board: object) -> Iterator[tuple[RecordingStation, BoardCard]]:
    with ExitStack() as stack:
        catalogue = stack.enter_context(closing(Catalogue(folder / "c.sqlite")))
        recorder = FlightRecorder(folder / "flights", Dialect.load(), catalogue)
        link = open_link("udpin:127.0.0.1:0")
        assert isinstance(link, UdpLink)
        station = RecordingStation([link], recorder)
        station.start()
        stack.callback(station.stop)
        card = stack.enter_context(BoardCard(link.port, **board))  # type: ignore[arg-type]
        wait_until(lambda: card.armed or recorder.is_disarmed(card.system))
        wait_until(lambda: card.system in recorder.live_systems())
        yield station, card


@pytest.mark.parametrize("lost", [0.0, 0.15])
def test_a_file_is_written_and_checked_though_datagrams_are_lost(tmp_path: Path, lost: float) -> None:
    with station_and_board(tmp_path, lost=lost) as (station, card):
        station.put_file(1, PATH, SCRIPT, None)
        assert {name: bytes(content) for name, content in card.files.items()} == {PATH: SCRIPT}
        station.put_file(1, PATH, b"-- another\n", None)  # the folder is there now, and the file is made anew
        assert bytes(card.files[PATH]) == b"-- another\n"


@pytest.mark.parametrize(
    ("board", "words"),
    [
        ({"armed": True}, "the vehicle is armed"),
        ({"protected": True}, "the file there is protected"),
        ({"spoils": True}, "holds something else"),
        ({"speaks": False}, "does not answer to a file"),
    ],
)
def test_what_cannot_be_is_said(
    tmp_path: Path, board: dict[str, object], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(boardfiles, "_LONGEST_S", 6.0)
    with station_and_board(tmp_path, **board) as (station, card):
        if card.armed:
            wait_until(lambda: not station._recorder.is_disarmed(1))
        with pytest.raises(JobError, match=words):
            station.put_file(1, PATH, SCRIPT, None)
        with pytest.raises(JobError, match="no vehicle with system id 9 is heard"):
            station.put_file(9, PATH, SCRIPT, None)
        if not card.armed:
            with pytest.raises(JobError, match="more than the 200000"):
                station.put_file(1, PATH, bytes(300_000), None)


def test_a_file_for_another_board_with_the_same_system_id_is_refused(tmp_path: Path) -> None:
    with station_and_board(tmp_path, uid=7) as (station, card):
        board = wait_until(lambda: station._recorder.board_of(1))
        with pytest.raises(JobError, match="another board"):
            station.put_file(1, PATH, SCRIPT, "0123456789abcdef")
        station.put_file(1, PATH, SCRIPT, board)
        assert bytes(card.files[PATH]) == SCRIPT


def test_a_vehicle_that_is_armed_meanwhile_gets_no_more_of_it(tmp_path: Path) -> None:
    with station_and_board(tmp_path, arms_at_write=True) as (station, card):
        with pytest.raises(JobError, match="was armed"):
            station.put_file(1, PATH, SCRIPT * 20, None)
        assert len(card.files[PATH]) < 20 * len(SCRIPT)


def test_answers_of_others_count_for_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A companion of the vehicle says that all was written; so does somebody without the key."""
    monkeypatch.setattr(boardfiles, "_LONGEST_S", 6.0)
    with (
        station_and_board(tmp_path, component=77, beats_as=1) as (station, _),
        pytest.raises(JobError, match="does not answer to a file"),
    ):
        station.put_file(1, PATH, SCRIPT, None)


def test_the_board_is_asked_for_in_every_flight_anew(tmp_path: Path) -> None:
    """Two aeroplanes with one system id, one after the other."""
    with station_and_board(tmp_path, uid=7) as (station, first):
        boards = [wait_until(lambda: station._recorder.board_of(1))]
        first.__exit__()
        station._recorder.end_flights(time.time_ns())
        with BoardCard(first.port, uid=8):
            boards.append(wait_until(lambda: (b := station._recorder.board_of(1)) != boards[0] and b))
    with closing(Catalogue(tmp_path / "c.sqlite")) as catalogue:
        assert [flight.board for flight in catalogue.flights(ground=True)] == boards[::-1]
