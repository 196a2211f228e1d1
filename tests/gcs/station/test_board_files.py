"""Files onto a board's card, over a real socket, to a board that is not pymavlink's."""

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
        wait_until(lambda: card.system in recorder.state.vehicles)
        yield station, card


@pytest.mark.parametrize("lost", [0.0, 0.15])
def test_a_file_is_written_and_checked_though_datagrams_are_lost(tmp_path: Path, lost: float) -> None:
    with station_and_board(tmp_path, lost=lost) as (station, card):
        station.put_file(1, PATH, SCRIPT)
        assert {name: bytes(content) for name, content in card.files.items()} == {PATH: SCRIPT}
        station.put_file(1, PATH, b"-- another\n")  # the folder is there now, and the file is made anew
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
            wait_until(lambda: station._recorder.is_armed(1))
        with pytest.raises(JobError, match=words):
            station.put_file(1, PATH, SCRIPT)
        with pytest.raises(JobError, match="no vehicle with system id 9 is heard"):
            station.put_file(9, PATH, SCRIPT)
        if not card.armed:
            with pytest.raises(JobError, match="more than the 200000"):
                station.put_file(1, PATH, bytes(300_000))
