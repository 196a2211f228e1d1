"""Uploads over REST: as form and as body, cut off, and what is no recording."""

import math

import httpx
import pytest
from api_bench import START, Bench, problem
from traffic import Vehicle


def tlog(frames: list[bytes], start_us: int = START // 1000) -> bytes:
    """A telemetry log as Mission Planner writes it: 8-byte big-endian microseconds before each frame."""
    return b"".join((start_us + 20_000 * i).to_bytes(8, "big") + frame for i, frame in enumerate(frames))


@pytest.mark.whole_flight
def test_uploads_as_form_and_as_body(client: httpx.Client) -> None:
    data = tlog(Vehicle(3).second())
    form = client.post("/api/flights", files={"file": ("../../flight one.tlog", data)})
    assert form.status_code == 201, form.text
    made = form.json()
    assert (made["name"], made["source"], made["system"]) == ("flight one.tlog", "upload", 3)
    assert made["messages"] == 52
    body = client.post("/api/flights", params={"name": "flight.tlog"}, content=data)
    assert body.status_code == 201
    assert body.json()["id"] != made["id"]
    recording = client.get(f"/api/flights/{made['id']}/recording").content
    again = client.post("/api/flights", params={"name": "copy.mcap"}, content=recording)
    assert again.json()["messages"] == 52
    assert made["note"] == ""
    for copy in (body.json(), again.json()):
        assert copy["note"].startswith(f"flight {made['id']} has as many messages between the same instants")
    other = client.post("/api/flights", params={"name": "x.tlog"}, content=tlog(Vehicle(3).second(), START)).json()
    assert other["note"] == ""


@pytest.mark.whole_flight
def test_an_upload_that_was_cut_off_says_so_for_good(bench: Bench, client: httpx.Client) -> None:
    whole = client.get(f"/api/flights/{bench.record(5, 4, START)}/recording").content
    made = client.post("/api/flights", params={"name": "cut.mcap"}, content=whole[:-60]).json()
    told = client.get(f"/api/flights/{made['id']}").json()
    assert made["messages"] > 0
    assert any("cut off before it was taken in" in line for line in told["damage"])


@pytest.mark.whole_flight
def test_uploads_that_are_no_recordings_leave_nothing_behind(bench: Bench, client: httpx.Client) -> None:
    assert ".exe" in problem(client.post("/api/flights", files={"file": ("x.exe", b"MZ")}), 422)
    problem(client.post("/api/flights", files={"file": ("x.mcap", b"this is no MCAP file")}), 422)
    problem(client.post("/api/flights", files={"other": (None, b"no file")}), 422)
    assert "holds no file; send it" in problem(client.post("/api/flights", content=b""), 422)
    for empty in (
        client.post("/api/flights", files={"file": ("none.mcap", b"")}),
        client.post("/api/flights", params={"name": "none.mcap"}, content=b""),
    ):
        assert problem(empty, 422).startswith("none.mcap is empty; send")
    large = bytes(bench.settings.max_upload_bytes + 1)
    assert "larger" in problem(client.post("/api/flights", params={"name": "x.tlog"}, content=large), 413)
    chunked = client.post("/api/flights", params={"name": "x.tlog"}, content=iter([large[:600_000], large[:600_000]]))
    assert "larger" in problem(chunked, 413)
    assert client.get("/api/flights").json()["flights"] == []
    assert list(bench.settings.flights.iterdir()) == []
    assert not list(bench.settings.data.glob("upload-*"))


@pytest.mark.whole_flight
def test_a_table_is_a_flight_once_its_columns_are_known(client: httpx.Client) -> None:
    rows = "\n".join(f"{0.02 * i:.2f},{math.sin(0.1 * i)!r},{math.cos(0.1 * i)!r}" for i in range(100))
    table = f"time,q,probe\n{rows}\n".encode()
    refused = problem(client.post("/api/flights", params={"name": "a.csv"}, content=table), 422)
    assert refused.startswith("a.csv: the unit of q is not known")
    assert "the box below the file" in refused
    columns = '[columns]\nalpha = "probe"\n[units]\nq = "deg/s"\nalpha = "deg"\n'
    made = client.post("/api/flights", params={"name": "a.csv", "columns": columns}, content=table)
    assert made.status_code == 201, made.text
    signals = client.get(f"/api/flights/{made.json()['id']}/signals", params={"names": "alpha,q"}).json()["signals"]
    assert signals["alpha"]["unit"] == "rad"
    assert max(signals["q"]["value"]) == pytest.approx(math.radians(1.0), rel=1e-3)
    wrong = client.post("/api/flights", params={"name": "a.csv", "columns": "=["}, content=table)
    assert problem(wrong, 422).startswith("a.csv: columns.toml: is no TOML file")
    assert problem(client.post("/api/flights", params={"name": "a.csv", "columns": "x" * 5000}, content=table), 422)
