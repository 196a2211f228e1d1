"""The system's errors as a user reads them."""

from __future__ import annotations

import errno
import socket
from pathlib import Path

import pytest

from gcs.cli import main
from gcs.links.opening import open_link
from gcs.text.oserrors import device_reason, reason


def test_a_port_in_use_is_told_without_the_address_as_python_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        url = f"tcpin:127.0.0.1:{taken.getsockname()[1]}"
        assert main(["record", "--connect", url, "-o", "never.mcap"]) == 1
    told = capsys.readouterr().err
    assert f"{url}: cannot listen there (Address already in use); choose another port" in told
    assert "'" not in told


def test_a_device_that_is_not_there_is_told_with_what_is() -> None:
    link = open_link("/dev/ttyNOSUCH9,57600")
    try:
        link.receive(0.2)
        assert link.problem.startswith("there is no device /dev/ttyNOSUCH9; ")
        assert "rrno" not in link.problem
    finally:
        link.close()


@pytest.mark.parametrize(
    ("number", "told"),
    [
        (errno.EACCES, "dialout"),
        (errno.EBUSY, "another program holds /dev/ttyX"),
        (errno.EAGAIN, "another program holds /dev/ttyX"),
        (errno.EIO, "/dev/ttyX cannot be opened: Input/output error"),
    ],
)
def test_a_device_that_cannot_be_opened_says_why(number: int, told: str) -> None:
    assert told in device_reason("/dev/ttyX", OSError(number, f"could not open port: [Errno {number}]"))


def test_other_errors_keep_their_words() -> None:
    assert reason(OSError("no route to that")) == "no route to that"
    assert reason(socket.gaierror(-2, "Name or service not known")) == "Name or service not known"
    with pytest.raises(FileNotFoundError) as caught:
        Path("/no/such").read_text(encoding="utf-8")
    assert reason(caught.value) == "No such file or directory"
