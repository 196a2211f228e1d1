"""The command line as a user runs it: exit codes, one line per error, and what is printed."""

import io
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from patience import PATIENCE_S
from traffic import SECOND, Vehicle, batch, wait_until

from gcs.cli import GROUPS, _modules, main
from gcs.mavlink.dialect import Dialect
from gcs.recording.reader import Recording
from gcs.station.capture import Capture
from gcs.text.progress import Progress

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """Two seconds of telemetry with two frames lost and five bytes of noise."""
    path = tmp_path / "flight.mcap"
    capture = Capture(path, Dialect.load())
    frames = [*Vehicle().second(), *Vehicle(2).second()[:0]]
    del frames[10:12]
    capture.take("udpin:0.0.0.0:14550", batch([*frames, b"noise"], 1_800_000_000 * SECOND))
    capture.close(1_800_000_001 * SECOND)
    return path


def test_info_as_json_counts_messages_losses_and_noise(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(flight), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    topics = {entry["topic"]: entry for entry in info["topics"]}
    assert topics["/mavlink/1/1/ATTITUDE"]["count"] == 48
    assert topics["/mavlink/1/1/ATTITUDE"]["rate_hz"] == pytest.approx(50, rel=0.1)
    assert info["messages"] == 50
    assert info["raw_bytes"] == 5
    (component,) = info["components"]
    assert (component["system"], component["component"], component["lost"]) == (1, 1, 2)
    assert info["damage"] == []


def test_info_as_text_names_topics_and_losses(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(flight)]) == 0
    text = capsys.readouterr().out
    assert "/mavlink/1/1/ATTITUDE" in text
    assert "5 bytes in no frame" in text


