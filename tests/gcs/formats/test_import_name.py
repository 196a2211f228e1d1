"""What can be imported, and that a file is remembered by the name its user knows, whatever the name it lies under."""

from pathlib import Path

import pytest
from dataflash import DataflashWriter
from mavlink_frames import Sender

from gcs.errors import RecordingError
from gcs.formats.conversion import IMPORTS, import_file
from gcs.recording.reader import Recording


def a_bin() -> bytes:
    log = DataflashWriter()
    log.declare("RCOU", "QHH", "TimeUS,C1,C2")
    log.add("RCOU", 1_000_000, 1500, 1000)
    return log.data


def a_tlog() -> bytes:
    return (1_760_000_000_000_000).to_bytes(8, "big") + Sender().send("ATTITUDE").frame


@pytest.mark.parametrize(("ending", "content"), [(".bin", a_bin()), (".tlog", a_tlog())], ids=["bin", "tlog"])
def test_the_given_name_is_kept_else_that_of_the_file(tmp_path: Path, ending: str, content: bytes) -> None:
    source = tmp_path / f"upload{ending}"
    source.write_bytes(content)
    for name, kept in ((f"monday{ending}", f"monday{ending}"), ("", f"upload{ending}")):
        target = tmp_path / f"{name}.mcap"
        import_file(source, target, name=name)
        assert Recording(target).metadata()["import"]["source"] == kept


def test_a_log_opened_as_a_recording_is_refused_with_every_format_that_can_be_imported(tmp_path: Path) -> None:
    log = tmp_path / "a.bin"
    log.write_bytes(bytes(200))
    with pytest.raises(RecordingError, match="not an MCAP file") as refused:
        Recording(log)
    assert [ending for ending in IMPORTS if ending in str(refused.value)] == [e for e in IMPORTS if e != ".mcap"]
