"""No command replaces a file that is not of the kind it writes: every output of every command, found in the parser."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs.cli import build_parser, main
from gcs.options.outputs import NEW, FileKind, _set_aside, require_replaceable

# Arguments that name files and folders which are read, or folders of a service, which has files of its own there.
READ = {
    "beside", "columns", "data", "dialect", "file", "files", "flight", "log", "map", "model", "plan", "points", "prior",
    "result", "signing_key", "structure", "tls_cert", "tls_key", "token_file", "validate", "vehicle",
}  # fmt: skip
FOREIGN = {
    "flight.mcap": b"\x89MCAP0\r\n" + bytes(200),
    "mine.toml": b'name = "mine"\n[mass]\nmass = 1.0\n',
    "photo.svg": b'<svg xmlns="http://www.w3.org/2000/svg"></svg>',
    "page.html": b"<!DOCTYPE html>\n<html><body>mine</body></html>",
    "notes.csv": b"time_s,elevator\n0,1\n",
    "script.lua": b"-- my own script\n",
    "settings.json": b'{"schema": "settings/1"}',
}


def _leaves(parser: argparse.ArgumentParser, name: str = "gcs") -> Iterator[tuple[str, argparse.ArgumentParser]]:
    groups = [one for one in parser._actions if isinstance(one, argparse._SubParsersAction)]
    if not groups:
        yield name, parser
    for group in groups:
        for word, inner in group.choices.items():
            yield from _leaves(inner, f"{name} {word}")


LEAVES = dict(_leaves(build_parser()))
WRITES = [
    (name, dest, kind) for name, one in LEAVES.items() for dest, kind in (one.get_default("writes") or {}).items()
]


@pytest.mark.parametrize("command", LEAVES)
def test_a_file_that_a_command_names_is_read_or_checked(command: str) -> None:
    parser = LEAVES[command]
    written = set(parser.get_default("writes") or {})
    unknown = {one.dest for one in parser._actions if one.type is Path} - written - READ
    # A batch and the demonstration fill a folder; each looks at what is in it.
    assert unknown == ({"output"} if command == "gcs batch" else set())


@pytest.mark.parametrize(("command", "dest", "kind"), WRITES, ids=[f"{name} {dest}" for name, dest, _ in WRITES])
@pytest.mark.parametrize("foreign", FOREIGN)
def test_a_foreign_file_stays(command: str, dest: str, kind: FileKind, foreign: str, tmp_path: Path) -> None:
    path = tmp_path / foreign
    path.write_bytes(FOREIGN[foreign])
    with pytest.raises(Exception, match="--force") as caught:
        require_replaceable(path, kind)
    assert "\n" not in str(caught.value)
    require_replaceable(path, kind, force=True)
    assert path.read_bytes() == FOREIGN[foreign]


@pytest.fixture
def vehicle(tmp_path: Path) -> Path:
    path = tmp_path / "v.toml"
    assert main(["vehicle", "new", "-o", str(path), "--mass", "1", "--span", "1", "--chord", "0.2",
        "--speed", "15", "--control", "elevator=2:1000,1500,2000:-20,0,20"]) == 0  # fmt: skip
    return path


@pytest.mark.parametrize(
    "arguments",
    [
        ["report", "r.json", "-o", "flight.mcap"],
        ["report", "r.json", "-o", "mine.toml"],
        ["report", "r.json", "-o", "r.json"],
        ["vehicle", "show", "v.toml", "-o", "v.toml"],
        ["vehicle", "show", "v.toml", "-o", "flight.mcap"],
        ["vehicle", "new", "-o", "v.toml", "--mass", "2", "--span", "1", "--chord", "0.2", "--speed", "15"],
        ["identify", "a.tlog", "--vehicle", "v.toml", "-o", "b.tlog"],
        ["identify", "a.tlog", "--vehicle", "v.toml", "--write-model", "r.json"],
        ["discrepancy", "a.tlog", "--vehicle", "v.toml", "--model", "m.json", "-o", "b.tlog"],
        ["design", "--vehicle", "iitb-mav", "--model", "iitb-mav", "-o", "mine.toml"],
        ["design", "--vehicle", "iitb-mav", "--model", "iitb-mav", "--pwm", "flight.mcap"],
        ["design", "--vehicle", "iitb-mav", "--model", "iitb-mav", "--lua", "flight.mcap"],
        ["import", "a.tlog", "-o", "flight.mcap"],
        ["import", "a.tlog", "-o", "a.tlog"],
        ["export", "a.tlog", "-o", "b.tlog"],
        ["export-model", "iitb-mav", "--vehicle", "iitb-mav", "--to", "csv", "-o", "mine.toml"],
        ["recover", "a.tlog", "-o", "flight.mcap"],
        ["record", "--connect", "udpin:127.0.0.1:0", "-o", "flight.mcap", "--duration", "1"],
    ],
    ids=lambda arguments: " ".join(arguments[:2] + arguments[-2:]),
)
def test_the_command_itself_leaves_it(
    arguments: list[str], vehicle: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(vehicle.parent)
    for name, content in {**FOREIGN, "a.tlog": bytes(16), "b.tlog": bytes(16)}.items():
        Path(name).write_bytes(content)
    Path("r.json").write_text(json.dumps({"schema": "identification/1", "model": {}}))
    before = {path: path.read_bytes() for path in Path().iterdir()}
    capsys.readouterr()
    assert main(arguments) == 2
    (line,) = [one for one in capsys.readouterr().err.splitlines() if "warning:" not in one]
    assert "is there already" in line or "exists already" in line or "one of the files to be read" in line
    assert {path: path.read_bytes() for path in Path().iterdir()} == before


def test_a_newer_one_of_the_same_kind_takes_the_place(tmp_path: Path) -> None:
    plan, sketch = tmp_path / "plan.json", tmp_path / "sketch.svg"
    pulses, script = tmp_path / "pulses.csv", tmp_path / "plan.lua"
    design = ["design", "--vehicle", "iitb-mav", "--model", "iitb-mav", "--manoeuvre", "elevator-doublet",
        "-o", str(plan), "--pwm", str(pulses), "--lua", str(script)]  # fmt: skip
    for _ in range(2):
        assert main(design) == 0
        assert main(["vehicle", "show", "iitb-mav", "-o", str(sketch)]) == 0


def test_force_replaces_and_a_failure_gives_back(vehicle: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = vehicle.with_name("mine.toml")
    place.write_bytes(FOREIGN["mine.toml"])
    assert main(["vehicle", "show", str(vehicle), "-o", str(place), "--force"]) == 0
    assert place.read_bytes().startswith(b"<svg")
    recording = vehicle.with_name("flight.mcap")
    recording.write_bytes(FOREIGN["flight.mcap"])
    garbage = vehicle.with_name("a.tlog")
    garbage.write_bytes(b"no log")
    assert main(["import", str(garbage), "-o", str(recording), "--force"]) == 1
    assert recording.read_bytes() == FOREIGN["flight.mcap"]
    assert main(["vehicle", "new", "-o", str(place), "--mass", "2", "--span", "1", "--chord", "0.2", "--speed", "15",
        "--control", "elevator=2:1000,1500,2000:-20,0,20", "--force"]) == 0  # fmt: skip
    assert b"mass = 2" in place.read_bytes()
    assert not list(vehicle.parent.glob(".*"))


@pytest.mark.parametrize("kind", dict.fromkeys(kind for _, _, kind in WRITES), ids=lambda kind: kind.words or "new")
def test_an_empty_file_is_free_unless_a_new_name_is_asked_for(kind: FileKind, tmp_path: Path) -> None:
    path = tmp_path / "empty"
    path.touch()
    if kind is NEW:
        with pytest.raises(Exception, match="exists already"):
            require_replaceable(path, kind)
    else:
        require_replaceable(path, kind)


def test_a_demonstration_and_a_batch_leave_folders_of_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "service").mkdir()
    (tmp_path / "service" / "flight.mcap").touch()
    assert main(["demo", "--data", str(tmp_path)]) == 2
    assert "no demonstration wrote" in capsys.readouterr().err
    assert (tmp_path / "service" / "flight.mcap").exists()
    (tmp_path / "flights.csv").write_bytes(FOREIGN["notes.csv"])
    assert main(["batch", str(tmp_path), "--vehicle", "iitb-mav", "-o", str(tmp_path)]) == 2
    assert "no table of a batch" in capsys.readouterr().err


def test_what_stood_there_stays_beside_a_new_file_that_broke_off(tmp_path: Path) -> None:
    place = tmp_path / "model.mat"
    place.write_bytes(b"of the user")

    def write() -> None:
        with _set_aside([place]):
            place.write_bytes(b"half")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full") as caught:
        write()
    (kept,) = tmp_path.glob("model.before-*.mat")
    assert kept.read_bytes() == b"of the user"
    assert str(kept) in caught.value.__notes__[0]


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    place, link = tmp_path / "sketch.svg", tmp_path / "link.svg"
    place.touch()
    link.symlink_to(place)
    for _ in range(2):
        assert main(["vehicle", "show", "iitb-mav", "-o", str(link)]) == 0
        assert link.is_symlink()
        assert place.read_bytes().startswith(b"<svg")
    with pytest.raises(Exception, match="is a link to another file"):
        require_replaceable(link, NEW, force=True)
