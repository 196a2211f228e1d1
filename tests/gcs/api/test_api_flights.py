"""Flights, their recordings and signals over REST: the real application, with flights recorded from MAVLink bytes."""

import httpx
import numpy as np
import pytest
from api_bench import START, Bench, problem
from traffic import SECOND

from gcs.catalogue.decimate import decimate
from gcs.jobs.places import Places

pytestmark = pytest.mark.whole_flight


def test_flights_come_in_pages_newest_first(bench: Bench, client: httpx.Client) -> None:
    made = [bench.record(system, 1, START + 60 * system * SECOND) for system in (1, 2, 3)]
    first = client.get("/api/flights", params={"limit": 2}).json()
    assert [flight["id"] for flight in first["flights"]] == made[:0:-1]
    rest = client.get("/api/flights", params={"limit": 2, "after": first["next"]}).json()
    assert [flight["id"] for flight in rest["flights"]] == made[:1]
    assert rest["next"] is None
    found = client.get("/api/flights", params={"search": made[1]}).json()
    assert [flight["id"] for flight in found["flights"]] == [made[1]]


def test_flights_are_found_by_day_and_aircraft(bench: Bench, client: httpx.Client) -> None:
    made = [bench.record(1, 1, START + 43_200 * day * SECOND) for day in range(4)]  # 8 h, 20 h, 8 h, 20 h
    bench.catalogue.change_notes(made[1], vehicle="thor")
    bench.catalogue.add_job(made[3], "identify", {"kind": "identify", "vehicle": "thor@2"})
    bench.catalogue.add_job(made[2], "identify", {"kind": "identify", "vehicle": "thorax@2"})
    bench.catalogue.add_job(made[0], "identify", {"kind": "identify"})

    def found(**asked: str) -> list[str]:
        return [one["id"] for one in client.get("/api/flights", params=asked).json()["flights"]]

    assert found(since="2027-01-16") == [made[3], made[2]]
    assert found(until="2027-01-15") == [made[1], made[0]]
    assert found(since="2027-01-15", until="2027-01-15", vehicle="thor") == [made[1]]
    assert found(vehicle="thor") == [made[3], made[1]]
    assert found(since="0001-01-01", until="9999-12-31") == made[::-1]
    assert found(vehicle="nobody") == []
    assert found(vehicle="station") == [made[0]]  # its jobs name none
    assert found(until="1960-01-01") == []
    assert "since" in problem(client.get("/api/flights", params={"since": "yesterday"}), 422)


