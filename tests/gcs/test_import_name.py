"""An imported file is remembered by the name its user knows, whatever the name it lies under."""

from pathlib import Path

import pytest
from dataflash import DataflashWriter
from mavlink_frames import Sender

from gcs.conversion import import_file
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
