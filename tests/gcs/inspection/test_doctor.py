"""What `gcs doctor` says of a machine: ports that are taken, disks that are full, boards one may not open."""

from __future__ import annotations

import json
import os
import socket
from collections import namedtuple
from pathlib import Path
from types import SimpleNamespace

import pytest

from gcs.cli import main
from gcs.inspection import doctor
from gcs.inspection.doctor import Finding, examine


def found(path: Path, **ports: int) -> dict[str, Finding]:
    with socket.socket() as one, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two:
        one.bind(("127.0.0.1", 0))
        two.bind(("127.0.0.1", 0))
        free = {"http": one.getsockname()[1], "udp": two.getsockname()[1]}
    return {one.name: one for one in examine(path / "not" / "there" / "yet", **(free | ports))}


def test_a_machine_that_is_well(tmp_path: Path) -> None:
    every = found(tmp_path)
    assert {every[name].level for name in ("port of the page", "port of telemetry")} == {"good"}
    assert str(tmp_path) in every["disk"].text
    assert all(one.cure for one in every.values() if one.level != "good")


def test_ports_that_others_have(tmp_path: Path) -> None:
    with socket.socket() as http, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        http.bind(("127.0.0.1", 0))
        http.listen()
        udp.bind(("0.0.0.0", 0))
        every = found(tmp_path, http=http.getsockname()[1], udp=udp.getsockname()[1])
    assert "in use" in every["port of the page"].text
    assert "--port" in every["port of the page"].cure
    assert "in use" in every["port of telemetry"].text


def test_a_full_disk_and_a_folder_of_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda path: usage(10**12, 10**12, 10**8))
    assert found(tmp_path)["disk"].level == "bad"
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda path: usage(10**12, 10**12, 5 * 10**9))
    assert found(tmp_path)["disk"].level == "care"

    def refused(**_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(doctor.tempfile, "TemporaryFile", refused)
    assert found(tmp_path)["disk"] == Finding(
        "disk", "bad", f"{tmp_path}: permission denied", "give a folder that you may write to, with --data"
    )


def test_boards_one_may_not_open_and_who_else_talks_to_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    board = SimpleNamespace(device="/dev/ttyACM0", hwid="USB VID:PID=2DAE:1058")
    none = SimpleNamespace(device="/dev/ttyS0", hwid="n/a")
    monkeypatch.setattr(doctor.list_ports, "comports", lambda: [board, none])
    access = os.access
    monkeypatch.setattr(doctor.os, "access", lambda path, mode: path != board.device and access(path, mode))
    (tmp_path / "proc" / "17").mkdir(parents=True)
    (tmp_path / "proc" / "17" / "comm").write_text("ModemManager\n")
    monkeypatch.setattr(doctor, "_PROCESSES", tmp_path / "proc")
    said = [one for one in examine(tmp_path, 0, 0) if one.name == "serial ports"]
    assert [one.level for one in said] == ["bad", "care"]
    assert "dialout" in said[0].cure
    assert "ModemManager" in said[1].text


def test_a_clock_of_last_century() -> None:
    assert doctor._clock(lambda: 86_400.0).text == "it shows 1970-01-02 00:00 UTC"
    assert doctor._clock(lambda: 86_400.0).level == "bad"


def test_the_command_ends_with_1_where_something_must_be_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "examine", lambda *_: [Finding("disk", "bad", "it is full", "delete something")])
    assert main(["doctor", "--data", str(tmp_path)]) == 1
    assert capsys.readouterr().out == "BAD   disk: it is full\n      delete something\n"
    assert main(["doctor", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)[0]["level"] == "bad"
    assert main(["doctor", "--port", "99999"]) == 2