def test_a_flight_that_was_read_shows_in_the_list_how_it_went(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(7, 2, START)
    assert client.get("/api/flights").json()["flights"][0]["outline"] is None
    client.get(f"/api/flights/{flight}")
    (item,) = client.get("/api/flights").json()["flights"]
    assert item["outline"] is None  # neither height nor airspeed came
    bench.catalogue.put_outline(flight, {"name": "height", "unit": "m", "values": [1.0, None]})
    assert client.get("/api/flights").json()["flights"][0]["outline"]["values"] == [1.0, None]


def test_a_flights_summary(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(7, 2, START)
    summary = client.get(f"/api/flights/{flight}").json()
    assert summary["system"] == 7
    assert summary["start"] == "2027-01-15T08:00:00.000Z"
    assert summary["messages"] == 2 * 52
    assert summary["topics"]["/mavlink/7/1/ATTITUDE"] == 100
    assert summary["lost"] == 0
    assert {"phi", "p"} <= set(summary["signals"])
    assert summary["jobs"] == []


def test_the_recording_with_ranges(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 1, START)
    whole = (bench.settings.flights / f"{flight}.mcap").read_bytes()
    path = f"/api/flights/{flight}/recording"
    assert client.get(path).content == whole
    part = client.get(path, headers={"Range": "bytes=10-19"})
    assert (part.status_code, part.content) == (206, whole[10:20])
    assert client.get(path, headers={"Range": "bytes=-5"}).content == whole[-5:]
    assert client.get(path, headers={"Range": f"bytes={len(whole) + 1}-"}).status_code == 416


def test_signals_are_thinned_and_cut_to_a_time(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 4, START)
    path = f"/api/flights/{flight}/signals"
    whole = client.get(path, params={"names": "phi"}).json()["signals"]["phi"]
    assert (whole["unit"], len(whole["value"])) == ("rad", 200)
    assert whole["value"] == pytest.approx([0.01 * i for i in range(200)], abs=1e-6)
    thin = client.get(path, params={"names": "phi,theta", "points": 20}).json()["signals"]
    assert set(thin) == {"phi", "theta"}
    assert len(thin["phi"]["value"]) <= 20
    assert (min(thin["phi"]["value"]), max(thin["phi"]["value"])) == pytest.approx((0.0, 1.99), abs=1e-6)
    part = client.get(path, params={"names": "phi", "start": 1.0, "end": 2.0}).json()["signals"]["phi"]
    assert all(1.0 <= at <= 2.0 for at in part["time"])
    assert 49 <= len(part["time"]) <= 51
    assert "nope" in problem(client.get(path, params={"names": "phi,nope"}), 404)


def test_thinning_keeps_every_peak_and_the_order_of_time() -> None:
    generator = np.random.default_rng(5)
    time = np.arange(10_000) / 50.0
    values = generator.normal(size=time.size)
    values[[777, 8888]] = 50.0, -60.0
    values[5000:5400] = np.nan
    kept_time, kept = decimate(time, values, 200)
    assert kept.size <= 200
    assert (np.diff(kept_time) > 0).all()
    assert {50.0, -60.0} <= set(kept.tolist())
    assert np.isnan(kept).any()


def test_spectra_of_signals(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 4, START)
    found = client.get(f"/api/flights/{flight}/spectrum", params={"names": "phi"}).json()["signals"]["phi"]
    assert (found["unit"], found["signal_unit"]) == ("(rad)²/Hz", "rad")
    assert len(found["frequency"]) == len(found["value"]) > 5
    short = client.get(f"/api/flights/{flight}/spectrum", params={"names": "phi", "start": 1, "end": 1.2}).json()
    assert short["signals"]["phi"]["frequency"] == []
    assert "no signal nothing" in problem(
        client.get(f"/api/flights/{flight}/spectrum", params={"names": "nothing"}), 404
    )


def test_any_field_of_a_message_is_a_signal_too(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 3, START)
    summary = client.get(f"/api/flights/{flight}").json()
    assert "roll" in summary["fields"]["ATTITUDE"]
    assert summary["modes"][0]["armed"]
    asked = {"names": "ATTITUDE.roll,phi,SYSTEM_TIME.time_boot_ms"}
    found = client.get(f"/api/flights/{flight}/signals", params=asked).json()["signals"]
    assert found["ATTITUDE.roll"]["value"] == found["phi"]["value"]
    assert found["ATTITUDE.roll"]["unit"] == "rad"
    assert found["SYSTEM_TIME.time_boot_ms"]["value"][0] == 5000
    assert client.get(f"/api/flights/{flight}/spectrum", params={"names": "ATTITUDE.roll"}).status_code == 200
    over_time = client.get(f"/api/flights/{flight}/spectrogram", params={"names": "phi"}).json()["signals"]["phi"]
    assert over_time["unit"] == "dB of 1 (rad)²/Hz"
    assert len(over_time["value"]) == len(over_time["frequency"]) > 10
    assert {len(row) for row in over_time["value"]} == {len(over_time["time"])}
    many = ",".join(["phi", "theta", "psi", "p", "q", "r", "V"])
    assert "too many" in problem(client.get(f"/api/flights/{flight}/spectrogram", params={"names": many}), 404)
    for name, words in (("GPS_RAW_INT.lat", "sent no GPS_RAW_INT"), ("ATTITUDE.x", "no signal ATTITUDE.x"),
                        ("../../etc.passwd", "no signal ../../etc.passwd")):  # fmt: skip
        assert words in problem(client.get(f"/api/flights/{flight}/signals", params={"names": name}), 404)


def test_only_so_many_recordings_are_fetched_at_a_time(bench: Bench, client: httpx.Client) -> None:
    path = f"/api/flights/{bench.record(5, 4, START)}/recording"
    places = bench.app.state.service.fetching = Places(2, 2, "recordings are fetched")
    with places.held("somebody"), places.held("somebody"):
        assert "2 recordings are fetched already" in problem(client.get(path), 503)
    for _ in range(3):  # each gives its place back
        assert client.get(path).status_code == 200