def test_tlog_out_and_in_again(flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tlog, again = tmp_path / "flight.tlog", tmp_path / "again.mcap"
    assert main(["export", str(flight), "-o", str(tlog)]) == 0
    assert main(["import", str(tlog), "-o", str(again)]) == 0
    assert Recording(again).counts() == Recording(flight).counts()
    capsys.readouterr()
    assert main(["info", str(tlog), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["messages"] == 50


def test_csv_has_one_row_per_value(flight: Path, tmp_path: Path) -> None:
    table = tmp_path / "flight.csv"
    assert main(["export", str(flight), "-o", str(table)]) == 0
    rows = [line.split(",") for line in table.read_text().splitlines()]
    assert rows[0] == ["log_time_ns", "system", "component", "message", "field", "value"]
    stamps = [int(row[5]) for row in rows if row[3:5] == ["ATTITUDE", "time_boot_ms"]]
    assert stamps == Recording(flight).columns("ATTITUDE")[0]["time_boot_ms"].tolist()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["info", "nowhere.mcap"], "nowhere.mcap"),
        (["info", "nowhere.bin"], "nowhere.bin"),
        (["import", "pyproject.toml", "-o", "x.mcap"], ".toml cannot be imported"),
        (["export", "FLIGHT", "-o", "x.json"], ".json cannot be exported"),
        (["replay", "nowhere.mcap", "--out", "udpout:127.0.0.1:9"], "nowhere.mcap"),
        (["export", "FLIGHT", "--messages", "csv", "-o", "FOLDER"], "exists already"),
        (["export", "FLIGHT", "-o", "NEW.ulg"], "holds no .ulg log"),
        (["info", "FOLDER"], "is a folder"),
        (["identify", "FOLDER", "--vehicle", "iitb-mav"], "is a folder"),
        (["info", "NOISE"], "`gcs import` reads .tlog"),
        (["record", "--connect", "/dev/nope,57600", "--duration", "0.6", "-o", "NEW"], "/dev/nope"),
        (["record", "--connect", "udpin:127.0.0.1:0", "--duration", "0.1", "-o", "NEW"], "nothing was received"),
        (["record", "--connect", "udpin:127.0.0.1:0", "-o", "no/such/folder/x.mcap"], "no/such/folder"),
        (["calibrate", "nowhere.csv", "--form", "linear"], "nowhere.csv"),
        (["serve", "--connect", "udpin:1.2.3.4:14550", "--port", "0", "--data", "DATA"], "udpin:1.2.3.4:14550"),
    ],
)
def test_an_expected_error_is_one_line_and_exit_code_1(
    arguments: list[str],
    words: str,
    flight: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("GCS_TOKEN", raising=False)
    noise, new = tmp_path / "noise.mcap", tmp_path / "new.mcap"
    noise.write_bytes(b"no recording")
    names = {
        "NEW.ulg": tmp_path / "new.ulg",
        "FLIGHT": flight,
        "DATA": tmp_path / "data",
        "FOLDER": tmp_path,
        "NOISE": noise,
        "NEW": new,
    }
    assert main([str(names.get(argument, argument)) for argument in arguments]) == 1
    *progress, last = capsys.readouterr().err.splitlines()
    assert words in last
    assert "Posix" not in last
    assert all(" % 0 messages" in line for line in progress)
    assert not new.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["replay", "x.mcap", "--out", "nonsense"], "nonsense"),
        (["replay", "x.mcap", "--out", "udpout:127.0.0.1:9", "--speed", "-1"], "--speed"),
        (["replay", "x.mcap", "--out", "udpout:127.0.0.1:9", "--lock-step", "--speed", "2"], "--speed"),
        (["replay", "x.mcap", "--out", "udpout:127.0.0.1:9", "--step-ms", "10"], "--lock-step"),
        (["replay", "x.mcap", "--out", "udpout:127.0.0.1:9", "--lock-step", "--step-ms", "-1"], "--step-ms"),
        (["record", "--connect", "foo:bar", "-o", "x.mcap"], "foo:bar"),
        (["record", "--connect", "udpin:127.0.0.1:0", "--duration", "-1", "-o", "x.mcap"], "--duration"),
        (["calibrate", "x.csv", "--form", "foo"], "--form foo"),
        (["calibrate", "x.csv", "--form", "linear", "--unit", "furlong"], "--unit furlong"),
        (["identify", "x.mcap", "--vehicle", "iitb-mav", "-o", "no/such/folder/x.json"], "no/such/folder/x.json"),
        (["identify", "x.mcap", "--vehicle", "iitb-mav", "--write-model", "tests"], "is a folder"),
        (["discrepancy", "x.mcap", "--vehicle", "iitb-mav", "--model", "x", "-o", "tests"], "is a folder"),
        (["discrepancy", "x.mcap", "--vehicle", "iitb-mav", "--model", "x", "--rule-out", "mass"], "--rule-out"),
        (
            ["discrepancy", "x.mcap", "--vehicle", "iitb-mav", "--model", "x", "--from", "5", "--to", "3"],
            "--from, --to",
        ),
        (["serve", "--port", "99999"], "--port 99999"),
        (["serve", "--connect", "foo"], "foo"),
        (["serve", "--host", "0.0.0.0"], "GCS_TOKEN"),
    ],
)
def test_a_setting_that_cannot_be_meant_is_one_line_and_exit_code_2(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("GCS_TOKEN", raising=False)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("command", [["identify", "x.mcap"], ["serve"], ["discrepancy", "x.mcap", "--model", "x"]])
def test_a_vehicle_file_that_cannot_be_used_is_exit_code_2(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text('name = "x"\nwheels = 3\n')
    for vehicle in (wrong, tmp_path / "nowhere.toml"):
        assert main([*command, "--vehicle", str(vehicle)]) == 2
        error = capsys.readouterr().err
        assert str(vehicle) in error
        assert error.count("\n") == 1


@pytest.mark.parametrize(
    "arguments", [["paint"], ["info"], ["record", "-o", "x.mcap"], ["replay", "x", "--speed", "y"]]
)
def test_wrong_use_is_exit_code_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_:
        main(arguments)
    assert exit_.value.code == 2
    assert "usage" in capsys.readouterr().err


def test_without_a_command_the_help_is_shown_with_every_command_in_one_group(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([]) == 0
    shown = capsys.readouterr().out
    grouped = [name for names in GROUPS.values() for name in names]
    assert sorted(grouped) == sorted(module.NAME for module in _modules())
    assert all(f"\n  {name:<14}" in shown for name in grouped)
    assert all(f"\n{title}:\n" in shown for title in GROUPS)
    with pytest.raises(SystemExit):
        main(["identify", "--help"])
    assert capsys.readouterr().out.startswith("usage: gcs identify [-h] --vehicle FILE ")


def test_calibrate_prints_a_line_through_its_points(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = tmp_path / "points.csv"
    points.write_text("reference,reading\n" + "".join(f"{3 * v - 1},{v}\n" for v in range(6)))
    assert main(["calibrate", str(points), "--form", "linear", "--unit", "N", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["schema"] == "calibration/1"
    values = {entry["name"]: entry["value"] for entry in result["coefficients"]}
    assert sorted(values.values()) == pytest.approx([-1.0, 3.0])


def free_port(kind: int = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def environment() -> dict[str, str]:
    return {key: value for key, value in os.environ.items() if key != "GCS_TOKEN"}


def start(arguments: list[str], environment: dict[str, str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "gcs", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=environment,
    )


@pytest.mark.whole_flight
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_record_ends_well_when_it_is_told_to_stop(
    number: signal.Signals, tmp_path: Path, environment: dict[str, str]
) -> None:
    port, path = free_port(), tmp_path / "flight.mcap"
    frames = Vehicle().second()
    sent = 0
    process = start(["record", "--connect", f"udpin:127.0.0.1:{port}", "-o", str(path)], environment)
    with process, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:

        def recorded() -> bool:
            nonlocal sent
            assert process.poll() is None, process.stderr and process.stderr.read()
            sender.sendto(frames[sent % len(frames)], ("127.0.0.1", port))
            sent += 1
            return path.exists() and path.stat().st_size > 3000

        wait_until(recorded)
        process.send_signal(number)
        out, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, error
    assert "messages" in out
    assert 0 < sum(Recording(path).counts().values()) <= sent
    assert Recording(path).damage.truncated is False


@pytest.fixture
def service(tmp_path: Path, environment: dict[str, str]) -> Iterator[tuple[subprocess.Popen[str], str, int]]:
    """`gcs serve` with one UDP link: the process, its URL and the link's port."""
    port = free_port()
    arguments = ["serve", "--connect", f"udpin:127.0.0.1:{port}", "--data", str(tmp_path / "data"), "--port", "0"]
    process = start([*arguments, "--silence", "2"], environment)
    assert process.stdout is not None
    with process:
        line = process.stdout.readline()
        assert line.startswith("serving on "), process.stderr and process.stderr.read()
        yield process, line.split()[-1], port
        if process.poll() is None:
            process.kill()


@pytest.mark.whole_flight
def test_serve_records_a_flight_and_stops_cleanly(
    service: tuple[subprocess.Popen[str], str, int], tmp_path: Path, environment: dict[str, str]
) -> None:
    process, url, port = service
    vehicle = Vehicle(4)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        httpx.Client(base_url=url, timeout=PATIENCE_S) as client,
    ):
        wait_until(lambda: client.get("/api/health").json()["status"] == "ok")
        sender.connect(("127.0.0.1", port))
        frames = vehicle.second()
        for frame in frames:
            sender.send(frame)
        sender.settimeout(PATIENCE_S)
        assert sender.recv(100)[0] == 0xFD  # the station's heartbeat answers whoever spoke

        def ended() -> dict[str, object] | None:
            flights = client.get("/api/flights").json()["flights"]
            return flights[0] if flights and flights[0]["state"] == "complete" else None

        flight = wait_until(ended)
        assert (flight["system"], flight["messages"], flight["end_reason"]) == (4, len(frames), "silence")
        second = start(["serve", "--data", str(tmp_path / "data"), "--port", "0"], environment)
        with second:
            _, error = second.communicate(timeout=PATIENCE_S)
        assert second.returncode == 1
        assert "another service" in error
        process.terminate()
        process.wait(PATIENCE_S)
    assert process.returncode == 0


@pytest.mark.whole_flight
def test_a_flight_cut_off_by_a_crash_is_listed_after_the_restart(
    service: tuple[subprocess.Popen[str], str, int], tmp_path: Path, environment: dict[str, str]
) -> None:
    process, _, port = service
    vehicle = Vehicle(5)
    data = tmp_path / "data"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:

        def on_disk() -> bool:
            sender.sendto(vehicle.attitude(), ("127.0.0.1", port))
            sender.sendto(vehicle.heartbeat(), ("127.0.0.1", port))
            vehicle.boot_ms += 20
            return any(path.stat().st_size > 2000 for path in data.glob("flights/*.mcap"))

        wait_until(on_disk)
    process.kill()
    process.wait(PATIENCE_S)
    again = start(["serve", "--data", str(data), "--port", "0"], environment)
    with again:
        try:
            assert again.stdout is not None
            url = again.stdout.readline().split()[-1]

            def completed() -> dict[str, object] | None:
                (flight,) = httpx.get(f"{url}/api/flights", timeout=PATIENCE_S).json()["flights"]
                return flight if flight["messages"] else None

            flight = wait_until(completed)  # links open first, what a crash left behind comes after
            assert (flight["state"], flight["system"]) == ("recovered", 5)
            summary = httpx.get(f"{url}/api/flights/{flight['id']}", timeout=PATIENCE_S).json()
            assert sum(summary["topics"].values()) == flight["messages"]
            again.terminate()
            again.wait(PATIENCE_S)
        finally:
            again.kill()
    assert again.returncode == 0


def test_quiet_says_nothing_but_errors(flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    csv = tmp_path / "a.csv"
    csv.write_text("time_s,q_deg_s\n" + "\n".join(f"{0.02 * i:.2f},{i}" for i in range(50)))
    assert main(["import", str(csv), "-o", str(tmp_path / "a.mcap"), "--quiet"]) == 0
    assert capsys.readouterr().err == ""
    assert main(["info", str(tmp_path / "nothing.mcap"), "--quiet"]) == 1
    assert "no such file" in capsys.readouterr().err


def test_progress_is_silent_where_asked_and_plain_on_a_dumb_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    shown = {}
    for term, silent in (("xterm", False), ("dumb", False), ("xterm", True)):
        monkeypatch.setenv("TERM", term)
        monkeypatch.setattr(Progress, "silent", silent)
        terminal = Terminal()
        with Progress(terminal) as progress:
            progress(0.5, "half")
        shown[term, silent] = terminal.getvalue()
    assert "\x1b[K" in shown["xterm", False]
    assert shown["dumb", False] == " 50 % half\n"
    assert shown["xterm", True] == ""


@pytest.mark.parametrize("program", ["gcs", "sim-vehicle"])
def test_shells_can_complete_every_command(program: str) -> None:
    run = [str(Path(sys.executable).with_name(program)), "--print-completion"]
    script = subprocess.run([*run, "bash"], capture_output=True, text=True, check=True).stdout
    assert subprocess.run(["bash", "-n"], input=script, text=True, check=False).returncode == 0
    names = ("identify", "--validate", "discrepancy") if program == "gcs" else ("fly", "--manoeuvre", "--effect")
    assert all(name in script for name in names)
    wrong = subprocess.run([*run, "fish"], capture_output=True, text=True, check=False)
    assert wrong.returncode == 2
